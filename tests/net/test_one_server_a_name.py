"""Two servers of one name would share the calls: the second does not start, or both say so."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from mcserver.errors import ServiceError
from mcserver.net import endpoint
from mcserver.net.configuration import NetworkOptions
from mcserver.server import ServerOptions, running
from tests.net.client import WireClient
from tests.net.conftest import Rig
from tests.service.fakes import FakePipelines, FakePort, three_axes
from tests.zenoh_sessions import opened


async def test_a_second_server_of_the_same_name_does_not_start(
    rig: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(endpoint, "TOKEN_PAUSE_S", 0.0)
    port = FakePort(three_axes())
    options = ServerOptions(
        network=NetworkOptions(listen=("tcp/127.0.0.1:0",), connect=(rig.endpoint,)),
        journal=tmp_path / "second.db",
    )
    with pytest.raises(ServiceError, match="MC528: "):
        async with running(three_axes(), options, port, FakePipelines(port)):
            pass


async def test_a_server_says_so_when_another_one_of_its_name_comes(rig: Rig, client: WireClient) -> None:
    events = client.subscribe("event")
    await client.call("status")
    settings = {"mode": "client", "connect/endpoints": [rig.endpoint]}
    with await asyncio.to_thread(opened, settings) as other:
        token = other.liveliness().declare_token(f"mc/@v1/{rig.service.machine.name}/live/another")
        warning = await events.first(lambda event: event["kind"] == "warning")
        assert warning["reason"] == "MC528"
        assert "another" in warning["message"]
        token.undeclare()
