"""``mcserver check``: every fault of a program, nothing run."""

from __future__ import annotations

from contextlib import ExitStack

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
    """Say every fault of a program; nothing is run. Exit code 4 where there is one."""
    with ExitStack() as stack:
        with json_answer_on_error(json):
            described = with_zeros(load_machine(machine), zero or ())
            program = stack.enter_context(program_lines(file))
            diagnostics = find_faults(program, described, Switches(block_delete, optional_stop))
        rejected = any(each.severity == "error" for each in diagnostics)
        if json:
            write_json({"ok": not rejected, "diagnostics": [each.as_json() for each in diagnostics]})
        keep_shown(program, diagnostics)
        if rejected:
            reject(diagnostics, program, program.name)
        show_diagnostics(diagnostics, program, program.name)
    if not json:
        results().print(f"{program.name}: no faults on machine {described.name}")


def find_faults(program: ProgramLines, machine: Machine, switches: Switches) -> list[Diagnostic]:
    """Return all faults of a program on a machine, tools' paths included."""
    kinematics = build_kinematics(machine)
    return check_lines(program.source(), machine, kinematics, at_rest=True, switches=switches)
