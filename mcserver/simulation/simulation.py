"""A program run by the server's own code on a virtual clock: what ``mcserver simulate`` and dry runs do."""

from __future__ import annotations

from typing import Any, Unpack

from mcserver.errors import ConfigurationError, Diagnostic
from mcserver.gcode.program_check import check_lines
from mcserver.gcode.text.source import LineSource, split_lines
from mcserver.machine.machine_file import Machine
from mcserver.planning.start_state import StartState
from mcserver.planning.unhomed import machine_for
from mcserver.simulation.assertions import check_assertions
from mcserver.simulation.difference import CycleKeeper, difference_from
from mcserver.simulation.line_times import LineTimes
from mcserver.simulation.path_sampler import PathSampler
from mcserver.simulation.run import Conditions, Run, axis_report, solver_of
from mcserver.simulation.run import Simulation as Simulation
from mcserver.simulation.starting_machine import starting_at
from mcserver.simulation.tool_poses import ToolPoses


def simulate(text: str, machine: Machine, **given: Unpack[Conditions]) -> Simulation:
    """Check the program, then run it.

    Returns:
        The report; a program with faults is rejected as a whole and nothing of it is simulated.
    """
    lines = split_lines(text)
    found = simulate_lines(lambda: iter(lines), machine, **given)
    found.report["lines"] = list(found.times.rows())
    return found


def simulate_lines(
    source: LineSource,
    machine: Machine,
    *,
    times: LineTimes | None = None,
    checked: bool = False,
    **given: Unpack[Conditions],
) -> Simulation:
    """Check a program, then run it, as `simulate` does, however long it is: it is read line by line.

    Args:
        source: is read twice, and a third time where a line of it fails.
        times: takes the times of its lines; None: keeps all of them. checked: the program has no faults.

    Raises:
        ConfigurationError: MC323 stops are to be judged, and the machine names no bodies.
        Refused: MC331 assertions name what the machine has not, or bound nothing; MC332 as `difference_from`.
    """
    if given.get("stops", False) and machine.clearance is None:
        raise ConfigurationError(
            "MC323", f"{machine.name} names no bodies, so stops cannot be judged", "add [clearance]"
        )
    kinematics, solver, described = given.get("kinematics"), solver_of(given), machine
    check_assertions(given.get("assertions", ()), machine, solver)
    start = given.get("start") or StartState.of(machine)
    machine = machine_for(starting_at(machine, start.positions), start.homed, moves_unhomed=False)
    if not checked:
        faults = check_lines(
            source(),
            machine,
            kinematics,
            frame=start.frame,
            lease=given.get("lease"),
            switches=start.switches,
        )
    else:
        faults = []
    if any(fault.severity == "error" for fault in faults):
        return Simulation(_rejected(machine, faults), 4)
    sampler = None
    if path_points := given.get("path_points", 0):
        sampler = PathSampler(machine, ToolPoses(machine, solver), path_points)
    if times is None:
        times = LineTimes(planning=bool(machine.tools))
    given = {**given, "start": start}
    against, kept = given.get("against"), CycleKeeper()
    if against is not None:
        given["takers"] = (*given.get("takers", ()), kept)
    found = Run(source, machine, given, sampler, times).run(faults)
    if sampler is not None:
        found.report["path"] = sampler.path()
    if against is not None and found.end is not None:
        found.report["difference"] = difference_from(
            against,
            kept,
            found.report["duration_s"],
            described,
            start=start,
            kinematics=kinematics,
            role=given.get("role"),
        )
    return found


def _rejected(machine: Machine, faults: list[Diagnostic]) -> dict[str, Any]:
    return {
        "ok": False,
        "duration_s": 0.0,
        "feed_length_mm": 0.0,
        "lines": [],
        "axes": {
            str(axis.index): axis_report(
                axis.type.unit, *([axis.initial_position / axis.type.si_per_unit] * 3)
            )
            for axis in machine.axes
        },
        "diagnostics": [fault.as_json() for fault in faults],
    }
