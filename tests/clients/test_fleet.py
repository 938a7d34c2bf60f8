"""Several machines behind a router: one table, and orders to many."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Iterator

import pytest
from fake_server import FakeServer
from mcclient.cli.fleet import Sight
from mcclient.fleet import FleetLink

from tests.bench.server import free_port
from tests.clients.conftest import MakeServer
from tests.zenoh_sessions import opened

Run = Callable[..., tuple[int, str, str]]


class Site:
    """Two machines and the router that connects to both."""

    def __init__(self, first: FakeServer, second: FakeServer) -> None:
        self.machines = (first, second)
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        ends = {"listen/endpoints": [self.endpoint], "connect/endpoints": [first.endpoint, second.endpoint]}
        self._router = opened({"mode": "router", **ends})
        # a router's links come up one after the other
        pause = threading.Event()
        live = self._router.liveliness()
        for _ in range(200):
            there = [reply for reply in live.get("mc/@v1/*/live/*", timeout=2.0) if reply.ok is not None]
            if len(there) == 2:
                return
            pause.wait(0.02)
        raise AssertionError("the router does not reach both machines")

    def close(self) -> None:
        self._router.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def site(make_server: MakeServer) -> Iterator[Site]:
    site = Site(make_server("left"), make_server("right"))
    yield site
    site.close()


@pytest.fixture
def mcctl(mcctl_at: Callable[[str], Run], site: Site) -> Run:
    return mcctl_at(site.endpoint)


def test_one_table_has_every_machine_and_those_in_need_first(mcctl: Run, site: Site) -> None:
    site.machines[1].state = "estop"
    code, out, _ = mcctl("fleet", "--once")
    assert code == 0
    assert [line.split()[:2] for line in out.splitlines()[1:]] == [["right", "estop"], ["left", "ready"]]
    code, out, _ = mcctl("fleet", "--once", "--json")
    assert {each["machine"]: each["status"]["state"] for each in json.loads(out)} == {
        "left": "ready",
        "right": "estop",
    }


def test_an_order_goes_to_the_machines_named_and_to_no_other(mcctl: Run, site: Site) -> None:
    code, out, _ = mcctl("fleet", "hold", "left", "--yes")
    assert (code, out) == (0, "left: hold\n")
    assert [each.calls["hold"] for each in site.machines] == [1, 0]
    assert mcctl("fleet", "abort", "-y")[0] == 0
    assert [each.calls["abort"] for each in site.machines] == [1, 1]


def test_nothing_is_ordered_where_nobody_can_be_asked(mcctl: Run, site: Site) -> None:
    code, _, err = mcctl("fleet", "abort")
    assert code == 2
    assert "--yes" in err
    assert [each.calls["abort"] for each in site.machines] == [0, 0]


def test_a_machine_that_is_not_there_is_refused_before_any_order(mcctl: Run, site: Site) -> None:
    code, _, err = mcctl("fleet", "hold", "left", "middle", "--yes")
    assert code == 5
    assert "not there: middle" in err
    assert site.machines[0].calls["hold"] == 0


def test_an_emergency_stop_of_all_is_confirmed_by_each(mcctl: Run, site: Site) -> None:
    code, out, _ = mcctl("fleet", "estop", "--yes")
    assert (code, out) == (0, "left: estop\nright: estop\n")
    assert [each.state for each in site.machines] == ["estop", "estop"]


async def test_every_order_over_one_link_is_carried_out(site: Site) -> None:
    link = await FleetLink.open(site.endpoint)
    try:
        await link.find(timeout_s=2.0)
        for method in ("hold", "resume", "hold", "abort"):
            await link.order("left", method)
    finally:
        await link.close()
    calls = site.machines[0].calls
    assert (calls["hold"], calls["resume"], calls["abort"]) == (2, 1, 1)
    # a server answers a number that it has had from memory
    numbers = [request["request"] for _, request in site.machines[0].requests]
    assert len(set(numbers)) == len(numbers) == 4


async def test_a_machine_that_has_gone_stays_in_the_table(site: Site) -> None:
    link = await FleetLink.open(site.endpoint)
    try:
        sight = Sight(link)
        async with asyncio.timeout(20.0):
            while [each.answers for each in await sight.look()] != [True, True]:
                continue
            site.machines[0].go_away()
            while (await sight.look())[0].online:
                continue
        left, right = await sight.look()
        assert (left.online, left.status is not None, right.answers) == (False, True, True)
    finally:
        await link.close()
