"""Calls about drives, over the wire, with drives that are known by their answers alone."""

from __future__ import annotations

import asyncio
import math
import struct
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from mcserver.canopen.booted_drives import CanDrives
from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.drive_events import CanopenEvent
from mcserver.canopen.views import (
    BusCounts,
    BusHealth,
    BusScan,
    DriveInfo,
    DriveParameters,
    DriveTrace,
    DriveTuning,
    NodeHealth,
    ParameterInfo,
    ScannedNode,
    ScopeSignal,
    SdoReply,
    SdoTarget,
    TunedLoop,
    Value,
)
from tests.net.client import ErrorAnswer, WireClient
from tests.net.conftest import Rig, running_rig


class AnsweringDrives:
    """Drives that remember what was asked."""

    def __init__(self) -> None:
        self.asked: list[tuple[SdoTarget, str | None, Value | None]] = []
        self.traced: list[tuple[float, str, float, float | None, bool]] = []
        self.listening = self

    async def drives(self) -> list[DriveInfo]:
        return [DriveInfo(1, "cia402", "can0", 3, "operational", statusword=0x27, status="operation enabled")]

    async def scan(self, bus: str, /) -> list[BusScan]:
        node = ScannedNode(3, 402, "drive", 0x11, 0x22, modes=["csp", "hm"], axis=1)
        return [BusScan(bus or "can0", "can0", [node], "[machine]\n")]

    def parameters(self, axis: int, /) -> DriveParameters:
        gain = ParameterInfo(0x2000, 0, "Gain", "i16", "rw", -5, 100)
        return DriveParameters(axis, "can0", 3, 0, "", [gain], ["[2001] DataType is missing"])

    async def health(self, seconds: float, /) -> list[BusHealth]:
        counts = BusCounts(seconds, 100, 0.05, 50, 0.012, [NodeHealth(3, [1], "operational")], {"5FFh": 2})
        return [BusHealth("can0", counts, "SYNC (080h)", 0, {"1": 0.25})]

    async def scope(
        self,
        axis: int,
        seconds: float,
        trigger: str,
        timeout_s: float,
        before_s: float | None,
        /,
        *,
        level: bool,
    ) -> DriveTrace:
        self.traced.append((seconds, trigger, timeout_s, before_s, level))
        signal = ScopeSignal("6064h:00", "Position actual value", "mm", struct.pack("<2d", 1.5, math.nan))
        return DriveTrace(axis, 2, 0.001, -0.001, 1.7e9, 0, [signal])

    async def tune(self, axis: int, seconds: float, /) -> DriveTuning:
        loop = TunedLoop("machine file", {"position_gain": 4.0}, 0.1, seconds, 59.0)
        return DriveTuning(axis, "cst", {"inertia": 4e-5}, "inertia", [loop], [], "", [1.0], [0.5], [-90.0])

    async def sdo_read(self, target: SdoTarget, kind: str | None, /) -> SdoReply:
        self.asked.append((target, kind, None))
        if target.index == 0x2345:
            raise DriveError("MC553", "no such object", "see the EDS", abort_code=0x0602_0000)
        return SdoReply(1, "can0", 3, target.index, target.subindex, kind or "i32", -7, b"\xf9\xff\xff\xff")

    async def sdo_write(self, target: SdoTarget, kind: str | None, value: Value, /) -> SdoReply:
        self.asked.append((target, kind, value))
        return SdoReply(1, "can0", 3, target.index, target.subindex, kind or "u8", value, b"\x01")


@pytest.fixture
def answering() -> AnsweringDrives:
    return AnsweringDrives()


@pytest.fixture
async def drives(answering: AnsweringDrives) -> CanDrives:
    made = CanDrives(asyncio.get_running_loop())
    made.access = answering
    made.on_event(CanopenEvent("drive.lost", "before the service was there", 1, "MC557"))
    return made


@pytest.fixture
async def rig(drives: CanDrives, tmp_path: Path) -> AsyncIterator[Rig]:
    async with running_rig(tmp_path, drives) as made:
        yield made


async def test_drives_are_reported_with_all_that_is_known(client: WireClient) -> None:
    reply = await client.call("drives")
    assert reply["drives"] == [
        {
            "axis": 1,
            "kind": "cia402",
            "bus": "can0",
            "node": 3,
            "state": "operational",
            "statusword": 0x27,
            "status": "operation enabled",
        }
    ]


async def test_a_scan_brings_nodes_and_a_machine_file(client: WireClient) -> None:
    [bus] = (await client.call("drives_scan", bus="left"))["buses"]
    assert bus["bus"] == "left"
    assert bus["nodes"][0]["modes"] == ["csp", "hm"]
    assert bus["machine_file"].startswith("[machine]")


