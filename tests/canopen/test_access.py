"""Operators' reads and writes of a running machine's drives."""

from __future__ import annotations

import asyncio
import struct
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from mcserver.can.cob import SYNC, Function
from mcserver.canopen.access import MAX_WAITING, OperatorAccess
from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.views import SdoTarget
from mcserver.errors import RuntimeFault, UsageFault
from tests.canopen.fake_drives import PRODUCT, VENDOR, FakeDrives
from tests.canopen.rig import RunningHub, Watched, machine_on, wait_until


@pytest.fixture
def drives(make_drives: Callable[..., FakeDrives]) -> FakeDrives:
    return make_drives(1, 2)


@pytest.fixture
async def access(hub: RunningHub, drives: FakeDrives, watched: Watched) -> AsyncIterator[OperatorAccess]:
    del drives
    service = await asyncio.to_thread(watched.start, machine_on(hub.address(), [1, 2]))
    found = OperatorAccess(service)
    yield found
    await asyncio.to_thread(found.close)


async def test_an_object_is_read_by_its_type_in_the_dictionary(
    access: OperatorAccess, drives: FakeDrives
) -> None:
    drives[2].objects[0x6064, 0] = struct.pack("<i", -5)
    found = await access.sdo_read(SdoTarget(0x6064, axis=1), None)
    assert (found.type, found.value, found.raw) == ("i32", -5, b"\xfb\xff\xff\xff")
    assert (found.axis, found.node, found.bus) == (1, 2, "left")


async def test_a_text_comes_in_segments(access: OperatorAccess) -> None:
    found = await access.sdo_read(SdoTarget(0x1008, axis=0), None)
    assert (found.type, found.value) == ("str", "A drive with a long name")


async def test_a_drive_may_be_named_by_its_node(access: OperatorAccess) -> None:
    assert (await access.sdo_read(SdoTarget(0x1018, 2, node=2), None)).value == PRODUCT


async def test_an_unknown_object_is_read_by_its_length_or_the_type_given(
    access: OperatorAccess, drives: FakeDrives
) -> None:
    drives[1].objects[0x2000, 1] = b"\xff\xff"
    drives[1].objects[0x2000, 2] = b"\x01\x02\x03"
    assert (await access.sdo_read(SdoTarget(0x2000, 1, axis=0), None)).value == 65535
    assert (await access.sdo_read(SdoTarget(0x2000, 1, axis=0), "i16")).value == -1
    assert (await access.sdo_read(SdoTarget(0x2000, 2, axis=0), None)).value == "01 02 03"
    with pytest.raises(DriveError, match=r"MC559.*u32 has 4 bytes, the drive gave 2"):
        await access.sdo_read(SdoTarget(0x2000, 1, axis=0), "u32")


async def test_an_object_is_written_and_read_back(access: OperatorAccess, drives: FakeDrives) -> None:
    written = await access.sdo_write(SdoTarget(0x6065, axis=0), None, 5000)
    assert (written.type, written.raw) == ("u32", struct.pack("<I", 5000))
    assert drives[1].value(0x6065) == 5000
    assert (await access.sdo_read(SdoTarget(0x6065, axis=0), None)).value == 5000


async def test_a_long_value_is_written_in_segments(access: OperatorAccess, drives: FakeDrives) -> None:
    drives[1].objects[0x2001, 0] = b""
    text = "a name of more than seven bytes"
    await access.sdo_write(SdoTarget(0x2001, axis=0), "str", text)
    assert drives[1].objects[0x2001, 0] == text.encode()


async def test_a_long_value_that_is_refused_is_reported_and_leaves_nothing_behind(
    access: OperatorAccess, drives: FakeDrives
) -> None:
    drives[1].aborts[0x2001, 0] = 0x0601_0002
    with pytest.raises(DriveError, match=r"MC553.*2001h:00 cannot be written: abort 0601 0002h"):
        await access.sdo_write(SdoTarget(0x2001, axis=0), "str", "more than four")
    assert (await access.sdo_read(SdoTarget(0x1000, axis=0), None)).value == 0x20192


