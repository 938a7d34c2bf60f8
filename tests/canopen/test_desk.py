"""Parameters of drives by name, at the command line and without a server."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mcserver.can.cob import SYNC, Function, NmtState
from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.desk import at_desk
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.eds import parse_description
from mcserver.canopen.parameters import find, parameters_of, search
from mcserver.canopen.settings import settings_of
from mcserver.errors import RuntimeFault, UsageFault
from mcserver.machine.machine_file import load_machine
from tests.canopen.fake_drives import FakeDrives
from tests.canopen.local_drives import LocalDrive
from tests.canopen.rig import Desk, RunningHub, Watched, machine_file

SHIPPED_EDS = Path(__file__).parents[2] / "mcserver" / "drive_sim" / "cia402.eds"
Make = Callable[..., FakeDrives]
WINDOW, ENABLED = (0x6065, 0), 0x0237
EDS = """
[2000]
ParameterName=Gain
ObjectType=0x7
DataType=0x0003
AccessType=rw
LowLimit=-5
HighLimit=100
[2001]
ParameterName=Limits
ObjectType=0x9
[2001sub1]
ParameterName=Lower
DataType=0x0007
AccessType=rw
[2001sub2]
ParameterName=Upper
DataType=0x0008
AccessType=rw
[2002]
ParameterName=Torque
ObjectType=0x7
DataType=0x0006
AccessType=ro
[2003]
ParameterName=Odd
DataType=none
"""


def dictionary_of_eds() -> Any:
    return parse_description(EDS, 3).dictionary


def test_parameters_have_the_names_types_access_and_limits_of_the_eds() -> None:
    gain, lower, upper, torque = parameters_of(dictionary_of_eds())
    assert (gain.title, gain.type, gain.low, gain.high) == ("2000h:00 Gain", "i16", -5, 100)
    assert [each.title for each in (lower, upper)] == ["2001h:01 Limits.Lower", "2001h:02 Limits.Upper"]
    assert (upper.type, torque.writable) == ("f32", False)


@pytest.mark.parametrize(
    "text",
    ["6065", "6065h", "0x6065", "6065h:00", "6065:0", "Following error window", " following  ERROR window"],
)
def test_a_parameter_is_named_by_number_or_name(text: str) -> None:
    dictionary = generic_dictionary(3)
    assert find(parameters_of(dictionary), dictionary, text).place == WINDOW


def test_a_member_is_named_with_or_without_its_record() -> None:
    dictionary = dictionary_of_eds()
    for text in ("limits.upper", "upper", "2001:2", "2001h:02"):
        assert find(parameters_of(dictionary), dictionary, text).place == (0x2001, 2)


@pytest.mark.parametrize(("text", "remedy"), [("folowing error window", "6065h:00"), ("6091:9", "6091h:01")])
def test_a_name_that_is_not_there_is_refused_with_the_nearest_ones(text: str, remedy: str) -> None:
    dictionary = generic_dictionary(3)
    with pytest.raises(UsageFault, match="no parameter") as caught:
        find(parameters_of(dictionary), dictionary, text)
    assert remedy in caught.value.hint


def test_a_name_that_reads_as_a_number_is_a_name() -> None:
    dictionary = parse_description("[6092]\nParameterName=Feed\nDataType=7\n", 3).dictionary
    assert find(parameters_of(dictionary), dictionary, "feed").index == 0x6092


def test_a_part_of_a_name_names_no_parameter() -> None:
    dictionary = generic_dictionary(3)
    with pytest.raises(UsageFault) as caught:
        find(parameters_of(dictionary), dictionary, "following error")
    assert "6065h:00" in caught.value.hint
    assert "6066h:00" in caught.value.hint


def test_an_object_that_the_eds_spoils_is_named_where_it_is_asked_for() -> None:
    dictionary = dictionary_of_eds()
    with pytest.raises(Exception, match="DataType") as caught:
        find(parameters_of(dictionary), dictionary, "2003")
    assert caught.value.code == "MC008"  # type: ignore[attr-defined]


def test_a_search_finds_all_words_in_any_case() -> None:
    found = search(parameters_of(generic_dictionary(3)), ["ERROR", "window"])
    assert [each.place for each in found] == [WINDOW]


def test_a_further_axis_of_a_node_has_its_own_objects_under_the_same_names() -> None:
    text = "".join(
        f"[{index}]\nParameterName=Following error window\nDataType=7\nAccessType=rw\n"
        for index in (6065, 6865)
    )
    dictionary = parse_description(text, 3).dictionary
    for axis, index in ((0, 0x6065), (1, 0x6865)):
        assert find(parameters_of(dictionary, axis), dictionary, "following error window").index == index


def test_parameters_are_listed_and_searched_without_a_bus(desk: Desk) -> None:
    (desk.folder / "drive.eds").write_text(EDS)
    desk.describe(keys='eds = "drive.eds"')
    desk.hub.stop()
    code, listed = desk("list")
    assert (code, listed["drives"][0]["node"]) == (0, 3)
    code, listed = desk("list", "0")
    assert (code, len(listed["parameters"])) == (0, 4)
    code, found = desk("search", "0", "limits")
    assert [each["name"] for each in found["parameters"]] == ["Limits.Lower", "Limits.Upper"]


def test_values_are_read_by_name(desk: Desk) -> None:
    drives = desk.make_drives(3)
    drives[3].objects[WINDOW] = (1234).to_bytes(4, "little")
    code, read = desk("read", "0", "Following error window", "1008")
    assert code == 0
    assert [each["value"] for each in read["values"]] == [1234, "A drive with a long name"]
    assert drives[3].written == []
    assert drives[3].resets == 0


def test_a_value_is_written_read_back_and_stored(desk: Desk) -> None:
    drives = desk.make_drives(3)
    code, wrote = desk("write", "0", "following error window", "0x100")
    assert (code, wrote["values"][0]["value"]) == (0, 256)
    assert desk("save", "0") == (0, {"ok": True})
    assert drives[3].written == [(*WINDOW, b"\x00\x01\x00\x00"), (0x1010, 1, b"save")]


@pytest.mark.parametrize(
    ("parameter", "value", "said"),
    [
        ("gain", "101", "-5 to 100"),
        ("gain", "-6", "-5 to 100"),
        ("gain", "1.5", "no i16"),
        ("gain", "many", "no i16"),
        ("limits.lower", "0x100000000", "no u32"),
        ("torque", "1", "is ro"),
    ],
)
def test_a_value_that_the_eds_does_not_allow_opens_no_bus(
    desk: Desk, parameter: str, value: str, said: str
) -> None:
    (desk.folder / "drive.eds").write_text(EDS)
    desk.describe(keys='eds = "drive.eds"')
    desk.hub.stop()
    code, refused = desk("write", "0", parameter, value)
    assert code == 2
    assert refused["diagnostics"][0]["code"] == "MC559"
    assert said in refused["diagnostics"][0]["message"]


@pytest.mark.parametrize("name", ["6040", "6060", "target position", "60FF", "60FE:1", "1010:1", "1011:1"])
def test_what_commands_motion_or_stores_is_not_written(desk: Desk, name: str) -> None:
    drives = desk.make_drives(3)
    assert desk.refusal("write", "0", name, "1") == (1, "MC559")
    assert drives[3].written == []


@pytest.mark.parametrize("command", [("write", "0", "6065", "7"), ("save", "0")])
def test_nothing_is_written_to_an_energized_drive(desk: Desk, command: tuple[str, ...]) -> None:
    drives = desk.make_drives(3)
    drives[3].statusword = ENABLED
    code, refused = desk(*command)
    assert (code, refused["diagnostics"][0]["code"]) == (1, "MC559")
    assert "operation enabled" in refused["diagnostics"][0]["message"]
    assert drives[3].written == []


def test_a_running_server_is_the_master_of_its_bus(desk: Desk, watched: Watched) -> None:
    drives = desk.make_drives(3)
    watched.start(load_machine(desk.file))
    before = list(drives[3].written)
    for command in (("read", "0", "6065"), ("write", "0", "6065", "7"), ("save", "0")):
        code, refused = desk(*command)
        assert (code, refused["diagnostics"][0]["code"]) == (1, "MC560")
        assert "mcctl sdo" in refused["diagnostics"][0]["hint"]
    assert drives[3].written == before


def test_process_data_of_a_drive_are_no_master(desk: Desk) -> None:
    drives = desk.make_drives(3)
    stopping = threading.Event()

    def babble() -> None:
        while not stopping.wait(0.005):
            drives.send(Function.TPDO1 + 3, b"\x40\x02")

    thread = threading.Thread(target=babble)
    thread.start()
    try:
        with at_desk(settings_of(load_machine(desk.file))[0]) as desk:
            assert desk.read_number(0x1000) is not None
    finally:
        stopping.set()
        thread.join()


def test_sync_by_agreement_is_no_master(tmp_path: Path, hub: RunningHub, make_drives: Make) -> None:
    drives = make_drives(3)
    file = Path(machine_file(tmp_path, hub))
    file.write_text(file.read_text().replace('name = "left"', 'name = "left"\nsync = "foreign"'))
    with at_desk(settings_of(load_machine(str(file)))[0]) as desk:
        drives.send(SYNC, b"")
        assert desk.read_number(0x1000) is not None
        assert desk.read_number(0x1000) is not None


def test_a_master_that_comes_ends_the_desk(desk: Desk) -> None:
    drives = desk.make_drives(3)
    dictionary = generic_dictionary(3)
    window = find(parameters_of(dictionary), dictionary, "6065")
    with at_desk(settings_of(load_machine(desk.file))[0]) as desk:
        desk.read(window)
        drives.send(SYNC, b"")
        # frames come in order: once this answer is there, so is the SYNC
        with pytest.raises(RuntimeFault, match=r"MC560: another master came to bus left: SYNC"):
            desk.read(window)
        with pytest.raises(RuntimeFault, match="MC560"):
            desk.write(window, 7)
    assert drives[3].written == []


def test_an_abort_is_named_with_its_remedy(desk: Desk) -> None:
    desk.make_drives(3)[3].aborts[WINDOW] = 0x0800_0022
    code, refused = desk("write", "0", "6065", "7")
    (shown,) = refused["diagnostics"]
    assert (code, shown["code"]) == (1, "MC553")
    assert "0800 0022h" in shown["message"]
    assert shown["hint"]


def test_a_drive_that_rounds_a_value_is_no_success(desk: Desk) -> None:
    dictionary = generic_dictionary(3)
    window = find(parameters_of(dictionary), dictionary, "6065")
    drives = desk.make_drives(3)
    with at_desk(settings_of(load_machine(desk.file))[0]) as desk:
        desk.write(window, 7)
        drives[3].kept = {WINDOW}
        with pytest.raises(DriveError, match=r"MC559.*holds 7 after 9 was written"):
            desk.write(window, 9)


def test_a_length_that_is_not_that_of_the_eds_gives_bytes(desk: Desk) -> None:
    dictionary = generic_dictionary(3)
    window = find(parameters_of(dictionary), dictionary, "6065")
    desk.make_drives(3)[3].objects[WINDOW] = b"\x01\x02"
    with at_desk(settings_of(load_machine(desk.file))[0]) as desk:
        reading = desk.read(window)
    assert (reading.kind, reading.value) == ("bytes", "01 02")


def test_a_stopped_or_missing_node_is_named(desk: Desk) -> None:
    desk.make_drives(4)[4].state = NmtState.STOPPED
    assert desk.refusal("read", "0", "6065") == (1, "MC554")


def test_an_axis_without_a_drive_is_refused_with_those_that_have_one(desk: Desk) -> None:
    for machine, axis in ((desk.file, "7"), ("cartesian", "0")):
        code, refused = desk("read", axis, "6065", file=machine)
        assert (code, refused["diagnostics"][0]["code"]) == (2, "MC559")


def test_a_slave_that_is_not_ours_is_read_and_written_by_the_names_of_its_eds(desk: Desk) -> None:
    (desk.folder / "drive.eds").write_bytes(SHIPPED_EDS.read_bytes())
    desk.describe(keys='eds = "drive.eds"')
    slave = LocalDrive(desk.hub, SHIPPED_EDS.read_text(), 3).start()
    try:
        code, wrote = desk("write", "0", "encoder increments", "8192")
        assert (code, wrote["values"][0]["value"]) == (0, 8192)
        assert slave.written == [(0x608F, 1, (8192).to_bytes(4, "little"))]
        code, read = desk("read", "0", "608F:1", "manufacturer device name")
        assert [each["value"] for each in read["values"]] == [8192, "Simulated servo drive"]
    finally:
        slave.close()
