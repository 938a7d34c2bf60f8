"""Homing in the cycle, on simulated drives with switches, indices and hard stops."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.entries import EventKind, HomingPhase
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import AxisCondition, SlotState
from tests.executor.homing_cell import MM, SWITCH, Cell, machine


def test_a_switch_is_found_fast_and_latched_slowly_where_it_lies() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -37.125]", SWITCH + "position = 5.0")))
    cell.find_home(0)
    assert cell.faults == []
    assert cell.phases() == [
        HomingPhase.APPROACH,
        HomingPhase.BACK_OFF,
        HomingPhase.LATCH,
        HomingPhase.REFERENCE,
        HomingPhase.DONE,
    ]
    # the edge at -37.125 by the encoder reads 5
    assert cell.offset[0] == pytest.approx(42.125, abs=1e-9)
    assert cell.homed & 1
    cell.check_limits()
    errors = np.abs(np.array(cell.errors))
    assert errors.max() < 0.1 * MM


def test_nothing_jumps_in_the_cycle_of_the_reference() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -20.0]", SWITCH + "position = 80.0\nthen_move_to = 60.0")))
    cell.find_home(0)
    cell.check_limits()
    positions = np.array(cell.setpoints)[:, 0]
    # by the axis itself there is one jump, as long as the offset
    jumps = np.nonzero(np.abs(np.diff(positions)) > 1 * MM)[0]
    assert len(jumps) == 1
    assert cell.setpoints[-1][0] == pytest.approx(60 * MM)
    errors = np.array(cell.errors)[:, 0]
    assert abs(errors[jumps[0] + 1] - errors[jumps[0]]) < 1e-6


AT_INPUT = '[[input]]\nnumber = 3\nname = "home"\n[[input]]\nnumber = 1\nname = "door"\n'


@pytest.mark.parametrize(
    ("drive", "homing", "offset"),
    [
        # towards positive
        ("home_switch = [42.0, 1000.0]", SWITCH + 'direction = "positive"\nposition = 90.0', 90.0 - 42.0),
        # a turn is 5 mm: indices at … -38.75, -33.75; away from the switch the next is -33.75
        ("home_switch = [-1000.0, -37.0]\nindex_at = 1.25", SWITCH + "index = true\nposition = 0.0", 33.75),
        # the index alone
        ("index_at = -3.0", 'method = "index"\nlatch_velocity = 5.0', 3.0),
        # nobody needs to set the input of a simulated axis with a switch
        ("home_switch = [-1000.0, -20.0]", SWITCH + "input = 3", 20.0),
    ],
)
def test_a_reference_is_exact(drive: str, homing: str, offset: float) -> None:
    cell = Cell(machine((drive, homing), more=AT_INPUT))
    cell.find_home(0)
    assert cell.faults == []
    assert cell.offset[0] == pytest.approx(offset, abs=1e-9)


def test_a_jerk_limit_holds_while_homing() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -20.0]", SWITCH), jerk="max_jerk = 20000.0\n"))
    cell.find_home(0)
    assert cell.offset[0] == pytest.approx(20.0, abs=1e-9)
    jerk = np.abs(np.diff(np.array(cell.drive_setpoints)[:, 0], 3)) / cell.machine.cycle_s**3
    assert jerk.max() <= 20.0 * (1 + 1e-3)


def test_a_switch_that_is_active_at_the_start_is_left_first() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, 4.0]", SWITCH)))
    cell.find_home(0)
    assert cell.phases()[:3] == [HomingPhase.RELEASE, HomingPhase.START, HomingPhase.APPROACH]
    assert cell.offset[0] == pytest.approx(-4.0, abs=1e-9)


def test_a_switch_without_a_latch_is_taken_between_two_readings() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -37.125]", SWITCH)))
    feedback = cell.bus.boot()
    original = cell.bus.exchange

    def exchange(setpoints):  # type: ignore[no-untyped-def]
        original(setpoints)
        feedback.switch_at[:] = np.nan
        return feedback

    cell.bus.exchange = exchange  # type: ignore[method-assign]
    cell.find_home(0)
    # at 2 mm/s a cycle is 2 µm long
    assert cell.offset[0] == pytest.approx(37.125, abs=1.001e-3)


def test_a_switch_at_an_input_is_found_where_the_input_changes() -> None:
    cell = Cell(machine(("", SWITCH + "input = 3"), more=AT_INPUT))
    column = [each.number for each in cell.machine.inputs].index(3)
    cell.home(0)
    for _ in range(60000):
        cell.executor.mailbox.set_input(column, float(cell.executor.executor.row.actual[0] < -20 * MM))
        cell.step()
        if cell.homed:
            break
    assert cell.faults == []
    # the input is seen in the cycle after: 4 µs at 2 mm/s
    assert cell.offset[0] == pytest.approx(20.0, abs=0.01)


def test_a_hard_stop_is_found_by_torque_and_left_again() -> None:
    homing = 'method = "hard-stop"\nvelocity = 20.0\nlatch_velocity = 5.0\nback_off = 4.0\ntorque = 3.0'
    cell = Cell(machine(("hard_stops = [-30.5, 70.0]", homing)))
    cell.find_home(0)
    assert cell.faults == []
    assert cell.offset[0] == pytest.approx(30.5, abs=1e-6)
    # off the stop at the end
    assert cell.setpoints[-1][0] == pytest.approx(4.0 * MM)
    cell.check_limits()


def test_the_drive_homes_itself_and_its_reading_counts() -> None:
    cell = Cell(machine(("initial_position = 12.0", 'method = "drive"')))
    cell.find_home(0)
    assert cell.faults == []
    assert cell.phases() == [HomingPhase.DRIVE, HomingPhase.HOLD, HomingPhase.DONE]
    assert cell.offset[0] == 0.0
    assert cell.homed & 1
    assert cell.executor.feedback.condition[0] == AxisCondition.HOLDING


def test_a_drive_that_homes_itself_is_stopped_by_an_abort() -> None:
    cell = Cell(machine(("initial_position = 12.0", 'method = "drive"')))
    cell.home(0)
    cell.run_to_phase(HomingPhase.DRIVE)
    cell.step(3)
    cell.executor.mailbox.abort(0)
    cell.run(200)
    cell.step(50)
    assert cell.executor.feedback.condition[0] == AxisCondition.OFF
    assert not cell.homed & 1


def test_axes_home_together() -> None:
    cell = Cell(
        machine(
            ("home_switch = [-1000.0, -10.0]", SWITCH),
            ("home_switch = [-1000.0, -30.0]", SWITCH + "position = 7.0"),
        )
    )
    cell.find_home(0, 1)
    assert cell.offset == pytest.approx([10.0, 37.0], abs=1e-9)
    done = {event.axis: event.time for event in cell.of(EventKind.HOMED)}
    assert done[1] - done[0] < 0.6


@pytest.mark.parametrize(
    ("drive", "homing", "code"),
    [
        ("", SWITCH, FaultCode.SWITCH_NOT_FOUND),
        ("home_switch = [-1000.0, 90.0]", SWITCH, FaultCode.SWITCH_STUCK),
        # wired the other way round: active everywhere but on the switch
        ("home_switch = [-1000.0, -20.0]", SWITCH + "invert = true", FaultCode.SWITCH_STUCK),
        ("home_switch = [-1000.0, -20.0]", SWITCH + "index = true", FaultCode.INDEX_NOT_FOUND),
        ("", 'method = "index"\ntravel = 5.0', FaultCode.INDEX_NOT_FOUND),
        ("", 'method = "hard-stop"\ntorque = 3.0\nvelocity = 50.0', FaultCode.STOP_NOT_FOUND),
        ("", 'method = "manual"', FaultCode.NO_HOMING),
        ("", "", FaultCode.NO_HOMING),
    ],
)
def test_what_is_not_found_is_a_fault_and_the_axis_stays_unhomed(
    drive: str, homing: str, code: FaultCode
) -> None:
    cell = Cell(machine((drive, homing)))
    cell.find_home(0)
    assert cell.faults == [code]
    assert not cell.homed & 1 or not homing
    assert cell.executor.feedback.slots[0].state is SlotState.FAULTED
    cell.check_limits()


def test_a_switch_that_stays_active_behind_the_back_off_is_a_fault() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -20.0]", SWITCH)))
    cell.home(0)
    cell.run_to_phase(HomingPhase.BACK_OFF)
    marks = cell.bus._marks
    marks._switch[:] = [[-1.0], [1.0]]
    cell.run()
    assert cell.faults == [FaultCode.SWITCH_STUCK]


@pytest.mark.parametrize("phase", [HomingPhase.APPROACH, HomingPhase.BACK_OFF, HomingPhase.LATCH])
def test_a_hold_stops_homing_and_a_resume_goes_on(phase: HomingPhase) -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -37.125]", SWITCH)))
    cell.home(0)
    cell.run_to_phase(phase)
    cell.step(30)
    cell.executor.mailbox.set_hold(True, 0)
    cell.step(200)
    assert cell.executor.feedback.slots[0].state is SlotState.HELD
    standing = cell.setpoints[-1][0]
    cell.step(50)
    assert cell.setpoints[-1][0] == standing
    cell.executor.mailbox.set_hold(False, 0)
    cell.run()
    assert cell.offset[0] == pytest.approx(37.125, abs=1e-9)
    cell.check_limits()


@pytest.mark.parametrize("how", ["abort", "stop", "estop"])
@pytest.mark.parametrize("phase", [HomingPhase.APPROACH, HomingPhase.BACK_OFF, HomingPhase.LATCH])
def test_a_stop_while_homing_keeps_the_limits_and_leaves_the_axis_unhomed(
    how: str, phase: HomingPhase
) -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -37.125]", SWITCH)))
    cell.home(0)
    cell.run_to_phase(phase)
    cell.step(20)
    mailbox = cell.executor.mailbox
    {"abort": lambda: mailbox.abort(0), "stop": mailbox.stop, "estop": mailbox.emergency_stop}[how]()
    cell.run(2000)
    cell.step(5)
    assert not cell.homed & 1
    assert cell.executor.feedback.slots[0].state in (SlotState.STOPPED, SlotState.FAULTED)
    cell.check_limits()


def test_homing_again_after_an_abort_finds_the_same_place() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -37.125]", SWITCH)))
    cell.home(0)
    cell.run_to_phase(HomingPhase.LATCH)
    cell.executor.mailbox.abort(0)
    cell.run()
    cell.find_home(0)
    assert cell.offset[0] == pytest.approx(37.125, abs=1e-9)


def test_a_drive_that_trips_while_homing_ends_it() -> None:
    cell = Cell(machine(("home_switch = [-1000.0, -37.125]", SWITCH)))
    cell.home(0)
    cell.run_to_phase(HomingPhase.APPROACH)
    cell.bus.trip(0)
    cell.run()
    assert cell.faults == [FaultCode.OVER_TEMPERATURE]
    assert not cell.homed & 1
