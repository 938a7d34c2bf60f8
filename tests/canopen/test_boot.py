"""Boot-up of nodes: what they have afterwards, and what is said of those that fail."""

from __future__ import annotations

import threading
from collections.abc import Callable

import pytest
from msgspec.structs import replace

from mcserver.can.cob import Function, NmtState
from mcserver.canopen.canopen_errors import DriveError, Stopped
from mcserver.canopen.node import Phase
from mcserver.errors import RuntimeFault
from mcserver.machine.machine_file import Machine
from tests.canopen.fake_drives import PRODUCT, VENDOR, FakeDrives
from tests.canopen.rig import BusCell, RunningHub, Watched, machine_on, wait_until

Make = Callable[..., FakeDrives]


def test_several_nodes_are_configured_and_operational(cell: BusCell) -> None:
    drives, service = cell.booted(1, 2, 40)
    for node in (1, 2, 40):
        drive = drives[node]
        assert drive.state is NmtState.OPERATIONAL
        assert drive.value(0x1400, 1) == 0x200 + node
        assert drive.value(0x1A00, 1) == 0x6041_0010
        assert drive.value(0x60C2, 1) == 10
        assert drive.value(0x6060) == 8
        assert drive.value(0x1017) == 100
    assert [node.phase for node in service.nodes] == [Phase.OPERATIONAL] * 3
    assert [node.identity.vendor_id for node in service.nodes] == [VENDOR] * 3
    assert "3 drives are up" in cell.watched.sentences[-1]


