"""``mcserver simulate``: a program run by the server's own code on a virtual clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Annotated

import typer
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from mcserver.cli.console import json_answer_on_error, narration, show_diagnostics
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import (
    DEFAULT_MACHINE,
    BlockDeleteOption,
    JsonOption,
    MachineOption,
    OptionalStopOption,
    ProgramArgument,
    ZeroOption,
)
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.cli.planner_warm_up import prepare_planner_for
from mcserver.cli.program_file import read_program
from mcserver.cli.program_lines import keep_shown, program_lines
from mcserver.cli.rejection import reject
from mcserver.cli.simulation_report import (
    NOTHING_SIMULATED,
    diagnostics_of,
    print_report,
    shown_rows,
    write_report,
)
from mcserver.gcode.switches import Switches
from mcserver.gcode.text.source import decode
from mcserver.machine.clearance_section import RunRole
from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.planning.start_state import StartState
from mcserver.processes import collect_seldom
from mcserver.simulation.assertions import read_assertion
from mcserver.simulation.input_script import with_inputs
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.recording_file import write_csv, write_npz
from mcserver.simulation.tool_poses import ToolPoses
from mcserver.simulation.work_zero import with_zeros

OutputOption = Annotated[
    str | None,
    typer.Option(
        "--output", "-o", metavar="T.csv|.npz", help="Write one row a cycle: setpoints and encoders."
    ),
]


InputsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--input",
        metavar="NAME=VALUE@SECONDS",
        help="Set a simulated input: door=on@2.5; repeatable.",
    ),
]


StopsOption = Annotated[
    bool,
    typer.Option(
        "--stops",
        help="With [clearance]: judge wherever holds, overrides, aborts and emergency stops may bring "
        "the axes.",
    ),
]


RoleOption = Annotated[
    RunRole | None,
    typer.Option(
        "--role",
        help="Whose run it is to be: agent, one that a person approves, or operator, any other. Zones of the "
        "other do not count; without it all do.",
    ),
]


AssertOption = Annotated[
    list[str] | None,
    typer.Option(
        "--assert",
        metavar="WHAT",
        help="What the run has to keep to: 'end T3.X least=99 most=101', 'position Z most=50', "
        "'clearance least=5', 'duration most=60', 'speed X most=100', 'travel A most=0.1'; repeatable.",
    ),
]


AgainstOption = Annotated[
    str | None,
    typer.Option(
        "--against",
        metavar="FILE",
        help="Another program: say how its motion differs, by axis and tip, with line and time.",
    ),
]


def simulate_program(
    file: ProgramArgument,
    machine: MachineOption = DEFAULT_MACHINE,
    output: OutputOption = None,
    inputs: InputsOption = None,
    zero: ZeroOption = None,
    block_delete: BlockDeleteOption = False,
    optional_stop: OptionalStopOption = True,
    stops: StopsOption = False,
    role: RoleOption = None,
    assertions: AssertOption = None,
    against: AgainstOption = None,
    json: JsonOption = False,
) -> None:
    """Run a program on a virtual clock, by the same code as the server."""
    with ExitStack() as stack:
        with json_answer_on_error(json, NOTHING_SIMULATED):
            if output is not None:
                check_output(output, (".csv", ".npz"))
            described = with_zeros(with_inputs(load_machine(machine), inputs or ()), zero or ())
            program = stack.enter_context(program_lines(file))
            prepare_planner_for(program)
            from mcserver.simulation.simulation import simulate_lines

            kinematics = build_kinematics(described)
            collect_seldom()
            with live_progress() as progress:
                simulation = simulate_lines(
                    program.source,
                    described,
                    start=StartState.of(described, switches=Switches(block_delete, optional_stop)),
                    kinematics=kinematics,
                    progress=progress,
                    record=output is not None,
                    stops=stops,
                    role=role,
                    assertions=[read_assertion(each) for each in assertions or ()],
                    against=None if against is None else decode(read_program(against)),
                )
            if output is not None and simulation.recording is not None:
                poses = ToolPoses(described, kinematics)
                write_recording(output, simulation.recording.with_tools(described, poses))
        if json:
            write_report(simulation.report, simulation.times)
        diagnostics = diagnostics_of(simulation.report)
        keep_shown(program, diagnostics)
        if simulation.exit_code == ExitCode.REJECTED:
            reject(diagnostics, program, program.name)
        if not json:
            program.keep(each["line"] for each in shown_rows(simulation.times))
            print_report(simulation.report, simulation.times, program, program.name)
        show_diagnostics(diagnostics, program, program.name)
    if simulation.exit_code:
        raise typer.Exit(simulation.exit_code)


def write_recording(output: str, recording: Recorded) -> None:
    """The recording as the file's suffix says."""
    write = write_csv if output.lower().endswith(".csv") else write_npz
    write_atomically(output, lambda stream: write(recording, stream))
    narration().print(f"recorded {len(recording.time_s)} cycles: {output}")


@contextmanager
def live_progress() -> Iterator[Callable[[float, int], None] | None]:
    """A line on a terminal that shows the virtual time and the program's line; None where nobody looks."""
    console = narration()
    if not console.is_terminal:
        yield None
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("simulating …")

        def show(time_s: float, line: int) -> None:
            progress.update(task, description=f"line {line}, {time_s:.3f} s of machine time")

        yield show