async def test_an_object_is_read_as_asked(client: WireClient, answering: AnsweringDrives) -> None:
    reply = await client.call("sdo_read", axis=1, index=0x6064)
    assert reply == {
        "axis": 1,
        "bus": "can0",
        "fieldbus": "can",
        "node": 3,
        "index": 0x6064,
        "subindex": 0,
        "type": "i32",
        "value": -7,
        "raw": b"\xf9\xff\xff\xff",
    }
    await client.call("sdo_read", node=3, bus="can0", index=0x1018, subindex=2, type="u32")
    assert answering.asked == [
        (SdoTarget(0x6064, axis=1), None, None),
        (SdoTarget(0x1018, 2, node=3, bus="can0"), "u32", None),
    ]


@pytest.mark.parametrize("value", [5, -1, 1.5, True, "0x10"])
async def test_a_value_is_written_once_however_often_it_is_asked(
    client: WireClient, answering: AnsweringDrives, value: Value
) -> None:
    for _ in range(2):
        reply = await client.call("sdo_write", request=9, axis=1, index=0x6065, value=value)
        assert reply["value"] == value
        assert type(reply["value"]) is type(value)
    assert answering.asked == [(SdoTarget(0x6065, axis=1), None, value)]


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"index": 0x6041}, "MC511"),
        ({"index": 0x6041, "axis": 1, "node": 3}, "MC511"),
        ({"index": 0x10000, "axis": 1}, "MC511"),
        ({"index": 0x6041, "subindex": 256, "axis": 1}, "MC511"),
        ({"index": 0x6041, "axis": 1, "type": "u7"}, "MC511"),
        ({"index": 0x6041, "node": 0}, "MC511"),
    ],
)
async def test_requests_that_name_no_object_of_one_drive_are_refused(
    client: WireClient, answering: AnsweringDrives, fields: dict[str, object], code: str
) -> None:
    with pytest.raises(ErrorAnswer) as refused:
        await client.call("sdo_read", **fields)
    assert refused.value.code == code
    assert answering.asked == []


async def test_a_drive_s_abort_code_is_in_the_details(client: WireClient) -> None:
    with pytest.raises(ErrorAnswer) as refused:
        await client.call("sdo_read", axis=1, index=0x2345)
    assert refused.value.code == "MC553"
    assert refused.value.body["details"] == {"abort_code": 0x0602_0000}


async def test_events_of_drives_are_published_those_before_the_start_too(
    client: WireClient, drives: CanDrives
) -> None:
    events = client.subscribe("event")
    await client.call("status")
    drives.on_event(CanopenEvent("drive.emergency", "8611h following error", 1, "MC556"))
    event = await events.first(lambda event: event["kind"] == "drive.emergency")
    assert (event["axis"], event["reason"], event["message"]) == (1, "MC556", "8611h following error")
    kept = (await client.call("events"))["events"]
    assert [each["kind"] for each in kept][:2] == ["server.started", "drive.lost"]


async def test_a_machine_without_can_has_no_such_drives(tmp_path: Path) -> None:
    async with running_rig(tmp_path) as rig:
        client = WireClient(rig.endpoint, "bench")
        try:
            assert (await client.call("drives"))["drives"] == []
            with pytest.raises(ErrorAnswer) as refused:
                await client.call("sdo_read", axis=0, index=0x6041)
        finally:
            await client.close()
    assert refused.value.code == "MC559"


async def test_parameters_of_a_drive_come_with_access_and_limits(client: WireClient) -> None:
    reply = await client.call("drive_parameters", axis=1)
    assert reply["parameters"] == [
        {
            "index": 0x2000,
            "subindex": 0,
            "name": "Gain",
            "type": "i16",
            "access": "rw",
            "low": -5,
            "high": 100,
        }
    ]
    assert reply["unreadable"] == ["[2001] DataType is missing"]


async def test_mapped_objects_and_a_tuning_come_as_they_were_recorded(
    client: WireClient, answering: AnsweringDrives
) -> None:
    trace = await client.call("drive_scope", axis=1, seconds=0.5, trigger="6064 > 1")
    assert answering.traced == [(0.5, "6064 > 1", 10.0, None, False)]
    assert struct.unpack("<2d", trace["signals"][0]["values"]) == (1.5, pytest.approx(math.nan, nan_ok=True))
    tuning = await client.call("drive_tune", axis=1, seconds=3.0)
    assert (tuning["mode"], tuning["loops"][0]["greatest"]) == ("cst", 3.0)
    for call in ("drive_scope", "drive_tune"):
        with pytest.raises(ErrorAnswer, match="MC511"):
            await client.call(call, axis=1, seconds=1e3)


async def test_health_of_the_buses_is_what_was_counted(client: WireClient) -> None:
    (bus,) = (await client.call("drives_health", seconds=0.5))["buses"]
    assert (bus["bus"], bus["counts"]["frames"], bus["following_errors"]) == ("can0", 100, {"1": 0.25})
    for seconds in (0.0, 11.0, float("nan")):
        with pytest.raises(ErrorAnswer) as found:
            await client.call("drives_health", seconds=seconds)
        assert found.value.code == "MC511"
