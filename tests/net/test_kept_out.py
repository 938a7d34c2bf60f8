"""A server that a stranger with its Zenoh id keeps away from its router comes back with another id."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import zenoh

from mcserver.net import link_watch
from mcserver.net.configuration import NetworkOptions
from mcserver.net.link_watch import REFUSED_LOOKS, LinkWatch
from mcserver.server import ServerOptions, running
from tests.bench.server import free_port
from tests.net.client import WireClient
from tests.service.fakes import FakePipelines, FakePort, three_axes
from tests.zenoh_sessions import opened

LIMIT_S = 60.0


def router(endpoint: str) -> zenoh.Session:
    return opened({"mode": "router", "listen/endpoints": [endpoint]})


@contextmanager
def strangers(endpoint: str, zenoh_id: str) -> Iterator[threading.Event]:
    """Clients that connect with an id again and again; the event: one of them is in."""
    inside, ended = threading.Event(), threading.Event()

    def insist() -> None:
        while not ended.is_set():
            try:
                settings = {"mode": "client", "id": zenoh_id, "connect/timeout_ms": 500}
                with opened({"connect/endpoints": [endpoint], **settings}) as made:
                    inside.set()
                    while made.info.routers_zid() and not ended.is_set():
                        ended.wait(0.01)
            except zenoh.ZError:
                ended.wait(0.01)

    threads = [threading.Thread(target=insist) for _ in range(3)]
    for thread in threads:
        thread.start()
    try:
        yield inside
    finally:
        ended.set()
        for thread in threads:
            thread.join(LIMIT_S)


@pytest.mark.timeout(3 * LIMIT_S)
@pytest.mark.parametrize("listens", [False, True], ids=["connects only", "listens too"])
async def test_a_stranger_with_the_servers_id_keeps_it_away_for_a_moment_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listens: bool
) -> None:
    monkeypatch.setattr(link_watch, "LOOK_S", 0.2)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    first = await asyncio.to_thread(router, endpoint)
    machine = three_axes()
    port = FakePort(machine)
    options = ServerOptions(
        network=NetworkOptions(
            listen=("tcp/127.0.0.1:0",) if listens else None,
            connect=(endpoint,),
            config_file=None if listens else connecting(tmp_path, endpoint),
        ),
        journal=tmp_path / "journal.db",
    )
    async with running(machine, options, port, FakePipelines(port)) as (_, face):
        known = await answered_by(endpoint)
        await asyncio.to_thread(first.close)
        with strangers(endpoint, known) as inside:
            while not inside.is_set():
                # a router whose first guest is the stranger, not the server
                second = await asyncio.to_thread(router, endpoint)
                inside.wait(0.5)
                if not inside.is_set() and face._session.link_sources():
                    await asyncio.to_thread(second.close)
            now = await answered_by(endpoint)
        assert now != known
        await asyncio.to_thread(second.close)


def connecting(folder: Path, endpoint: str) -> Path:
    """A configuration that says nothing of listening, so that nothing is listened on."""
    file = folder / "zenoh.json5"
    file.write_text(json.dumps({"connect": {"endpoints": [endpoint]}}), "utf-8")
    return file


async def answered_by(endpoint: str) -> str:
    """The Zenoh id of the session that answers for the machine, once it does."""
    client = WireClient(endpoint, "bench")
    try:
        async with asyncio.timeout(LIMIT_S):
            while True:
                replies = await asyncio.to_thread(
                    lambda: list(client.session.get("mc/@v1/bench/info", timeout=1.0))
                )
                found = [str(reply.replier_id.zid) for reply in replies if reply.ok and reply.replier_id]
                if found:
                    return found[0]
                await asyncio.sleep(0.1)
    finally:
        await client.close()


class Links:
    """What a watch sees, and what it does."""

    def __init__(self) -> None:
        self.sources: list[str] = []
        self.there = True
        self.reopened = 0
        self.watch = LinkWatch(
            ("tcp/router:7447",), lambda: self.sources, ["tcp/10.0.0.2:7448"], self._reopen, self._is_there
        )

    async def _reopen(self) -> None:
        self.reopened += 1

    async def _is_there(self, endpoint: str) -> bool:
        assert endpoint == "tcp/router:7447"
        return self.there


async def test_a_session_is_given_up_only_where_a_router_is_there_and_has_long_let_it_in_not() -> None:
    links = Links()
    links.there = False
    for _ in range(10 * REFUSED_LOOKS):
        assert not await links.watch.look()
    links.there = True
    for _ in range(REFUSED_LOOKS - 1):
        assert not await links.watch.look()
    links.sources = ["tcp/10.0.0.2:50000"]
    assert not await links.watch.look()
    links.sources = []
    assert [await links.watch.look() for _ in range(REFUSED_LOOKS)] == [False] * (REFUSED_LOOKS - 1) + [True]
    assert links.reopened == 1


async def test_links_of_clients_to_the_listening_port_are_no_link_to_the_router() -> None:
    links = Links()
    links.sources = ["tcp/10.0.0.2:7448"]
    assert [await links.watch.look() for _ in range(REFUSED_LOOKS)][-1]
