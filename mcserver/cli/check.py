"""``mcserver check``: every fault of a program, nothing run; where a machine has bodies what it hits, too."""

from __future__ import annotations

from contextlib import ExitStack

import msgspec
from mckinematics.pose import Kinematics

from mcserver.cli.console import json_answer_on_error, results, show_diagnostics, write_json
from mcserver.cli.options import (
    DEFAULT_MACHINE,
    BlockDeleteOption,
    JsonOption,
    MachineOption,
    OptionalStopOption,
    ProgramArgument,
    ZeroOption,
)
from mcserver.cli.program_lines import ProgramLines, keep_shown, program_lines
from mcserver.cli.rejection import reject
from mcserver.errors import Diagnostic
from mcserver.gcode.program_check import check_lines
from mcserver.gcode.switches import Switches
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.work_zero import with_zeros


def check(
    file: ProgramArgument,
    machine: MachineOption = DEFAULT_MACHINE,
    zero: ZeroOption = None,
    block_delete: BlockDeleteOption = False,
    optional_stop: OptionalStopOption = True,
    json: JsonOption = False,
) -> None:
    """Say every fault of a program; nothing is run. Exit code 4 where there is one.

    With [clearance] the setpoints are computed too, as `mcserver simulate` does, for what they touch.
    """
    with ExitStack() as stack:
        with json_answer_on_error(json):
            described = with_zeros(load_machine(machine), zero or ())
            program = stack.enter_context(program_lines(file))
            switches = Switches(block_delete, optional_stop)
            kinematics = build_kinematics(described)
            diagnostics = check_lines(
                program.source(), described, kinematics, at_rest=True, switches=switches
            )
            said = "no faults"
            if described.clearance is not None and all(each.severity != "error" for each in diagnostics):
                contacts = find_contacts(program, described, kinematics, switches)
                diagnostics += contacts
                # what has ended early may touch further on
                said += "" if contacts else " and no contacts"
        rejected = any(each.severity == "error" for each in diagnostics)
        if json:
            write_json({"ok": not rejected, "diagnostics": [each.as_json() for each in diagnostics]})
        keep_shown(program, diagnostics)
        if rejected:
            reject(diagnostics, program, program.name)
        show_diagnostics(diagnostics, program, program.name)
    if not json:
        results().print(f"{program.name}: {said} on machine {described.name}")


def find_contacts(
    program: ProgramLines, machine: Machine, kinematics: Kinematics | None, switches: Switches
) -> list[Diagnostic]:
    """Return what a program without faults touches, on the setpoints that would be played.

    Where its run ends earlier, as at an input that nobody sets, a warning says at which line and why.
    """
    from mcserver.cli.planner_warm_up import prepare_planner_for
    from mcserver.cli.simulate import live_progress
    from mcserver.cli.simulation_report import diagnostics_of
    from mcserver.planning.start_state import StartState
    from mcserver.processes import collect_seldom
    from mcserver.simulation.simulation import simulate_lines

    prepare_planner_for(program)
    collect_seldom()
    with live_progress() as progress:
        found = simulate_lines(
            program.source,
            machine,
            checked=True,
            start=StartState.of(machine, switches=switches),
            kinematics=kinematics,
            progress=progress,
        )
    return [each if each.code in _CONTACTS else _up_to(each) for each in diagnostics_of(found.report)]


_CONTACTS = frozenset({"MC320", "MC321", "MC322"})


def _up_to(fault: Diagnostic) -> Diagnostic:
    """Return what ended the run as a warning."""
    if fault.severity != "error":
        return fault
    return msgspec.structs.replace(
        fault,
        severity="warning",
        message=f"contacts were looked for up to here alone: {fault.message}",
        hint="give what it waits for: mcserver simulate --input",
    )
