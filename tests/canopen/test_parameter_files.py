"""Parameters of drives as files: taken, compared, brought back."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.parameter_file import (
    DriveIdentity,
    ParameterFile,
    StoredParameter,
    differing,
    is_stored,
    read_parameters,
    write_parameters,
)
from mcserver.canopen.parameters import Parameter, parameters_of
from mcserver.canopen.values import Value
from mcserver.errors import UsageFault
from tests.canopen.fake_drives import PRODUCT, VENDOR, FakeDrives
from tests.canopen.rig import Desk

Make = Callable[..., FakeDrives]
Capture = pytest.CaptureFixture[str]
WINDOW, MAX_TORQUE, QUICK = (0x6065, 0), (0x6072, 0), (0x605A, 0)


@pytest.fixture
def desk(desk: Desk) -> Desk:
    """Of two axes, nodes 3 and 4."""
    desk.describe((3, 4))
    return desk


def backed_up(desk: Desk) -> Path:
    path = desk.folder / "axis0.toml"
    assert desk("backup", "0", "-o", str(path))[0] == 0
    return path


def read(path: Path) -> ParameterFile:
    return read_parameters(path.read_bytes(), str(path))


VALUES = st.one_of(
    st.tuples(st.just("i32"), st.integers(-(1 << 31), (1 << 31) - 1)),
    st.tuples(st.just("u64"), st.integers(0, (1 << 64) - 1)),
    st.tuples(st.just("f32"), st.floats(width=32)),
    st.tuples(st.just("f64"), st.floats()),
    st.tuples(st.just("bool"), st.booleans()),
    st.tuples(st.just("str"), st.text(st.characters(max_codepoint=255)).map(lambda text: text.rstrip("\0"))),
)


@given(VALUES, st.text(st.characters(exclude_categories=["Cs"])))
def test_any_value_and_name_come_back_from_the_files_text(value: tuple[str, Value], name: str) -> None:
    parameter = StoredParameter("2000h:01", value[1], value[0], name)
    file = ParameterFile(DriveIdentity(1, 2, None, 4, "ab"), [parameter], "now", [name])
    again = read_parameters(write_parameters(file).encode(), "file")
    assert differing(file.values, again.values) == []
    assert (again.drive, again.unread, again.parameters[0].name) == (file.drive, [name], name)


@given(st.binary(max_size=60))
def test_garbage_is_no_parameter_file(raw: bytes) -> None:
    with pytest.raises(UsageFault, match="MC565"):
        read_parameters(raw, "file")


@pytest.mark.parametrize(
    "line",
    [
        '{ object = "6065", value = 1, type = "u32" }',
        '{ object = "6065h:00", value = 1, type = "u33" }',
        '{ object = "6065h:00", value = -1, type = "u32" }',
        '{ object = "6065h:00", value = [1], type = "u32" }',
        '{ object = "6065h:00", value = nan, type = "u32" }',
        '{ object = "6065h:00", value = 1 }',
        '{ object = "6065h:00", value = 1, type = "u32", more = 1 }',
        '{ object = "6065h:00", value = 1, type = "u32" }, { object = "6065H:00", value = 2, type = "u32" }',
    ],
)
def test_a_line_that_makes_no_sense_is_named(line: str) -> None:
    with pytest.raises(UsageFault, match="MC565: file is no parameter file"):
        read_parameters(f"parameters = [{line}]\n[drive]\n".encode(), "file")


def test_a_whole_number_in_a_line_of_a_real_one_is_the_same_value() -> None:
    text = 'parameters = [{ object = "2000h:00", value = %s, type = "f32" }]\n[drive]\n'
    one, other = (read_parameters((text % value).encode(), "file") for value in ("5", "5.0"))
    assert differing(one.values, other.values) == []


@pytest.mark.parametrize(
    ("index", "name"),
    [
        (0x6040, "Controlword"),
        (0x607A, "Target position"),
        (0x60FE, "Digital outputs.Physical outputs"),
        (0x1010, "Store parameters.1"),
        (0x1003, "Pre-defined error field.Number"),
        (0x1017, "Producer heartbeat time"),
        (0x1600, "RPDO mapping parameter.1"),
        (0x608F, "Position encoder resolution.Encoder increments"),
        (0x2000, "Node-ID"),
        (0x2001, "CAN.Baud rate"),
        (0x1F80, "NMT startup"),
    ],
)
def test_what_is_the_masters_or_commands_is_in_no_file(index: int, name: str) -> None:
    assert not is_stored(Parameter(index, 0, name, "u32", "rw"))
    assert is_stored(Parameter(0x2100, 0, "Gain", "u32", "rw"))
    assert not is_stored(Parameter(0x2100, 0, "Gain", "u32", "ro"))


def test_a_backup_has_identity_names_and_values(desk: Desk) -> None:
    drives = desk.make_drives(3)
    drives[3].objects[WINDOW] = (777).to_bytes(4, "little")
    drives[3].aborts[QUICK] = 0x0800_0022
    taken = read(backed_up(desk))
    assert (taken.drive.vendor_id, taken.drive.product_code) == (VENDOR, PRODUCT)
    assert taken.values[WINDOW] == StoredParameter("6065h:00", 777, "u32", "Following error window")
    kept = [each for each in parameters_of(generic_dictionary(3)) if is_stored(each)]
    assert len(taken.parameters) == len(kept) - 1
    assert "605Ah:00" in taken.unread[0]
    assert "0800 0022h" in taken.unread[0]
    assert drives[3].written == []


def test_a_backup_that_cannot_be_read_to_its_end_leaves_no_file(desk: Desk) -> None:
    desk.make_drives(3)[3].unanswered[WINDOW] = 99
    assert desk.refusal("backup", "0", "-o", str(desk.folder / "b.toml")) == (1, "MC554")
    assert not (desk.folder / "b.toml").exists()


def test_a_restore_writes_what_differs_and_nothing_else(desk: Desk) -> None:
    drives = desk.make_drives(3)
    drives[3].objects[WINDOW] = (777).to_bytes(4, "little")
    path = backed_up(desk)
    drives[3].objects[WINDOW] = (5).to_bytes(4, "little")
    code, done = desk("restore", "0", str(path))
    assert (code, [each["name"] for each in done["written"]]) == (0, ["Following error window"])
    assert drives[3].written == [(*WINDOW, (777).to_bytes(4, "little"))]


def test_a_second_restore_writes_nothing(desk: Desk) -> None:
    drives = desk.make_drives(3)
    path = backed_up(desk)
    assert desk("restore", "0", str(path))[1]["written"] == []
    assert drives[3].written == []


def test_another_drive_of_the_same_kind_takes_the_parameters_and_is_then_the_same(desk: Desk) -> None:
    drives = desk.make_drives(3, 4)
    drives[3].objects[MAX_TORQUE] = (900).to_bytes(2, "little")
    drives[4].objects[0x1018, 4] = (99).to_bytes(4, "little")
    code, compared = desk("compare", "0", "1")
    assert (code, compared["same"]) == (1, False)
    assert compared["differences"] == [{"object": "6072h:00", "name": "Max torque", "left": 900, "right": 0}]
    path = backed_up(desk)
    assert desk("restore", "1", str(path))[0] == 0
    code, compared = desk("compare", str(path), "1")
    assert (code, compared["same"]) == (0, True)


@pytest.mark.parametrize("subindex", [1, 2, 3])
def test_parameters_of_another_device_are_refused(desk: Desk, subindex: int) -> None:
    drives = desk.make_drives(3)
    path = backed_up(desk)
    drives[3].objects[WINDOW] = (5).to_bytes(4, "little")
    drives[3].objects[0x1018, subindex] = struct.pack("<I", 0x0005_0000)
    assert desk.refusal("restore", "0", str(path)) == (2, "MC566")
    assert drives[3].written == []


def test_a_lesser_revision_and_another_serial_number_are_no_other_device() -> None:
    one = DriveIdentity(1, 2, 0x0001_0003, 4)
    assert one.difference(DriveIdentity(1, 2, 0x0001_0009, 5)) == ""
    assert one.difference(DriveIdentity(1, 2, None, 4)) == "major revision 0x1, not unknown"


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ('"6065h:00"', '"6040h:00"', "MC565"),
        ('"6065h:00"', '"60FEh:01"', "MC565"),
        ('"6065h:00"', '"2999h:00"', "MC565"),
        ('value = 0, type = "u32", name = "Following', 'value = 0, type = "i32", name = "Following', "MC565"),
    ],
)
def test_a_file_with_what_is_no_parameter_of_the_drive_writes_nothing(
    desk: Desk, old: str, new: str, code: str
) -> None:
    drives = desk.make_drives(3)
    path = backed_up(desk)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    drives[3].objects[MAX_TORQUE] = (5).to_bytes(2, "little")
    exit_code, refused = desk("restore", "0", str(path))
    assert (exit_code, refused["diagnostics"][0]["code"]) == (2, code)
    assert drives[3].written == []


def test_an_energized_drive_is_not_restored(desk: Desk) -> None:
    drives = desk.make_drives(3)
    path = backed_up(desk)
    drives[3].objects[WINDOW] = (5).to_bytes(4, "little")
    drives[3].statusword = 0x0237
    assert desk.refusal("restore", "0", str(path)) == (1, "MC559")
    assert drives[3].written == []


def test_a_drive_that_does_not_take_a_parameter_is_no_success(desk: Desk) -> None:
    drives = desk.make_drives(3)
    path = backed_up(desk)
    for place in (WINDOW, MAX_TORQUE):
        drives[3].objects[place] = b"\x05".ljust(len(drives[3].objects[place]), b"\0")
    drives[3].kept = {WINDOW}
    code, refused = desk("restore", "0", str(path))
    (shown,) = refused["diagnostics"]
    assert (code, shown["code"]) == (1, "MC567")
    assert "1 of " in shown["message"]
    assert "Following error window holds 5 after 0 was written" in shown["message"]
    assert drives[3].objects[MAX_TORQUE] == b"\0\0"
    assert all(place[0] != 0x1010 for place in drives[3].written)


def test_a_restore_whose_drive_is_lost_says_how_far_it_came(desk: Desk) -> None:
    drives = desk.make_drives(3)
    path = backed_up(desk)
    for place in (WINDOW, MAX_TORQUE):
        drives[3].objects[place] = b"\x05".ljust(len(drives[3].objects[place]), b"\0")
    drives[3].lost_at = MAX_TORQUE
    code, refused = desk("restore", "0", str(path))
    (shown,) = refused["diagnostics"]
    assert (code, shown["code"]) == (1, "MC554")
    assert "; 1 of 2 parameters that differ were written before it, none is stored" in shown["message"]
    assert "restore again" in shown["hint"]


def test_parameters_of_a_nodes_further_axis_are_those_of_its_first_in_a_file() -> None:
    from mcserver.canopen.parameter_file import in_drive, place_in_file

    second = Parameter(0x6865, 0, "Following error window", "u32", "rw")
    assert place_in_file(second) == WINDOW
    assert in_drive(WINDOW, 1) == second.place
    assert in_drive((0x2000, 1), 1) == (0x2000, 1)


def test_not_a_number_is_no_difference() -> None:
    one, other = (StoredParameter("2000h:00", math.nan, "f32") for _ in range(2))
    assert differing({(0x2000, 0): one}, {(0x2000, 0): other}) == []


def test_a_file_that_is_not_there_is_named(desk: Desk) -> None:
    assert desk.refusal("compare", "none.toml", "none.toml") == (2, "MC565")