@pytest.mark.parametrize(
    ("index", "why"),
    [
        (0x6040, "executor"),
        (0x607A, "executor"),
        (0x60FF, "executor"),
        (0x6071, "executor"),
        (0x6060, "executor"),
        (0x60B0, "adds it to the targets"),
        (0x60B2, "adds it to the targets"),
        (0x1400, "mapping"),
        (0x1A03, "mapping"),
        (0x1017, "watching"),
        (0x6091, "scaling"),
        (0x607C, "scaling"),
        (0x60FE, "brake"),
    ],
)
async def test_writes_that_fight_the_cycle_are_refused_with_the_reason(
    access: OperatorAccess, drives: FakeDrives, index: int, why: str
) -> None:
    before = list(drives[1].written)
    with pytest.raises(DriveError, match=rf"MC559: axis 0, node 1 on left: {index:04X}h:00 .*{why}"):
        await access.sdo_write(SdoTarget(index, axis=0), "u32", 0)
    assert drives[1].written == before


async def test_such_objects_may_be_read(access: OperatorAccess) -> None:
    assert (await access.sdo_read(SdoTarget(0x6060, axis=0), None)).value == 8


@pytest.mark.parametrize(
    ("target", "kind", "value", "why"),
    [
        (SdoTarget(0x6065, axis=5), None, 1, "axis 5 has no drive"),
        (SdoTarget(0x6065, node=9), None, 1, "no drive with node 9"),
        (SdoTarget(0x6065, node=1, bus="right"), None, 1, "node 1 on right"),
        (SdoTarget(0x2345, axis=0), None, 1, "its type is not known"),
        (SdoTarget(0x6065, axis=0), None, -1, "outside 0"),
        (SdoTarget(0x6065, axis=0), "bytes", "", "empty"),
        (SdoTarget(0x6064, axis=0), None, 1, "6064h:00 .* is ro"),
    ],
)
async def test_what_cannot_be_written_is_refused(
    access: OperatorAccess, target: SdoTarget, kind: str | None, value: int | str, why: str
) -> None:
    with pytest.raises(DriveError, match=f"MC559.*{why}"):
        await access.sdo_write(target, kind, value)


async def test_limits_of_the_drive_s_dictionary_hold_unless_a_type_is_given(
    access: OperatorAccess, drives: FakeDrives
) -> None:
    service = access.reachable.service
    assert service is not None
    dictionary = service.dictionary(0)
    assert dictionary is not None
    window = dictionary.get_variable(0x6065)
    assert window is not None
    window.min, window.max = 1, 9000
    with pytest.raises(DriveError, match=r"MC559.*9001 is outside 1 to 9000 of the EDS"):
        await access.sdo_write(SdoTarget(0x6065, axis=0), None, 9001)
    assert (await access.sdo_write(SdoTarget(0x6065, axis=0), None, 9000)).value == 9000
    # whoever knows the drive better than its EDS says the type
    await access.sdo_write(SdoTarget(0x6065, axis=0), "u32", 9001)
    assert drives[1].value(0x6065) == 9001


async def test_an_abort_carries_its_code(access: OperatorAccess) -> None:
    with pytest.raises(DriveError) as found:
        await access.sdo_read(SdoTarget(0x2345, 6, axis=0), None)
    assert found.value.code == "MC553"
    assert found.value.details == {"index": 0x2345, "subindex": 6, "abort_code": 0x0602_0000}


async def test_transfers_with_one_drive_follow_each_other(access: OperatorAccess) -> None:
    objects = (0x1008, 0x1000, 0x1008, 0x1018, 0x6060)
    found = await asyncio.gather(*(access.sdo_read(SdoTarget(each, axis=0), None) for each in objects))
    name = "A drive with a long name"
    assert [each.value for each in found[:3]] == [name, 0x20192, name]


async def test_the_loop_runs_on_while_a_drive_is_silent(access: OperatorAccess, drives: FakeDrives) -> None:
    drives[1].unanswered[0x6041, 0] = 99
    reading = asyncio.create_task(access.sdo_read(SdoTarget(0x6041, axis=0), None))
    rounds = 0
    while not reading.done():
        rounds += 1
        await asyncio.sleep(0)
    with pytest.raises(DriveError, match="MC554"):
        await reading
    assert rounds > 10


