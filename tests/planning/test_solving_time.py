"""The time of inverse kinematics in the report of a simulation."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import simulate


def ticking() -> Callable[[], float]:
    """A clock on which everything lasts a quarter of a second."""
    ticks = count()
    return lambda: 0.25 * next(ticks)


def planning_times(program: str, machine: str = "robot-dog") -> dict[int, float]:
    described = load_machine(machine)
    simulation = simulate(program, described, kinematics=build_kinematics(described), clock=ticking())
    assert simulation.exit_code == 0, simulation.report["diagnostics"]
    return {line["line"]: line["planning_s"] for line in simulation.report["lines"]}


def test_each_path_that_is_solved_adds_to_its_line() -> None:
    two = "G01 T3 X-159 Y-400 Z400 G01 T6 X159 Y-400 Z400"
    assert planning_times(f"G1010\nG93 F60\n{two}\nG01 T3 Z300\n") == {3: 0.5, 4: 0.25}


def test_a_line_without_a_tool_takes_no_time_to_solve() -> None:
    program = "G1010\nG93 F60\nG01 [1]80\nG01 T3 V10\nG1050\nG04 P0.1\n"
    assert planning_times(program) == {3: 0.0, 4: 0.25, 6: 0.0}


def test_a_rapid_with_a_tool_is_solved_as_well() -> None:
    assert planning_times("G00 T3 Z10\n") == {1: 0.25}


def test_a_machine_without_tools_reports_no_planning_time() -> None:
    simulation = simulate("G1010\nG94 F600 G01 X1\n", load_machine("cartesian"))
    assert all("planning_s" not in line for line in simulation.report["lines"])
