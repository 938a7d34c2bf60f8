"""Gantry pairs: one setpoint for two drives, their skew, and homing that squares them."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.drives.bus import DriveState
from mcserver.executor.entries import ControlKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.simulation.simulation import simulate_lines
from tests.executor.homing_cell import MM, SWITCH, Cell

AXIS = """
[[axis]]
index = {}
type = "linear"
max_velocity = 200.0
max_acceleration = 2000.0
max_jerk = 40000.0
{}
"""
TRAVEL = "min_position = -200.0\nmax_position = 200.0"
PAIR = "gantry = { leader = 1, max_skew = 0.5 }"


def gantry(leader: str = TRAVEL, follower: str = PAIR, more: str = "") -> Machine:
    """X, and Y with two drives."""
    axes = (AXIS.format(0, TRAVEL), AXIS.format(1, leader), AXIS.format(3, follower))
    return parse_machine("\n".join(('[machine]\nname = "portal"', *axes, more)))


def switched(left: float, right: float, *, then: str = "then_move_to = 10.0\n") -> Machine:
    """The same, whose sides have home switches at these places of their encoders [mm]."""
    homing = f"[axis.homing]\n{SWITCH}{then}travel = 120.0\nposition = {{}}\n"
    homing += "[axis.drive]\nhome_switch = [-1000.0, {}]"
    return gantry(f"{TRAVEL}\n{homing.format(0.0, left)}", f"{PAIR}\n{homing.format(0.2, right)}")


def moved(cell: Cell, *targets: float) -> None:
    """Energize Y, and let it go to these places [mm] one after the other."""
    program = cell.program()
    program.capture(0b010)
    for target in targets:
        program.control(ControlKind.RAPID, axes=0b010, values=(0.0, target * MM, 0.0))
        program.control(ControlKind.WAIT, axes=0b010)
    program.finish()


def skews(cell: Cell) -> np.ndarray:
    return np.abs(np.diff(np.array(cell.setpoints)[:, 1:], axis=1))[:, 0]


def test_both_drives_get_one_setpoint_and_are_switched_together() -> None:
    cell = Cell(gantry(follower=PAIR))
    moved(cell, 30.0, -20.0)
    cell.run()
    assert not cell.faults
    ends = np.array(cell.setpoints)[-1]
    assert ends[1] == ends[2] == pytest.approx(-20.0 * MM)
    assert skews(cell).max() == 0.0
    cell.check_limits()
    bank = cell.executor.executor.bank
    assert bank.energized == 0b110
    program = cell.program()
    program.control(ControlKind.AXIS, axes=0b010, operation=1)
    program.finish()
    cell.run()
    assert bank.energized == 0


def test_a_side_that_is_held_back_stops_both_drives_in_the_cycle_that_sees_it() -> None:
    cell = Cell(gantry())
    moved(cell, 100.0, 0.0)
    cell.step(200)
    cell.bus.jam(2)
    row, bank = cell.executor.executor.row, cell.executor.executor.bank
    apart = 0.0
    for _ in range(100):
        assert bank.energized == 0b110
        assert not cell.faults
        cell.step()
        apart = row.actual[1] - row.actual[2]
        if apart > 0.5 * MM:
            break
    # 200 mm/s are 0.2 mm a cycle
    assert apart < 0.71 * MM
    assert cell.faults == [FaultCode.SKEW]
    assert bank.energized == 0
    assert bank.stopping == 0b110
    cell.step(200)
    assert bank.stopping == 0
    # what the drive of the free side needs to rest, by its own quick stop: v² / 2a, and two cycles
    way = 0.2**2 / (2.0 * 2.0)
    assert row.actual[1] - row.actual[2] == pytest.approx(apart + way, abs=0.41 * MM)
    # sides with references that are apart are not held so, nor moved
    cell.bus.jam(2, jammed=False)
    moved(cell, 50.0)
    cell.run()
    assert cell.faults == [FaultCode.SKEW] * 2
    assert bank.energized == 0


@pytest.mark.parametrize("column", [1, 2])
def test_a_fault_of_one_drive_switches_both_off_at_once(column: int) -> None:
    cell = Cell(gantry())
    moved(cell, 100.0)
    cell.step(200)
    cell.bus.trip(column)
    cell.step(3)
    bank = cell.executor.executor.bank
    assert bank.energized == 0
    assert bank.fault == 1 << column
    assert DriveState.ENERGIZED not in bank.states[1:].tolist()
    cell.run()
    assert cell.faults == [FaultCode.OVER_TEMPERATURE]
    moved(cell, 0.0)
    cell.run()
    assert cell.faults[1:] == [FaultCode.AXIS_LATCHED]


def test_homing_squares_the_sides_each_by_its_own_switch() -> None:
    # as the encoders start the right side is 0.4 mm off, 0.2 mm of it by the place of its switch
    cell = Cell(switched(-40.0, -40.2))
    cell.find_home(1)
    assert not cell.faults
    assert cell.homed == 0b111
    # the edges by the encoders read 0 and 0.2
    assert cell.offset[1:] == pytest.approx([40.0, 40.4], abs=1e-6)
    assert np.array(cell.setpoints)[-1, 1:] == pytest.approx([10.0 * MM] * 2)
    cell.check_limits()
    # nowhere further apart than they were
    drives = np.array(cell.drive_setpoints)[:, 1:]
    assert np.abs(np.diff(drives, axis=1)).max() < 0.45 * MM
    moved(cell, 50.0)
    cell.run()
    assert not cell.faults
    assert skews(cell)[-100:].max() == 0.0


def test_without_a_place_to_go_to_the_sides_come_to_one_place() -> None:
    cell = Cell(switched(-40.0, -40.3, then=""))
    cell.find_home(1)
    assert not cell.faults
    assert skews(cell)[-1] == 0.0


def test_a_switch_that_does_not_come_does_not_bend_the_gantry() -> None:
    cell = Cell(switched(-40.0, -90.0))
    cell.find_home(1)
    assert cell.faults == [FaultCode.SKEW]
    drives = np.array(cell.drive_setpoints)[-1, 1:]
    # the limit, and the way in which the side comes to rest from latch_velocity
    assert abs(drives[1] - drives[0]) < 0.6 * MM
    cell.check_limits()


def test_programs_name_the_leader_alone_and_speeds_are_refused() -> None:
    found = simulate_lines(lambda: iter(["G1010", "G0 Y20", "G0 [3]10"]), gantry())
    (fault,) = found.report["diagnostics"]
    assert fault["code"] == "MC108"
    assert fault["message"] == "axis 3 is the second drive of axis 1, and moves with it"
    assert fault["hint"] == "name axis 1"
    found = simulate_lines(lambda: iter(["G1010", "G0 [9]10"]), gantry())
    assert "has no axis 9" in found.report["diagnostics"][0]["message"]
    found = simulate_lines(lambda: iter(["G1010", "G1 Y20 F3000", "G1030 Y10"]), gantry())
    assert [each["code"] for each in found.report["diagnostics"]] == ["MC469"]
    axes = found.report["axes"]
    assert axes["1"]["max"] == axes["3"]["max"] == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("leader", "follower", "code"),
    [
        (TRAVEL, "gantry = { leader = 7, max_skew = 0.5 }", "MC090"),
        (TRAVEL, "gantry = { leader = 3, max_skew = 0.5 }", "MC090"),
        (TRAVEL, PAIR + "\nmin_position = -5.0\nmax_position = 5.0", "MC090"),
        (TRAVEL, PAIR + "\ndrive = { initial_position = 1.0 }", "MC090"),
        (TRAVEL, PAIR + "\ntool_shapers.2 = { type = 'zv', frequency_hz = 20.0 }", "MC090"),
        (TRAVEL + f"\n[axis.homing]\n{SWITCH}", PAIR, "MC091"),
        (
            TRAVEL + f"\n[axis.homing]\n{SWITCH}",
            f"{PAIR}\n[axis.homing]\n{SWITCH}travel = 100.0\norder = 2",
            "MC091",
        ),
    ],
)
def test_a_pair_that_cannot_be_is_refused_with_its_place(leader: str, follower: str, code: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        gantry(leader, follower)
    assert code in str([each.code for each in refused.value.diagnostics])


@pytest.mark.parametrize(("left", "right"), [(2.0, -40.0), (-40.0, 2.0), (2.0, 1.8)])
def test_a_switch_that_is_active_at_the_start_is_left_within_the_skew(left: float, right: float) -> None:
    cell = Cell(switched(left, right))
    cell.find_home(1)
    drives = np.array(cell.drive_setpoints)[:, 1:]
    apart = np.abs(np.diff(drives, axis=1)).max()
    cell.check_limits()
    if left - right == pytest.approx(0.2):
        assert not cell.faults
        assert apart < 0.45 * MM
    else:
        # one that is active 42 mm before the other is no gantry that could be squared
        assert cell.faults == [FaultCode.SKEW]
        assert apart < 0.6 * MM


@pytest.mark.parametrize("end", ["estop", "stop"])
def test_what_moves_behind_its_program_comes_to_rest_with_both_drives(end: str) -> None:
    cell = Cell(gantry())
    program = cell.program()
    program.capture(0b010)
    program.control(ControlKind.RAPID, axes=0b010, values=(0.0, 150.0 * MM, 0.0))
    program.finish()
    cell.step(400)
    mailbox = cell.executor.mailbox
    if end == "estop":
        mailbox.emergency_stop()
    else:
        mailbox.stop()
    cell.run()
    assert skews(cell).max() == 0.0
    cell.check_limits()
    assert 10.0 * MM < np.array(cell.setpoints)[-1, 1] < 140.0 * MM
    cell.step(10)
    assert cell.executor.executor.bank.energized == (0 if end == "estop" else 0b110)


def test_sides_that_were_pushed_apart_come_to_no_motion_and_stay_where_they_are() -> None:
    cell = Cell(gantry())
    cell.step(5)
    cell.bus.push(2, 20.0 * MM)
    cell.step(100)
    cell.bus.push(2, 0.0)
    cell.step(50)
    before = np.array(cell.setpoints)[-1, 1:]
    assert before[1] - before[0] > 1.0 * MM
    moved(cell, 30.0)
    cell.run()
    assert cell.faults[0] == FaultCode.SKEW
    # they are held as far apart as they were, and have come to rest at once
    after = np.array(cell.setpoints)[-1, 1:]
    assert after == pytest.approx(before, abs=1e-5)