def test_a_drive_is_never_sent_a_controlword(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    assert [write for write in drives[1].written if write[0] == 0x6040] == []
    assert Function.RPDO1 + 1 not in drives.heard


def test_two_buses_boot_side_by_side(cell: BusCell) -> None:
    left, right = cell.make_drives(1), cell.make_drives(1, channel="can1")
    text = machine_on(cell.hub.address(), [1])
    other = machine_on(cell.hub.address("can1"), [1])
    joined = _with_second_bus(text, other)
    service = cell.watched.start(joined)
    assert left[1].state is right[1].state is NmtState.OPERATIONAL
    assert [node.settings.bus for node in service.nodes] == ["left", "right"]


def _with_second_bus(first: Machine, second: Machine) -> Machine:
    bus = replace(second.buses[0], name="right")
    axis = replace(second.axes[0], index=1, drive=replace(second.axes[0].drive, bus="right"))
    return replace(first, buses=(*first.buses, bus), axes=(*first.axes, axis))


def test_a_master_s_heartbeat_is_there(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    heartbeat = Function.HEARTBEAT + 127
    before = drives.heard.get(heartbeat, 0)
    wait_until(lambda: drives.heard.get(heartbeat, 0) > before + 2, "three more heartbeats of the master")
    assert drives[1].value(0x1016, 1) == 127 << 16 | 1000


def test_an_abort_names_node_axis_object_and_code(cell: BusCell) -> None:
    drives = cell.make_drives(1, 2)
    drives[2].aborts[0x1600, 2] = 0x0604_0041
    with pytest.raises(RuntimeFault) as found:
        cell.start(1, 2)
    assert found.value.code == "MC553"
    assert found.value.axis == 1
    assert "axis 1, node 2 on left" in found.value.message
    assert "1600h:02" in found.value.message
    assert "0604 0041h" in found.value.message
    assert found.value.hint
    # the other drive is left without a watch on a master that goes
    wait_until(lambda: drives[1].state is NmtState.PRE_OPERATIONAL, "the other drive stopped")


def test_objects_that_a_drive_may_lack_are_remarked_only(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    for place in ((0x6007, 0), (0x1016, 1), (0x60C2, 1), (0x60C2, 2), (0x608F, 1), (0x1400, 5)):
        drives[1].aborts[place] = 0x0602_0000
    service = cell.start(1)
    assert drives[1].state is NmtState.OPERATIONAL
    assert len(service.nodes[0].remarks) == 6
    assert "6007h:00 is not there" in cell.watched.sentences[-1]


def test_a_drive_that_stays_pre_operational_with_a_fault_is_reset_by_sdo(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    drives[1].fault = "clears"
    service = cell.start(1)
    assert drives[1].state is NmtState.OPERATIONAL
    assert service.nodes[0].remarks == ("its fault was reset by SDO (6040h)",)
    assert [write for write in drives[1].written if write[0] == 0x6040][-1][2] == b"\x00\x00"


def test_a_drive_that_falls_back_with_a_fault_while_it_runs_is_brought_back(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    drives[1].fault = "clears"
    drives[1].state = NmtState.PRE_OPERATIONAL
    cell.watched.expect("drive.started")
    assert drives[1].state is NmtState.OPERATIONAL


def test_a_fault_that_stays_is_named_with_what_to_do(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    drives[1].fault = "stays"
    drives[1].emergency = bytes((0x10, 0x23, 2, 0, 0, 0, 0, 0))
    with pytest.raises(
        DriveError, match=r"MC555.*pre-operational; its fault stays after a reset by SDO"
    ) as found:
        cell.start(1)
    assert "2310h" in found.value.message
    assert "G1000" in found.value.hint


def test_a_device_without_heartbeat_and_without_eds_needs_none(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    drives[1].aborts[0x1017, 0] = 0x0602_0000
    cell.start(1, keys="heartbeat_ms = 0")
    wait_until(lambda: drives[1].state is NmtState.OPERATIONAL, "the drive operational")


def test_a_device_without_heartbeat_of_which_one_is_wanted_is_refused_with_the_key_to_change(
    cell: BusCell,
) -> None:
    cell.make_drives(1)[1].aborts[0x1017, 0] = 0x0602_0000
    with pytest.raises(DriveError, match=r"MC553.*1017h:00.*heartbeat") as found:
        cell.start(1)
    assert "heartbeat_ms = 0" in found.value.hint


def test_how_long_a_node_may_take_to_appear_is_a_key_of_its_bus(cell: BusCell) -> None:
    cell.make_drives(1)
    with pytest.raises(DriveError, match=r"MC550.*within 0\.2 s"):
        cell.watched.start(machine_on(cell.hub.address(), [9]), appear_timeout_s=0.2)


def test_a_lost_answer_is_asked_for_again(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    drives[1].unanswered[0x1600, 1] = 1
    cell.start(1)
    assert drives[1].state is NmtState.OPERATIONAL


def test_an_object_that_never_answers_is_named(cell: BusCell) -> None:
    cell.make_drives(1)[1].unanswered[0x1601, 0] = 99
    with pytest.raises(DriveError, match=r"MC554: axis 0, node 1 on left: 1601h:00 .* cannot be read back"):
        cell.start(1)


def test_a_missing_node_is_named_with_the_remedy(cell: BusCell) -> None:
    cell.make_drives(1)
    with pytest.raises(DriveError, match=r"MC550: axis 1, node 9 on left: does not answer.*power"):
        cell.start(1, 9)


def test_all_that_fail_are_reported_at_once(cell: BusCell) -> None:
    drives = cell.make_drives(1, 2)
    drives[1].aborts[0x6060, 0] = 0x0800_0022
    drives[2].objects[0x1000, 0] = b"\x91\x01\x00\x00"
    drives[2].boots = False
    drives[2].lose_configuration = lambda: None  # type: ignore[method-assign]
    with pytest.raises(DriveError, match=r"(?s)MC553: axis 0.*also MC551: axis 1, node 2"):
        cell.start(1, 2)


@pytest.mark.parametrize(
    ("keys", "shown"),
    [
        (f"vendor_id = {VENDOR + 1}", "1018h:01 says 0x00001234, the machine file vendor_id = 0x00001235"),
        (f"product_code = {PRODUCT + 1}", "1018h:02"),
    ],
)
def test_another_maker_s_drive_is_refused_before_anything_is_written(
    cell: BusCell, keys: str, shown: str
) -> None:
    drives = cell.make_drives(1)
    with pytest.raises(DriveError) as found:
        cell.watched.start(machine_on(cell.hub.address(), [1], keys))
    assert found.value.code == "MC551"
    assert shown in found.value.message
    assert drives[1].written == []


def test_the_right_identity_is_taken(cell: BusCell) -> None:
    drives, _ = cell.booted(1, keys=f"vendor_id = {VENDOR}\nproduct_code = {PRODUCT}")
    assert drives[1].written
    assert drives[1].state is NmtState.OPERATIONAL


def test_a_device_that_is_no_drive_is_refused(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    drives[1].lose_configuration = lambda: None  # type: ignore[method-assign]
    drives[1].objects[0x1000, 0] = b"\x91\x01\x00\x00"
    with pytest.raises(DriveError, match=r"MC551.*a CiA 401 module .inputs and outputs., not a drive"):
        cell.start(1)


def test_a_node_that_comes_late_is_waited_for(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    drives[1].muted = True

    def come() -> None:
        drives[1].muted = False
        drives.reboot(1)

    timer = threading.Timer(0.8, come)
    timer.start()
    cell.start(1)
    timer.join()
    assert drives[1].state is NmtState.OPERATIONAL


def test_a_node_without_boot_up_message_is_found_by_sdo(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    drives[1].boots = False
    cell.start(1)
    assert drives[1].state is NmtState.OPERATIONAL


def test_a_node_that_does_not_start_is_reported(cell: BusCell) -> None:
    cell.make_drives(1)[1].starts = False
    with pytest.raises(DriveError, match=r"MC555: axis 0, node 1 on left: .*pre-operational"):
        cell.start(1)


def test_the_emergency_that_explains_it_is_named(cell: BusCell) -> None:
    drive = cell.make_drives(1)[1]
    drive.starts = False
    drive.emergency = bytes.fromhex("2031040000000000")
    with pytest.raises(DriveError, match=r"MC555: .*pre-operational; it sent the emergency 3120h"):
        cell.start(1)


def test_a_bus_that_is_not_there_is_reported(watched: Watched) -> None:
    with pytest.raises(RuntimeFault, match="MC424"):
        watched.start(machine_on("socketcand:127.0.0.1:9/can0", [1]))


def test_a_stop_ends_the_waiting_for_nodes(hub: RunningHub, watched: Watched) -> None:
    asked = threading.Event()
    machine = machine_on(hub.address(), [1])

    def stopping() -> bool:
        asked.set()
        return True

    with pytest.raises(Stopped):
        watched.start(machine, stopping)
    assert asked.is_set()
    assert [each.name for each in threading.enumerate() if each.name.startswith("canopen")] == []


def test_closing_takes_drives_out_of_operation_and_leaves_no_thread(cell: BusCell) -> None:
    drives, service = cell.booted(1, 2)
    service.close()
    service.close()
    wait_until(
        lambda: all(drives[node].state is NmtState.PRE_OPERATIONAL for node in (1, 2)), "pre-operational"
    )
    # the end of the master's heartbeat is no fault of theirs
    assert drives[1].value(0x1016, 1) == 0
    assert [each.name for each in threading.enumerate() if each.name.startswith("canopen")] == []


def test_telemetry_is_all_that_a_servosila_drive_needs(cell: BusCell) -> None:
    drives = cell.make_drives()
    talking = threading.Event()

    def talk() -> None:
        while not talking.wait(0.05):
            drives.send(Function.TPDO1 + 7, bytes(8))

    thread = threading.Thread(target=talk)
    thread.start()
    try:
        service = cell.watched.start(
            machine_on(cell.hub.address(), [7], "codes = { off = 5 }\npole_pairs = 4", kind="servosila")
        )
        assert service.nodes[0].phase is Phase.OPERATIONAL
        assert Function.SDO_REQUEST + 7 not in drives.heard
        assert 0 not in drives.heard
    finally:
        talking.set()
        thread.join()
    assert cell.watched.expect("drive.lost").axis == 0
