"""The scale of an axis: from the drive's objects, and proven by a measured move."""

from __future__ import annotations

import io
import struct
import threading
from collections.abc import Callable

import pytest

from mcserver.can.cob import Function
from mcserver.canopen.listening import MASTER
from mcserver.canopen.units_check import DriveScale, corrected_lines, measured_scale, proposed_lines
from mcserver.cli import drive_units
from mcserver.errors import UsageFault
from tests.canopen.fake_drives import FakeDrive, FakeDrives
from tests.canopen.rig import Desk, machine_on

Make = Callable[..., FakeDrives]
Capture = pytest.CaptureFixture[str]


def axis_of(keys: str = "") -> object:
    """4096 counts a turn of the motor, 10 mm a turn."""
    return machine_on("can0", [3], keys).axes[0]


@pytest.mark.parametrize(
    ("scale", "units"),
    [
        (DriveScale((4096, 1), None, None), 4096),
        (DriveScale((4096, 2), (50, 1), None), 2048),
        (DriveScale((4096, 1), (50, 1), (36000, 1)), 720),
        (DriveScale((4096, 1), None, (4096, 1)), 4096),
        (DriveScale(None, None, None), None),
    ],
)
def test_a_drive_s_position_unit_follows_from_its_three_objects(
    scale: DriveScale, units: float | None
) -> None:
    assert scale.units_per_motor_turn == units


def test_lines_for_the_machine_file_follow_from_the_drive_and_a_pitch() -> None:
    lines = proposed_lines(DriveScale((4096, 1), (5, 1), None), 10.0)
    assert [line.partition("   #")[0] for line in lines] == [
        "units_per_motor_rev = 2",
        "encoder = [4096, 1]",
        "gear = [5, 1]",
    ]


@pytest.mark.parametrize(
    ("counts", "moved", "keys", "lines"),
    [
        (4096, 10.0, "", []),
        (4096, 10.09, "", []),
        (4096, -10.0, "", ["invert = true"]),
        (-4096, 10.0, "invert = true", []),
        (4096, 10.0, "invert = true", ["invert = false"]),
        (4096, 5.0, "", ["units_per_motor_rev = 5"]),
        (4096, -5.0, "", ["units_per_motor_rev = 5", "invert = true"]),
    ],
)
def test_a_measured_move_says_what_the_machine_file_should(
    counts: float, moved: float, keys: str, lines: list[str]
) -> None:
    axis = axis_of(keys)
    found = measured_scale(axis, counts, 4096, moved)  # type: ignore[arg-type]
    shown = [line.partition("   #")[0] for line in corrected_lines(axis, found)]  # type: ignore[arg-type]
    assert shown == lines
    assert found.fits == (not lines)


@pytest.mark.parametrize(
    ("counts", "moved"), [(99, 1.0), (5000, 0.0), (5000, float("nan")), (0, float("inf"))]
)
def test_a_move_that_says_nothing_is_refused(counts: float, moved: float) -> None:
    with pytest.raises(UsageFault, match="MC017"):
        measured_scale(axis_of(), counts, 4096, moved)  # type: ignore[arg-type]


def hold(drive: FakeDrive, index: int, subindex: int, value: int) -> None:
    drive.objects[index, subindex] = struct.pack("<i", value)


def test_the_drive_s_scale_stands_beside_the_machine_file_s(desk: Desk) -> None:
    drive = desk.make_drives(3)[3]
    hold(drive, 0x608F, 1, 8192)
    hold(drive, 0x608F, 2, 1)
    code, said = desk("units", "0", "--pitch", "5")
    assert code == 0
    assert said["drive"] == {"encoder": [8192, 1], "gear": None, "feed": None}
    assert said["lines"][0].startswith("units_per_motor_rev = 5 ")
    assert drive.written == []


@pytest.mark.parametrize(("counted", "code"), [(4096, 0), (-4096, 3), (8192, 3)])
def test_a_move_by_hand_is_compared_with_what_was_measured(
    desk: Desk, monkeypatch: pytest.MonkeyPatch, counted: int, code: int
) -> None:
    drive = desk.make_drives(3)[3]
    begin = (1 << 31) - 100
    hold(drive, 0x6064, 0, begin)

    def measured(_text: str, **_options: object) -> str:
        hold(drive, 0x6064, 0, (begin + counted + (1 << 31)) % (1 << 32) - (1 << 31))
        return "10"

    monkeypatch.setattr(drive_units.typer, "prompt", measured)  # type: ignore[attr-defined]
    exit_code, said = desk("units", "0", "--check")
    assert (exit_code, said["fits"], said["counts"]) == (code, code == 0, counted)
    assert drive.written == []


@pytest.mark.parametrize("typed", ["much\n", "0\n", "inf\n"])
def test_a_length_that_cannot_be_meant_is_refused(
    desk: Desk, monkeypatch: pytest.MonkeyPatch, typed: str
) -> None:
    desk.make_drives(3)
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert desk.refusal("units", "0", "--check") == (2, "MC017")


def test_what_is_no_length_is_asked_for_again(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = desk.make_drives(3)[3]
    hold(drive, 0x6064, 0, 100)

    class Typed(io.StringIO):
        def readline(self, size: int | None = -1) -> str:
            hold(drive, 0x6064, 0, 100 + 4096)
            return super().readline(size)

    monkeypatch.setattr("sys.stdin", Typed("ten\n10\n"))
    assert desk("units", "0", "--check")[0] == 0


@pytest.mark.parametrize("pitch", ["0", "-1", "nan", "inf"])
def test_a_pitch_that_cannot_be_meant_is_refused(desk: Desk, pitch: str) -> None:
    assert desk.refusal("units", "0", "--pitch", pitch) == (2, "MC017")


def test_beside_a_server_the_position_comes_from_process_data_and_nothing_is_sent(
    desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    drives = desk.make_drives(3)
    position = [1000]
    stopping = threading.Event()

    def server() -> None:
        while not stopping.wait(0.005):
            drives.send(Function.HEARTBEAT + MASTER, b"\x05")
            drives.send(Function.TPDO1 + 3, struct.pack("<Hbi", 0x237, 8, position[0]))

    def measured(_text: str, **_options: object) -> str:
        position[0] -= 4096
        return "-10"

    monkeypatch.setattr(drive_units.typer, "prompt", measured)  # type: ignore[attr-defined]
    thread = threading.Thread(target=server)
    thread.start()
    try:
        code, said = desk("units", "0", "--check")
        assert (code, said["fits"], said["counts"]) == (0, True, -4096)
        assert desk.refusal("units", "0") == (1, "MC560")
    finally:
        stopping.set()
        thread.join()
    assert drives.heard == {}
