"""``mcserver simulate``: a program run by the server's own code on a virtual clock."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated

import typer
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from mcserver.cli.console import json_answer_on_error, narration, show_diagnostics, write_json
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import DEFAULT_MACHINE, JsonOption, MachineOption, ProgramArgument, ZeroOption
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.cli.planner_warm_up import prepare_planner
from mcserver.cli.program_text import load_program
from mcserver.cli.rejection import reject
from mcserver.cli.simulation_report import NOTHING_SIMULATED, diagnostics_of, print_report
from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.processes import freeze_heap
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


def simulate_program(
    file: ProgramArgument,
    machine: MachineOption = DEFAULT_MACHINE,
    output: OutputOption = None,
    inputs: InputsOption = None,
    zero: ZeroOption = None,
    json: JsonOption = False,
) -> None:
    """Run a program on a virtual clock, by the same code as the server."""
    with json_answer_on_error(json, NOTHING_SIMULATED):
        if output is not None:
            check_output(output, (".csv", ".npz"))
        described = with_zeros(with_inputs(load_machine(machine), inputs or ()), zero or ())
        program = load_program(file)
        if program.faults:
            if json:
                write_json({**NOTHING_SIMULATED, "diagnostics": [each.as_json() for each in program.faults]})
            reject(program.faults, program)
        prepare_planner(len(program.lines))
        from mcserver.simulation.simulation import simulate

        kinematics = build_kinematics(described)
        freeze_heap()
        with live_progress() as progress:
            simulation = simulate(
                program.text,
                described,
                kinematics=kinematics,
                progress=progress,
                record=output is not None,
            )
        if output is not None and simulation.recording is not None:
            poses = ToolPoses(described, kinematics)
            write_recording(output, simulation.recording.with_tools(described, poses))
    if json:
        write_json(simulation.report)
    diagnostics = diagnostics_of(simulation.report)
    if simulation.exit_code == ExitCode.REJECTED:
        reject(diagnostics, program)
    if not json:
        print_report(simulation.report, program.lines, program.name)
    show_diagnostics(diagnostics, program.lines, program.name)
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
