"""Another master on the bus: listened for before anything is sent, and reported while it is there."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from mcserver.can.cob import Function, NmtState
from mcserver.can.port import EXTENDED
from mcserver.canopen.listening import Listening, refuse_other_masters, sign_of_master
from mcserver.errors import RuntimeFault
from tests.canopen.fake_drives import FakeDrives
from tests.canopen.rig import BusCell, Watched, machine_on
from tests.drives.fake_can import FakeBus

Make = Callable[..., FakeDrives]


def listening(port: FakeBus, *, foreign_sync: bool = False) -> Listening:
    return Listening("left", port, {3}, {0x205: 5, EXTENDED | 6: 6}, foreign_sync)


@pytest.mark.parametrize(
    ("identifier", "sign"),
    [
        (0x080, "SYNC (080h)"),
        (0x000, "NMT commands (000h)"),
        (0x77F, "the heartbeat of node 127 (77Fh)"),
        (0x603, "SDO requests to node 3 (603h)"),
        (0x203, "commands to node 3 (203h)"),
        (0x205, "commands to node 5 (205h)"),
        (0x183, "process data of node 3 (183h)"),
        (EXTENDED | 0x01800006, "commands to node 6 (01800006h)"),
    ],
)
def test_a_frame_of_a_master_at_work_refuses_the_start(identifier: int, sign: str) -> None:
    port = FakeBus()
    port.waiting.append((identifier, b"\x00"))
    with pytest.raises(RuntimeFault, match="MC560") as refused:
        refuse_other_masters([listening(port)], 0.01, wait=lambda _seconds: None)
    assert sign in refused.value.message
    assert "--take-over" in refused.value.hint
    assert port.sent == []


@pytest.mark.parametrize(
    "identifier", [0x703, 0x705, 0x083, 0x185, 0x285, 0x583, 0x7E4, EXTENDED | 0x028006FD, EXTENDED | 0x603]
)
def test_what_nodes_say_by_themselves_is_no_sign_of_a_master(identifier: int) -> None:
    assert sign_of_master(identifier, listening(FakeBus())) == ""


def test_a_foreign_sync_by_agreement_is_no_sign_of_a_master() -> None:
    assert sign_of_master(0x080, listening(FakeBus(), foreign_sync=True)) == ""


def test_a_server_does_not_reset_the_nodes_of_another_one(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    resets = drives[1].resets
    with pytest.raises(RuntimeFault, match=r"MC560.*bus left: the heartbeat of node 127"):
        Watched().start(machine_on(cell.hub.address(), [1]), listen_ms=20_000)
    assert drives[1].resets == resets
    assert drives[1].state is NmtState.OPERATIONAL


def test_to_take_over_resets_them_and_the_first_server_tells_of_the_second(cell: BusCell) -> None:
    drives, _ = cell.booted(1)
    other = Watched()
    other.start(machine_on(cell.hub.address(), [1]), listen_ms=50, take_over=True)
    try:
        assert drives[1].resets >= 2
        event = cell.watched.expect("bus.foreign_master")
        assert event.code == "MC560"
    finally:
        for service in other.services:
            service.close()


def test_a_silent_bus_is_taken(cell: BusCell) -> None:
    drives = cell.make_drives(1)
    drives.send(Function.HEARTBEAT + 1, bytes((NmtState.OPERATIONAL,)))
    cell.watched.start(machine_on(cell.hub.address(), [1]), listen_ms=50)
    assert drives[1].state is NmtState.OPERATIONAL
