"""Orders over OPC UA: who may, of which machine, and what a wrong one is answered."""

from __future__ import annotations

import dataclasses
from typing import Any

import pytest
import pytest_asyncio
from asyncua import Client, ua
from mcclient import AxisInfo
from mcclient.errors import NoAnswerInTime, RequestRefused
from mcclient.types import AxesStatus, AxisKind, AxisState, AxisUnit

from tests.opcua.machines import SECRET, WALL, Files, Fleet, Served, channel, program, state
from tests.wire_values import wire_value

pytestmark = pytest.mark.asyncio(loop_scope="package")
ALLOWED: dict[str, Any] = {"orders_from": ("opcua",)}


class Site:
    """A server and a link to two machines, of which ``open`` takes orders."""

    def __init__(self, served: Served, files: Files) -> None:
        self.served, self.files, self.fleet = served, files, Fleet()

    async def look(self, **states: Any) -> None:
        fleet: Any = self.fleet
        await self.served.machines.look(fleet, states)


@pytest_asyncio.fixture(scope="module", loop_scope="package")
async def site(served: Served, files: Files) -> Site:
    site = Site(served, files)
    await site.look(closed=state())
    site.fleet.described = ALLOWED
    await site.look(closed=state(), open=state())
    return site


async def client(site: Site, user: str) -> Client:
    return await channel(site.served, site.files.client, user, SECRET)


async def order(client: Client, name: str, *arguments: Any, machine: str = "open") -> str:
    """Call a method; return the name of the status that it is answered with."""
    own = await client.get_namespace_index("urn:mcserver:machines")
    control = client.get_node(ua.NodeId(f"{machine}:.Control", own))
    try:
        await control.call_method(ua.NodeId(f"{machine}:.Control.{name}", own), *arguments)
    except ua.UaStatusCodeError as error:
        return type(error).__name__
    return "Good"


@pytest.mark.parametrize(
    ("user", "may"),
    [
        ("mes", {}),
        ("helper", {"Hold": ("hold", {"program": "p-1"})}),
        (
            "boss",
            {
                "Start": ("resume", {"program": None}),
                "Hold": ("hold", {"program": "p-1"}),
                "SetFeedOverride": ("override", {"percent": 50.0}),
            },
        ),
    ],
)
async def test_an_order_asks_for_the_role_that_every_door_asks_for(
    site: Site, user: str, may: dict[str, tuple[str, dict[str, object]]]
) -> None:
    site.fleet.orders.clear()
    async with await client(site, user) as one:
        said = {
            "Start": await order(one, "Start", ""),
            "Hold": await order(one, "Hold", "p-1"),
            "SetFeedOverride": await order(one, "SetFeedOverride", 50.0),
        }
    assert said == {name: "Good" if name in may else "BadUserAccessDenied" for name in said}
    assert site.fleet.orders == [("open", *sent) for sent in may.values()]


async def test_a_machine_whose_file_says_nothing_or_nothing_any_more_takes_no_orders(site: Site) -> None:
    site.fleet.orders.clear()
    async with await client(site, "boss") as one:
        assert await order(one, "Hold", "", machine="closed") != "Good"
        site.fleet.described = {}
        assert await order(one, "Hold", "") == "BadNotExecutable"
    site.fleet.described = ALLOWED
    assert site.fleet.orders == []


async def test_an_order_that_is_none_is_refused_before_it_is_sent(site: Site) -> None:
    site.fleet.orders.clear()
    async with await client(site, "boss") as one:
        assert await order(one, "Hold") == "BadArgumentsMissing"
        assert await order(one, "Hold", "", "") == "BadTooManyArguments"
        assert await order(one, "Hold", 3.0) == "BadInvalidArgument"
        assert await order(one, "SetFeedOverride", [50.0, 60.0]) == "BadInvalidArgument"
        own = await one.get_namespace_index("urn:mcserver:machines")
        requests = [ua.CallMethodRequest(MethodId=ua.NodeId("open:.Control.Hold", own))] * 101
        with pytest.raises(ua.uaerrors.BadTooManyOperations):
            await one.uaclient.call(requests)
    assert site.fleet.orders == []


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (NoAnswerInTime("MC532", "no answer"), "BadTimeout"),
        (RequestRefused("MC511", "percent: 900"), "BadOutOfRange"),
        (RequestRefused("MC512", "it has to wait"), "BadInvalidState"),
    ],
)
async def test_what_the_machine_refuses_is_refused(
    site: Site, monkeypatch: pytest.MonkeyPatch, error: Exception, status: str
) -> None:
    async def refuse(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(site.fleet, "order", refuse)
    async with await client(site, "boss") as one:
        assert await order(one, "Hold", "") == status


async def names(client: Client, path: str) -> dict[str, Any]:
    """Return the children of a node of the machine ``open``, by name."""
    own = await client.get_namespace_index("urn:mcserver:machines")
    found = await client.get_node(ua.NodeId(f"open:.{path}", own)).get_children()
    return {(await each.read_browse_name()).Name: each for each in found}


async def test_jobs_come_with_their_programs_and_axes_with_another_start(site: Site) -> None:
    axes = [
        wire_value(AxisInfo, index, AxisKind("rotary"), AxisUnit("deg"), spindle=index == 3)
        for index in (0, 3)
    ]
    moving = (AxisState("moving"), AxisState("speed"))
    columns = wire_value(AxesStatus, (0, 3), (1.5, 0.0), (1.5, 0.0), (0.0, 600.0), (0.0, 0.0), moving)
    site.fleet.described = ALLOWED | {"axes": tuple(axes), "instance": "second"}
    first = program("running", "part.nc", opened_at=WALL)
    jog = program("running", "jog axis X", opened_at=WALL)
    queued = wire_value(
        type(first), "id-2", type(first.state)("queued"), "alice", "next.nc", opened_at=WALL + 1
    )
    now = dataclasses.replace(state(programs=(queued, first, jog)), instance="second", axes=columns)
    await site.look(open=now)
    async with await client(site, "mes") as one:
        jobs = await names(one, "Production.ProductionPlan")
        assert list(jobs) == ["id-1", "id-2"]
        own = await one.get_namespace_index("urn:mcserver:machines")

        async def read(path: str) -> Any:
            return await one.get_node(ua.NodeId(f"open:.{path}", own)).read_value()

        plan = "Production.ProductionPlan.id-2"
        assert await read(f"{plan}.NumberInList") == 1
        assert list(await names(one, f"{plan}.ProductionPrograms")) == ["Program"]
        assert (await read(f"{plan}.State.CurrentState")).Text == "Initializing"
        assert await read(f"{plan}.ProductionPrograms.Program.Name") == "next.nc"
        assert (await read(f"{plan}.RunsPlanned"), await read(f"{plan}.RunsCompleted")) == (1, 0)
        assert set(await names(one, "Monitoring.Axes")) == {"X", "A"}
        assert await read("Monitoring.Axes.X.ActualPosition") == 1.5
        assert await read("Monitoring.Spindle.IsRotating") is True
        await site.look(open=dataclasses.replace(now, programs=()))
        assert await names(one, "Production.ProductionPlan") == {}
