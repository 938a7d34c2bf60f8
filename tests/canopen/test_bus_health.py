"""Health of a bus: counted from frames, and asked of the drives where nobody else is master."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mcserver.can.cob import SYNC, Function, NmtState
from mcserver.can.pdo import MappedObject, MappedPdo, ProcessData
from mcserver.canopen.bus_health import BusCounts, BusListener
from mcserver.canopen.cycle_samples import Array, CycleSampler, following_error, signals_of
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.machine.bus_load import frame_bits
from mcserver.machine.machine_file import load_machine
from tests.canopen.fake_drives import FakeDrives
from tests.canopen.rig import Desk, Watched, machine_on

TPDO, SLOW, RPDO = 0x183, 0x283, 0x203
STATUS, READING, TARGET = (
    MappedObject(0x6041, 0, 16),
    MappedObject(0x6064, 0, 32),
    MappedObject(0x607A, 0, 32),
)


def listened(frames: list[tuple[int, bytes]], cycle_s: float = 0.001, *, slow: bool = False) -> BusCounts:
    """What is counted of frames, where each SYNC begins a new cycle."""
    tpdos = [MappedPdo(1, TPDO, (STATUS, READING), 1), MappedPdo(2, SLOW, (STATUS,), 4)]
    listener = BusListener({3: ([0], tpdos if slow else tpdos[:1])}, [RPDO])
    at_s = 0.0
    for identifier, payload in frames:
        at_s += cycle_s * (identifier == SYNC)
        listener.take(at_s, identifier, payload)
    return listener.report(at_s or 1.0, 1_000_000)


def cycles(*counts: int) -> list[tuple[int, bytes]]:
    """A SYNC and so many readings, again and again, and a last SYNC."""
    frames: list[tuple[int, bytes]] = []
    for count in counts:
        frames += [(SYNC, b""), *[(TPDO, bytes(6))] * count]
    return [*frames, (SYNC, b"")]


@pytest.mark.parametrize(
    ("counts", "late", "lost"),
    [
        ((1, 1, 1, 1), 0, 0),
        ((1, 0, 1, 1), 0, 1),
        ((1, 0, 2, 1), 1, 0),
        ((1, 0, 0, 1), 0, 2),
        ((1, 0, 0, 3, 1), 2, 0),
        ((1, 0, 0, 2, 1), 1, 1),
        ((0, 1, 1, 1, 1, 2), 1, 0),
        ((0, 1, 1, 1, 0, 2), 1, 1),
        ((1, 1, 0), 0, 1),
    ],
)
def test_a_reading_after_the_next_sync_is_late_and_one_that_never_comes_is_lost(
    counts: tuple[int, ...], late: int, lost: int
) -> None:
    (node,) = listened(cycles(1, *counts)).nodes
    assert (node.late, node.lost) == (late, lost)


def test_a_slow_reading_is_due_at_every_fourth_sync() -> None:
    frames = cycles(*[1] * 13)
    with_slow = [
        frame
        for at, frame in enumerate(frames)
        for frame in ([(SLOW, bytes(2)), frame] if at % 8 == 3 else [frame])
    ]
    (node,) = listened(with_slow, slow=True).nodes
    assert node.lost == 0
    (node,) = listened(frames, slow=True).nodes
    assert node.lost == 2


def test_a_babbling_node_is_neither_late_nor_lost() -> None:
    (node,) = listened(cycles(*[5] * 20)).nodes
    assert (node.late, node.lost, node.readings) == (0, 0, 100)


def test_the_load_is_that_of_frames_with_the_most_stuff_bits() -> None:
    counts = listened(cycles(1, 1, 1, 1), cycle_s=0.01)
    assert counts.load == pytest.approx((4 * frame_bits(6) + 5 * frame_bits(0)) / 0.05 / 1e6)
    assert (counts.frames, counts.syncs) == (9, 5)
    assert counts.longest_sync_gap_s == pytest.approx(0.01)


def test_heartbeats_emergencies_and_starts_are_counted_by_node() -> None:
    beat = Function.HEARTBEAT + 3
    emergency = (0x8611).to_bytes(2, "little") + bytes((1, 0, 0, 0, 0, 0))
    counts = listened(
        [
            (beat, bytes((NmtState.BOOT_UP,))),
            (SYNC, b""),
            (beat, bytes((NmtState.OPERATIONAL,))),
            *[(Function.EMCY + 3, emergency)] * 20,
            (beat, b"\x99"),
            (beat, b""),
            (Function.EMCY + 3, b"\x01"),
        ]
    )
    (node,) = counts.nodes
    assert (node.state, node.heartbeats, node.boot_ups) == ("operational", 2, 1)
    assert node.longest_gap_s == pytest.approx(0.001)
    assert len(node.emergencies) == 8
    assert "8611h following error" in node.emergencies[0]


def test_frames_of_strangers_are_named_and_bounded() -> None:
    counts = listened([(0x184, bytes(8)), (0x184, bytes(8)), *[(each, b"") for each in range(0x400, 0x600)]])
    assert counts.strangers["184h"] == 2
    assert len(counts.strangers) == 16
    assert "583h" not in counts.strangers


# ------------------------------------------------------------ rows of signals


def sampler_of(data: ProcessData, keys: str = "") -> tuple[CycleSampler, list]:  # type: ignore[type-arg]
    (axis,) = machine_on("can0", [3], keys).axes
    signals = signals_of(axis, data, generic_dictionary(3))
    return CycleSampler(signals), signals


PLAIN = ProcessData((MappedPdo(1, RPDO, (TARGET,), 1),), (MappedPdo(1, TPDO, (STATUS, READING), 1),))


def row_of(target: int, reading: int) -> list[tuple[int, bytes]]:
    """One cycle as it is on the bus: the command, SYNC, the reading."""
    return [
        (RPDO, target.to_bytes(4, "little", signed=True)),
        (SYNC, b""),
        (TPDO, b"\x37\x02" + reading.to_bytes(4, "little", signed=True)),
    ]


def rows_of(sampler: CycleSampler, frames: list[tuple[int, bytes]]) -> Array:
    found = [sampler.take(*frame) for frame in frames]
    return np.array([row for row in found if row is not None])


def test_a_row_has_the_command_before_its_sync_and_the_reading_after_it() -> None:
    sampler, signals = sampler_of(PLAIN)
    frames = [*row_of(10, 1), *row_of(20, 2), *row_of(30, 3), (SYNC, b"")]
    assert [signal.name for signal in signals] == ["Target position", "Statusword", "Position actual value"]
    assert rows_of(sampler, frames)[:, (0, 2)].tolist() == [[10, 1], [20, 2], [30, 3]]


def test_a_drive_that_is_where_the_setpoint_before_was_has_no_following_error() -> None:
    sampler, signals = sampler_of(PLAIN)
    frames = [frame for at in range(6) for frame in row_of(100 * at, 100 * (at - 1))]
    error = following_error(rows_of(sampler, frames), signals)
    assert error is not None
    assert np.isnan(error[0])
    assert error[1:].tolist() == [0.0] * 4


def test_a_following_error_has_the_axis_s_unit_and_goes_on_over_the_wrap() -> None:
    sampler, signals = sampler_of(PLAIN)
    last = (1 << 31) - 1
    frames = [*row_of(-(1 << 31), 0), *row_of(0, last), (SYNC, b"")]
    error = following_error(rows_of(sampler, frames), signals)
    assert error is not None
    # one count of 4096 a turn of 10 mm
    assert error[1] == pytest.approx(10.0 / 4096)


def test_positions_go_on_over_the_wrap_of_32_bits() -> None:
    sampler, signals = sampler_of(PLAIN, "zero_offset = 5.0")
    last = (1 << 31) - 1
    rows = rows_of(sampler, [*row_of(0, last), *row_of(0, -(1 << 31)), (SYNC, b"")])
    values = signals[2].values(rows[:, 2])
    assert values[1] - values[0] == pytest.approx(10.0 / 4096, abs=1e-9)
    assert values[0] == pytest.approx(last * 10.0 / 4096 + 5.0)


def test_a_reading_that_is_missing_or_short_is_no_number_and_a_command_stays() -> None:
    sampler, signals = sampler_of(PLAIN)
    rows = rows_of(sampler, [*row_of(1, 2), (SYNC, b""), (TPDO, b"\x37"), (SYNC, b"")])
    assert rows[:, 0].tolist() == [1, 1]
    assert rows[0, 2] == 2
    assert np.isnan(rows[1, 2])
    error = following_error(rows, signals)
    assert error is not None
    assert np.isnan(error).all()


def test_a_slow_reading_stays_the_newest() -> None:
    slow = MappedPdo(2, SLOW, (MappedObject(0x6077, 0, 16),), 10)
    sampler, _ = sampler_of(ProcessData((), (slow,)))
    rows = rows_of(sampler, [(SYNC, b""), (SLOW, b"\x05\x00"), (SYNC, b""), (SYNC, b"")])
    assert rows[:, 0].tolist() == [5, 5]


def test_what_never_came_is_no_number() -> None:
    fresh, _ = sampler_of(PLAIN)
    assert np.isnan(rows_of(fresh, [(SYNC, b""), (SYNC, b"")])).all()


# ------------------------------------------------------------ the command


Make = Callable[..., FakeDrives]


def test_without_a_master_the_drives_say_what_they_remember(desk: Desk) -> None:
    drive = desk.make_drives(3)[3]
    drive.objects[0x1003, 0] = b"\x02"
    drive.objects[0x1003, 1] = (0x0007_3210).to_bytes(4, "little")
    drive.objects[0x1003, 2] = (0x8611).to_bytes(4, "little")
    drive.objects[0x1001, 0] = b"\x05"
    code, said = desk("health", "--seconds", "0.2")
    (bus,) = said["buses"]
    assert (code, bus["master"]) == (0, "")
    assert bus["drives"]["0"]["register"] == "generic, voltage"
    assert bus["drives"]["0"]["history"][0].startswith("3210h")
    assert bus["drives"]["0"]["history"][0].endswith("(0007h)")
    assert "following error" in bus["drives"]["0"]["history"][1]
    assert drive.written == []


def test_a_drive_that_does_not_answer_is_in_the_report(desk: Desk) -> None:
    code, said = desk("health", "--seconds", "0.1")
    assert code == 0
    assert said["buses"][0]["drives"]["0"]["error"].startswith("MC554")


def test_beside_a_server_nothing_is_sent(desk: Desk, watched: Watched) -> None:
    drives = desk.make_drives(3)
    watched.start(load_machine(desk.file))
    before = dict(drives.heard)
    code, said = desk("health", "--seconds", "0.5")
    (bus,) = said["buses"]
    assert code == 0
    assert "node 127" in bus["master"]
    assert bus["drives"] == {}
    assert bus["counts"]["nodes"][0]["state"] == "operational"
    # of the server alone: its heartbeat
    assert {each for each in drives.heard if drives.heard[each] != before.get(each)} == {0x77F}


@pytest.mark.parametrize("seconds", ["0", "-1", "nan", "1e9"])
def test_a_duration_that_cannot_be_meant_is_refused(desk: Desk, seconds: str) -> None:
    assert desk.refusal("health", "--seconds", seconds) == (2, "MC017")
