"""CiA 402 and Servosila's drives beside each other on one bus."""

from __future__ import annotations

from mcserver.can.cob import SYNC
from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import AxisCondition
from mcserver.machine.machine_file import parse_machine
from mcserver.motion.canonical import AxisOperation
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.drives.can_rig import bus_in_memory
from tests.drives.fake_can import FakeBus, FakeDrive, FakeServosila
from tests.executor.rig import Program
from tests.machine_text import axes_text


def axis(index: int, kind: str, keys: str = "") -> str:
    return axes_text(
        [index],
        velocity=1000.0,
        acceleration=10_000.0,
        keys="max_following_error = 2.0\nunits_per_motor_rev = 10.0",
        drive=kind,
        drive_keys=f'bus = "can0"\nnode = {index + 1}\ncounts_per_motor_rev = 10000\n{keys}',
    )


class Mixed:
    """Axes 0 and 2 are CiA 402 drives, axis 1 is Servosila's."""

    def __init__(self) -> None:
        axes = axis(0, "cia402") + axis(1, "servosila", "codes = { off = 2 }") + axis(2, "cia402")
        described = parse_machine(f'[machine]\nname = "m"\ncycle_hz = 500.0\n{axes}')
        self.port = FakeBus()
        self.servo = [FakeDrive(self.port, node, 10 * node, described.cycle_s) for node in (1, 3)]
        self.streamed = FakeServosila(self.port, 2, 500.0)
        bus = bus_in_memory(described, self.port, range(3))
        self.executor = VirtualExecutor(described, buses=[bus])
        self.program = Program(self.executor.open_slot(0), 3)


def test_both_kinds_are_captured_where_they_are_and_hold() -> None:
    mixed = Mixed()
    mixed.program.capture()
    mixed.executor.step(30)
    feedback = mixed.executor.feedback
    assert feedback.condition.tolist() == [AxisCondition.HOLDING] * 3
    assert [round(1e6 * place) for place in feedback.actual] == [10, 500, 30]
    assert [drive.jumps for drive in mixed.servo] == [[0], [0]]
    assert mixed.streamed.commands[-1] == (0x30, 500.0)


def test_a_cycle_sends_one_frame_an_axis_and_sync_last() -> None:
    mixed = Mixed()
    mixed.program.capture()
    mixed.executor.step(30)
    before = len(mixed.port.sent)
    mixed.executor.step()
    assert [cob for cob, _ in mixed.port.sent[before:]] == [0x201, 0x203, 0x202, SYNC]


def test_a_fault_of_one_kind_leaves_axes_of_the_other_holding() -> None:
    mixed = Mixed()
    mixed.program.capture()
    mixed.executor.step(30)
    mixed.streamed.bits = 0x10
    mixed.executor.step(3)
    faults = [event for event in mixed.executor.events() if event.kind is EventKind.FAULT]
    assert [(event.code, event.axis) for event in faults] == [(FaultCode.DRIVE_FAULT, 1)]
    expected = [AxisCondition.HOLDING, AxisCondition.FAULT, AxisCondition.HOLDING]
    assert mixed.executor.feedback.condition.tolist() == expected
    mixed.executor.step(100)
    program = Program(mixed.executor.open_slot(0), 3)
    program.axis(AxisOperation.RESET, 0b010)
    program.capture(0b010)
    mixed.executor.step(60)
    assert mixed.executor.feedback.condition.tolist() == [AxisCondition.HOLDING] * 3
