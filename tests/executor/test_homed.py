"""What an axis may do before it is homed, references given and kept, and what loses them."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.process_start import StoredReference
from tests.executor.homing_cell import MM, SWITCH, Cell, machine


def test_a_program_may_not_move_an_axis_that_is_not_homed() -> None:
    cell = Cell(machine(("", SWITCH), ("", "")))
    program = cell.program()
    program.capture()
    program.move({1: 5 * MM}, 100)
    program.move({0: 5 * MM}, 100)
    program.finish()
    cell.run()
    assert cell.faults == [FaultCode.NOT_HOMED]
    assert cell.setpoints[-1] == pytest.approx([0.0, 5 * MM], abs=1e-6)


@pytest.mark.parametrize("command", ["rapid", "speed", "torque"])
def test_no_command_moves_an_unhomed_axis(command: str) -> None:
    cell = Cell(machine(("", SWITCH)))
    program = cell.program()
    getattr(program, command)({0: 0.01})
    program.finish()
    cell.run()
    assert cell.faults == [FaultCode.NOT_HOMED]
    assert cell.setpoints[-1][0] == 0.0


def test_an_axis_that_needs_no_homing_moves_without() -> None:
    cell = Cell(machine(("", SWITCH + "required = false")))
    program = cell.program()
    program.capture()
    program.move({0: 5 * MM}, 100)
    program.finish()
    cell.run()
    assert cell.faults == []


def test_soft_limits_count_from_the_reference_on() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -37.0]", SWITCH), travel=40.0))
    program = cell.program(unhomed=True)
    program.capture()
    program.move({0: 60 * MM}, 1000)
    program.finish()
    cell.run()
    assert cell.faults == []
    assert cell.setpoints[-1][0] == pytest.approx(60 * MM)
    cell.find_home(0)
    assert cell.faults == [FaultCode.SWITCH_NOT_FOUND]
    program = cell.program(unhomed=True)
    program.control(ControlKind.REFERENCE, axes=1, values=(0.0,))
    program.finish()
    cell.run()
    program = cell.program()
    program.capture()
    program.position[:] = cell.executor.executor.row.setpoint
    program.move({0: 60 * MM}, 1000)
    program.finish()
    cell.run()
    assert cell.faults[-1] == FaultCode.SOFT_LIMIT
    assert cell.setpoints[-1][0] <= 40.01 * MM + 1e-9


def test_a_reference_outside_the_travel_moves_nothing() -> None:
    cell = Cell(machine(("", 'method = "manual"'), travel=40.0))
    program = cell.program()
    program.capture()
    program.control(ControlKind.REFERENCE, axes=1, values=(55 * MM,))
    program.finish()
    cell.run()
    cell.step(20)
    assert cell.faults == []
    assert cell.setpoints[-1][0] == pytest.approx(55 * MM)
    assert np.ptp(np.array(cell.drive_setpoints)[:, 0]) < 1e-12


def test_a_reference_is_not_given_to_a_moving_axis() -> None:
    cell = Cell(machine(("", 'method = "manual"')))
    program = cell.program(unhomed=True)
    program.capture()
    program.speed({0: 0.02})
    program.dwell(0.1)
    program.control(ControlKind.REFERENCE, axes=1, values=(0.0,))
    program.finish()
    cell.step(200)
    cell.run()
    assert cell.faults == [FaultCode.REFERENCE_MOVING]
    assert not cell.homed & 1


def test_a_reference_needs_no_energy() -> None:
    cell = Cell(machine(("initial_position = 3.0", 'method = "manual"')))
    program = cell.program()
    program.control(ControlKind.REFERENCE, axes=1, values=(10 * MM,))
    program.finish()
    cell.run()
    assert cell.executor.feedback.actual[0] == pytest.approx(10 * MM)
    (homed,) = cell.of(EventKind.HOMED)
    assert homed.values == pytest.approx((7 * MM, 3 * MM))


@pytest.mark.parametrize("method", ["manual", "absolute"])
def test_a_lost_drive_is_unhomed_unless_its_encoder_is_absolute(method: str) -> None:
    cell = Cell(machine(("", f'method = "{method}"')), references={0: StoredReference(5 * MM, None)})
    program = cell.program()
    program.capture()
    program.dwell(5.0)
    program.finish()
    cell.step(100)
    assert cell.homed & 1
    cell.bus.silence(0)
    cell.run()
    assert FaultCode.DRIVE_SILENT in cell.faults
    assert bool(cell.homed & 1) == (method == "absolute")
    assert len(cell.of(EventKind.UNHOMED)) == (method == "manual")


def test_a_fault_that_leaves_the_encoder_alone_keeps_the_reference() -> None:
    cell = Cell(machine(("", 'method = "manual"')), references={0: StoredReference(5 * MM, None)})
    program = cell.program()
    program.capture()
    program.dwell(1.0)
    program.finish()
    cell.step(50)
    cell.bus.trip(0)
    cell.run()
    assert cell.homed & 1


def test_references_of_an_earlier_start_hold_where_the_encoder_reads_the_same() -> None:
    axes = [("initial_position = 3.0", 'method = "manual"')] * 3
    stored = {
        0: StoredReference(5 * MM, 3 * MM),
        1: StoredReference(5 * MM, 8 * MM),
        2: StoredReference(5 * MM, None),
    }
    cell = Cell(machine(*axes), references=stored)
    cell.step()
    assert cell.homed == 0b101
    assert cell.executor.feedback.actual == pytest.approx([8 * MM, 3 * MM, 8 * MM])


def test_a_machine_without_homing_sections_is_homed_and_limited() -> None:
    cell = Cell(machine(("", ""), travel=40.0))
    program = cell.program()
    program.capture()
    program.move({0: 60 * MM}, 1000)
    program.finish()
    cell.run()
    assert cell.homed == 1
    assert cell.faults == [FaultCode.SOFT_LIMIT]
