"""A booted machine whose nodes and bus do what they like."""

from __future__ import annotations

import threading
from collections.abc import Callable

from mcserver.can.cob import NMT, Function, NmtState
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.node import MAX_EMERGENCIES, Phase
from tests.canopen.fake_drives import FakeDrives
from tests.canopen.rig import BusCell, wait_until

Make = Callable[..., FakeDrives]


def test_a_node_that_reboots_is_configured_and_started_again(cell: BusCell) -> None:
    drives, service = cell.booted(1, 2)
    drives.reboot(2)
    rebooted = cell.watched.expect("drive.rebooted")
    assert (rebooted.axis, rebooted.code) == (1, "MC558")
    started = cell.watched.expect("drive.started")
    assert (started.axis, started.code) == (1, "")
    assert drives[2].state is NmtState.OPERATIONAL
    assert drives[2].value(0x1A00, 1) == 0x6041_0010
    assert service.nodes[1].phase is Phase.OPERATIONAL
    assert drives[1].resets == 1


def test_a_rebooted_node_gets_no_controlword(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    drives.reboot(1)
    cell.watched.expect("drive.started")
    assert [write for write in drives[1].written if write[0] == 0x6040] == []
    assert Function.RPDO1 + 1 not in drives.heard


def test_a_node_that_cannot_be_configured_again_is_tried_again(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    drives[1].aborts[0x6060, 0] = 0x0800_0022
    drives.reboot(1)
    failed = cell.watched.expect("drive.failed")
    assert failed.code == "MC553"
    assert "6060h:00" in failed.message
    assert "tried again in 1 s" in failed.message
    assert service.nodes[0].phase is Phase.FAILED
    del drives[1].aborts[0x6060, 0]
    cell.watched.expect("drive.started")
    assert drives[1].state is NmtState.OPERATIONAL
    assert service.nodes[0].failure == ""


def test_a_heartbeat_that_stays_out_is_reported_once_and_its_return_too(cell: BusCell) -> None:
    drives, service = cell.booted(1, 2)
    drives[1].muted = True
    lost = cell.watched.expect("drive.lost")
    assert (lost.axis, lost.code) == (0, "MC557")
    assert "no heartbeat for 0.5 s" in lost.message
    assert service.nodes[0].phase is Phase.LOST
    assert service.nodes[1].phase is Phase.OPERATIONAL
    drives[1].muted = False
    assert cell.watched.expect("drive.back").axis == 0
    assert service.nodes[0].phase is Phase.OPERATIONAL


def test_a_drive_that_was_switched_off_and_on_unheard_is_found_by_asking(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    drives[1].muted = True
    cell.watched.expect("drive.lost")
    drives[1].lose_configuration()
    drives[1].muted = False
    assert "without its configuration" in cell.watched.expect("drive.rebooted").message
    cell.watched.expect("drive.started")
    assert drives[1].state is NmtState.OPERATIONAL


def test_a_drive_that_only_stops_beating_is_left_alone(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    written = list(drives[1].written)
    drives[1].beats = False
    cell.watched.expect("drive.lost")
    requests = Function.SDO_REQUEST + 1
    asked = drives.heard[requests]
    wait_until(lambda: drives.heard[requests] >= asked + 2, "it was asked twice")
    assert drives[1].written == written
    assert service.nodes[0].phase is Phase.LOST
    drives[1].beats = True
    cell.watched.expect("drive.back")
    assert cell.watched.events.empty()


def test_a_node_that_another_master_stopped_is_started_again(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    drives[1].state = NmtState.PRE_OPERATIONAL
    assert "is pre-operational" in cell.watched.expect("drive.rebooted").message
    cell.watched.expect("drive.started")


def test_an_emergency_message_is_reported_in_words(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    drives.send(Function.EMCY + 1, bytes.fromhex("1186210000000000"))
    event = cell.watched.expect("drive.emergency")
    assert (event.axis, event.code) == (0, "MC556")
    assert "axis 0, node 1 on left: emergency 8611h following error" in event.message
    drives.send(Function.EMCY + 1, bytes(8))
    assert cell.watched.expect("drive.emergency").code == ""
    found = service.nodes[0].emergency
    assert found is not None
    assert found.cleared


def test_a_flood_of_emergencies_is_bounded_and_counted(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    for number in range(20 * MAX_EMERGENCIES):
        drives.send(Function.EMCY + 1, bytes.fromhex("118621") + number.to_bytes(5, "little"))
    while "more that are not shown" not in cell.watched.expect("drive.emergency").message:
        pass
    assert len(service.nodes[0].emergencies) <= MAX_EMERGENCIES


def test_malformed_frames_change_nothing(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    for identifier in (
        Function.HEARTBEAT + 1,
        Function.EMCY + 1,
        Function.SDO_RESPONSE + 1,
        Function.TPDO1 + 1,
        NMT,
    ):
        for length in range(9):
            if identifier == Function.HEARTBEAT + 1 and length == 1:
                continue
            if identifier == Function.EMCY + 1 and length == 8:
                continue
            drives.send(identifier, bytes(range(0xF8, 0xF8 + length)))
    drives.send(Function.HEARTBEAT + 1, b"\x33")
    # what is sent after them is still understood
    drives.send(Function.EMCY + 1, bytes.fromhex("5081000000000000"))
    assert "8150h" in cell.watched.expect("drive.emergency").message
    assert service.nodes[0].phase is Phase.OPERATIONAL
    sdo = service.nodes[0].sdo
    assert sdo is not None
    assert sdo.upload(0x1000, 0).hex() == "92010200"


def test_answers_that_nobody_asked_for_do_not_gather(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    sdo = service.nodes[0].sdo
    assert sdo is not None
    for _ in range(200):
        drives.send(Function.SDO_RESPONSE + 1, b"\x43\x00\x10\x00\x01\x02\x03\x04")
    drives.send(Function.EMCY + 1, bytes.fromhex("5081000000000000"))
    cell.watched.expect("drive.emergency")
    assert sdo.upload(0x1000, 0).hex() == "92010200"


def test_a_handler_that_raises_does_not_stop_the_bus(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    network: PortNetwork = service.buses[0]._network

    def broken(_payload: bytes) -> None:
        raise LookupError("a defect")

    network.handle(0x555, broken)
    drives.send(0x555, b"x")
    wait_until(lambda: network.failures == 1, "the handler was called")
    drives.send(Function.EMCY + 1, bytes.fromhex("5081000000000000"))
    cell.watched.expect("drive.emergency")


def test_a_bus_that_goes_and_comes_is_used_again(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    cell.hub.stop()
    assert cell.watched.expect("bus.lost").code == "MC424"
    cell.watched.expect("drive.lost")
    cell.hub.start()
    cell.watched.expect("bus.back")
    assert cell.watched.expect("drive.back").axis == 0
    sdo = service.nodes[0].sdo
    assert sdo is not None
    assert sdo.upload(0x6041, 0) == b"\x40\x00"
    assert drives[1].state is NmtState.OPERATIONAL


def test_a_drive_that_reboots_while_the_bus_is_away_is_configured_when_it_is_back(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    cell.hub.stop()
    cell.watched.expect("drive.lost")
    drives[1].lose_configuration()
    cell.hub.start()
    cell.watched.expect("drive.started")
    assert drives[1].state is NmtState.OPERATIONAL


def test_closing_while_the_bus_is_away_ends_soon(cell: BusCell) -> None:
    _, service = cell.booted(1)
    cell.hub.stop()
    cell.watched.expect("bus.lost")
    service.close()
    assert [each.name for each in threading.enumerate() if each.name.startswith("canopen")] == []


def test_closing_while_a_node_is_configured_again_ends_soon(cell: BusCell) -> None:
    drives, service = cell.booted(1)
    drives[1].unanswered[0x1600, 0] = 99
    drives.reboot(1)
    cell.watched.expect("drive.rebooted")
    service.close()
    assert [each.name for each in threading.enumerate() if each.name.startswith("canopen")] == []


def test_a_drive_without_heartbeat_is_watched_by_its_process_data(cell: BusCell) -> None:
    drives, service = cell.booted(1, keys="heartbeat_ms = 0")
    wait_until(lambda: drives[1].state is NmtState.OPERATIONAL, "operational")
    drives.send(Function.TPDO1 + 1, b"\x40\x02\x08\x00\x00\x00\x00")
    wait_until(lambda: service.nodes[0].exchanged_at is not None, "process data")
    # another master stops it: nothing says so
    drives[1].state = NmtState.STOPPED
    lost = cell.watched.expect("drive.lost")
    assert (lost.axis, lost.code) == (0, "MC557")
    assert "no process data for 1 s" in lost.message
    cell.watched.expect("drive.rebooted")
    cell.watched.expect("drive.started")
    wait_until(lambda: drives[1].state is NmtState.OPERATIONAL, "operational again")


def test_what_is_heard_of_a_drive_without_heartbeat_is_its_process_data(cell: BusCell) -> None:
    drives, service = cell.booted(1, keys="heartbeat_ms = 0")
    drives.send(Function.TPDO1 + 1, b"\x40\x02\x08\x00\x00\x00\x00")
    node = service.nodes[0]
    wait_until(lambda: node.exchanged_at is not None, "process data")
    assert node.heard_at == node.exchanged_at


def test_a_drive_without_heartbeat_is_configured_again_once_for_each_boot_up(cell: BusCell) -> None:
    drives, _ = cell.booted(1, keys="heartbeat_ms = 0")
    drives.reboot(1)
    cell.watched.expect("drive.rebooted")
    cell.watched.expect("drive.started")
    drives.send(Function.EMCY + 1, bytes.fromhex("5081000000000000"))
    cell.watched.expect("drive.emergency")
    drives.reboot(1)
    cell.watched.expect("drive.rebooted")
    cell.watched.expect("drive.started")
    assert cell.watched.events.empty()
    # nothing confirms the start without a heartbeat
    wait_until(lambda: drives[1].state is NmtState.OPERATIONAL, "operational")