async def test_too_many_transfers_at_once_are_refused(
    hub: RunningHub, drives: FakeDrives, watched: Watched
) -> None:
    machine = machine_on(hub.address(), [1], "sdo_timeout_ms = 100\nsdo_tries = 1")
    service = await asyncio.to_thread(watched.start, machine)
    access = OperatorAccess(service)
    drives[1].unanswered[0x6041, 0] = 99
    results = await asyncio.gather(
        *(access.sdo_read(SdoTarget(0x6041, axis=0), None) for _ in range(MAX_WAITING + 3)),
        return_exceptions=True,
    )
    await asyncio.to_thread(access.close)
    codes = [error.code for error in results if isinstance(error, DriveError)]
    assert sorted(codes) == ["MC554"] * MAX_WAITING + ["MC559"] * 3


async def test_drives_are_shown_with_all_that_is_known(access: OperatorAccess, drives: FakeDrives) -> None:
    drives.send(Function.TPDO1 + 1, bytes.fromhex("3700080000000000"))
    drives.send(Function.EMCY + 1, bytes.fromhex("1086210000000000"))
    await asyncio.to_thread(
        wait_until,
        lambda: asyncio.run(access.drives())[0].emergency_code is not None,
        "the emergency is known",
    )
    first, second = await access.drives()
    assert (first.axis, first.bus, first.node, first.state, first.nmt) == (
        0,
        "left",
        1,
        "operational",
        "operational",
    )
    assert (first.statusword, first.status) == (0x37, "operation enabled")
    assert (first.vendor_id, first.product_code) == (VENDOR, PRODUCT)
    assert first.emergency.startswith("8610h")
    assert first.heartbeat_age_s is not None
    assert first.heartbeat_age_s < 20.0
    assert (second.statusword, second.status, second.emergency) == (None, "", "")
    assert first.boot_ups == second.boot_ups == 1


def test_an_eds_of_the_machine_file_gives_the_types(
    hub: RunningHub, drives: FakeDrives, watched: Watched, tmp_path: Path
) -> None:
    eds = Path(__file__).parents[2] / "mcserver" / "drive_sim" / "cia402.eds"
    own = "\n[2000]\nParameterName=Own ; of the maker\nDataType=0x0003\nAccessType=rw\nHighLimit=\n"
    (tmp_path / "own.eds").write_bytes(eds.read_bytes() + own.encode())
    drives[1].objects[0x2000, 0] = struct.pack("<h", -7)
    service = watched.start(machine_on(hub.address(), [1], f'eds = "{tmp_path}/own.eds"'))
    drives[1].objects[0x2000, 0] = struct.pack("<h", -7)
    access = OperatorAccess(service)
    try:
        found = asyncio.run(access.sdo_read(SdoTarget(0x2000, axis=0), None))
    finally:
        access.close()
    assert (found.type, found.value) == ("i16", -7)


def test_parameters_are_those_of_the_eds_and_what_makes_no_sense_in_it_is_said(
    hub: RunningHub, drives: FakeDrives, watched: Watched, tmp_path: Path
) -> None:
    eds = Path(__file__).parents[2] / "mcserver" / "drive_sim" / "cia402.eds"
    own = (
        "\n[2000]\nParameterName=<b>Gain</b>\nDataType=0x0003\nAccessType=rw\nLowLimit=-5\nHighLimit=100\n"
        "[2001]\nParameterName=Odd\nDataType=none\n"
        "[2002]\nParameterName=Bounded\nDataType=0x0005\nLowLimit=garbage\nHighLimit=7\n"
    )
    (tmp_path / "own.eds").write_bytes(eds.read_bytes() + own.encode())
    service = watched.start(machine_on(hub.address(), [1], f'eds = "{tmp_path}/own.eds"'))
    access = OperatorAccess(service)
    try:
        found = access.parameters(0)
        with pytest.raises(DriveError, match=r"MC559.*axis 7 has no drive"):
            access.parameters(7)
    finally:
        access.close()
    own_ones = {each.index: each for each in found.parameters if 0x2000 <= each.index < 0x3000}
    gain = own_ones[0x2000]
    assert (gain.name, gain.type, gain.access, gain.low, gain.high) == ("<b>Gain</b>", "i16", "rw", -5, 100)
    assert (own_ones[0x2002].low, own_ones[0x2002].high) == (None, 7)
    assert 0x2001 not in own_ones
    assert ["2001" in each for each in found.unreadable] == [True]
    assert len(found.eds_sha256) == 64
    assert drives[1].written


