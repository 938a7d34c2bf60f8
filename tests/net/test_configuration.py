"""What a Zenoh configuration file says holds, and contradictions are refused."""

from __future__ import annotations

import asyncio
import json
import socket
from pathlib import Path

import pytest
import zenoh

from mcserver.errors import ConfigurationError
from mcserver.net.configuration import (
    DEFAULT_LISTEN,
    NetworkOptions,
    emergency_configuration,
    main_configuration,
    reach,
)
from tests.net.client import WireClient
from tests.net.conftest import Rig

TLS = "tls/0.0.0.0:7447"


def written(folder: Path, text: str) -> Path:
    path = folder / "zenoh.json5"
    path.write_text(text, "utf-8")
    return path


def endpoints(config: zenoh.Config, which: str) -> list[str]:
    found: list[str] = json.loads(config.get_json(f"{which}/endpoints"))
    return found


def test_without_a_file_only_the_loopback_is_listened_on() -> None:
    where = reach(NetworkOptions())
    assert (where.mode, where.listen, where.connect) == ("peer", DEFAULT_LISTEN, ())
    assert all("127.0.0.1" in endpoint for endpoint in where.listen)


def test_what_the_file_listens_on_is_all_that_is_listened_on(tmp_path: Path) -> None:
    options = NetworkOptions(config_file=written(tmp_path, f'{{listen: {{endpoints: ["{TLS}"]}}}}'))
    config = main_configuration(options, reach(options))
    assert endpoints(config, "listen") == [TLS]
    assert endpoints(config, "connect") == []


def test_a_file_that_connects_makes_the_server_listen_nowhere(tmp_path: Path) -> None:
    file = written(tmp_path, '{mode: "client", connect: {endpoints: ["tls/router:7447"]}}')
    options = NetworkOptions(config_file=file)
    where = reach(options)
    assert (where.mode, where.listen, where.connect) == ("client", (), ("tls/router:7447",))
    beside = emergency_configuration(options, where)
    assert beside is not None
    assert endpoints(beside, "connect") == ["tls/router:7447"]
    assert endpoints(beside, "listen") == []


def test_endpoints_by_mode_are_those_of_the_file_s_mode(tmp_path: Path) -> None:
    text = f'{{mode: "router", listen: {{endpoints: {{router: ["{TLS}"], peer: ["tcp/0.0.0.0:1"]}}}}}}'
    assert reach(NetworkOptions(config_file=written(tmp_path, text))).listen == (TLS,)


@pytest.mark.parametrize(
    ("text", "options"),
    [
        (f'{{listen: {{endpoints: ["{TLS}"]}}}}', {"listen": ("tcp/127.0.0.1:0",)}),
        ('{connect: {endpoints: ["tls/router:7447"]}}', {"connect": ("tcp/other:7447",)}),
        ('{mode: "client", connect: {endpoints: ["tls/r:1"]}}', {"listen": ("tcp/127.0.0.1:0",)}),
    ],
)
def test_an_option_that_contradicts_the_file_is_refused(
    tmp_path: Path, text: str, options: dict[str, tuple[str, ...]]
) -> None:
    with pytest.raises(ConfigurationError, match="MC521: "):
        reach(NetworkOptions(config_file=written(tmp_path, text), **options))  # type: ignore[arg-type]


def test_an_option_that_says_the_same_as_the_file_is_none(tmp_path: Path) -> None:
    file = written(tmp_path, f'{{listen: {{endpoints: ["{TLS}"]}}}}')
    assert reach(NetworkOptions(listen=(TLS,), config_file=file)).listen == (TLS,)


def test_what_else_the_file_says_holds_against_the_server_s_own_settings(tmp_path: Path) -> None:
    options = NetworkOptions(config_file=written(tmp_path, "{transport: {link: {tx: {lease: 7000}}}}"))
    config = main_configuration(options, reach(options))
    assert config.get_json("transport/link/tx/lease") == "7000"
    assert config.get_json("scouting/multicast/enabled") == "false"


@pytest.mark.parametrize("text", ["{mode: 3}", "not JSON5", '{id: "6740b2f8"}'])
def test_a_file_that_cannot_hold_is_refused(tmp_path: Path, text: str) -> None:
    options = NetworkOptions(config_file=written(tmp_path, text))
    with pytest.raises(ConfigurationError, match="MC521: "):
        main_configuration(options, reach(options))


async def test_hundreds_of_connections_that_say_nothing_keep_no_client_out(rig: Rig) -> None:
    host, port = rig.endpoint.partition("/")[2].rsplit(":", 1)
    idle = [socket.create_connection((host, int(port))) for _ in range(400)]
    try:
        async with asyncio.timeout(10.0):
            client = await asyncio.to_thread(late_client, rig.endpoint, asyncio.get_running_loop())
            assert (await client.call("status"))["state"] == "ready"
        await client.close()
    finally:
        for connection in idle:
            connection.close()


def late_client(endpoint: str, loop: asyncio.AbstractEventLoop) -> WireClient:
    return WireClient(endpoint, "bench", loop=loop)