async def test_buses_are_listened_to_one_request_at_a_time(access: OperatorAccess) -> None:
    listening = asyncio.create_task(access.listening.health(0.1))
    await asyncio.sleep(0)
    with pytest.raises(DriveError, match=r"MC559.*being listened to"):
        await access.listening.health(0.1)
    # whoever asks next is answered
    assert (
        [bus.bus for bus in await listening]
        == [bus.bus for bus in await access.listening.health(0.1)]
        == ["left"]
    )


async def test_listening_ends_at_once_when_the_server_stops(access: OperatorAccess) -> None:
    listening = asyncio.create_task(access.listening.scope(0, 9.0, "6064 > 1e9", 60.0))
    await asyncio.sleep(0)
    await asyncio.to_thread(access.close)
    with pytest.raises((DriveError, RuntimeFault), match=r"the server stops|no cycle runs"):
        await listening


async def test_a_scope_of_mapped_objects_is_taken_around_its_trigger(
    access: OperatorAccess, drives: FakeDrives
) -> None:
    recording = asyncio.create_task(access.listening.scope(1, 0.05, "6064 > 2", 20.0, 0.02))
    at = 0
    while not recording.done():
        at += 1
        drives.send(Function.TPDO1 + 2, struct.pack("<HbI", 0x37, 8, (at % 4) * 1000))
        drives.send(SYNC, b"")
        await asyncio.sleep(0)
    trace = await recording
    zero = round(-trace.begin_s / trace.cycle_s)
    assert (trace.axis, trace.cycles) == (1, 5)
    assert 1 <= zero <= 2
    (position,) = (each for each in trace.signals if each.object == "6064h:00")
    assert position.unit == "mm"
    values = struct.unpack("<5d", position.values)
    assert values[zero] > 2.0 > values[zero - 1]


@pytest.mark.parametrize(
    ("axis", "trigger", "refused"),
    [(7, "", "MC559.*axis 7 has no drive"), (0, "voltage > 1", "MC568"), (0, "6064 = 1", "MC568")],
)
async def test_a_scope_that_cannot_be_is_refused_before_anything_is_listened_to(
    access: OperatorAccess, axis: int, trigger: str, refused: str
) -> None:
    with pytest.raises((DriveError, UsageFault), match=refused):
        await access.listening.scope(axis, 1.0, trigger)


async def test_a_loop_of_the_drive_s_own_is_not_tuned(access: OperatorAccess) -> None:
    with pytest.raises(UsageFault, match="MC095"):
        await access.listening.tune(0, 1.0)


async def test_health_counts_what_nodes_and_strangers_send(
    access: OperatorAccess, drives: FakeDrives
) -> None:
    # a busy computer may give the listener no time while anything comes
    for _ in range(50):
        listening = asyncio.create_task(access.listening.health(0.3))
        while not listening.done():
            drives.send(Function.EMCY + 2, bytes.fromhex("1086210000000000"))
            drives.send(0x5FF, b"")
            await asyncio.sleep(0.005)
        (bus,) = await listening
        first, second = bus.counts.nodes
        if second.emergencies and bus.counts.strangers:
            break
    assert (first.node, first.axes, first.emergencies, second.axes) == (1, [0], [], [1])
    assert second.emergencies[-1].startswith("8610h")
    assert 0 < bus.counts.strangers["5FFh"] < bus.counts.frames
