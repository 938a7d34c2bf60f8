"""``mcserver plot``: simulate a program, or open a recording, and draw what it does."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer
from msgspec.structs import replace

from mcserver.cli.console import narration, show_diagnostics
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import DEFAULT_MACHINE, MachineOption, ZeroOption
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.cli.planner_warm_up import prepare_planner
from mcserver.cli.program_text import load_program
from mcserver.cli.recorded import is_recording_name, open_recording
from mcserver.cli.rejection import reject
from mcserver.cli.simulate import live_progress
from mcserver.cli.simulation_report import diagnostics_of
from mcserver.machine.clearance_section import GivenBody
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.work_zero import with_zeros

if TYPE_CHECKING:
    from mcserver.plot.scene import Scene


def plot(
    file: Annotated[
        str,
        typer.Argument(metavar="FILE", help="A G-code program to simulate, or a recording (.mcap, .npz)."),
    ],
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="P.png|.html", help="A picture, or a page to explore.")
    ],
    machine: MachineOption = DEFAULT_MACHINE,
    limits: Annotated[
        bool | None,
        typer.Option(
            "--limits/--no-limits",
            help="In a picture, scale each axis to its limits, or leave the axes out; "
            "without either they are scaled to the motion.",
        ),
    ] = None,
    zero: ZeroOption = None,
) -> None:
    """Draw what a program does, or what a recording holds: path, speed, errors, and each axis."""
    suffix = check_output(output, (".png", ".html"))
    if is_recording_name(file):
        from mcserver.plot.recorded_scene import recorded_scene

        opened = open_recording(file, machine)
        _draw(recorded_scene(opened.run, opened.machine, opened.kinematics), output, suffix, limits)
        return
    _draw_program(file, with_zeros(load_machine(machine), zero or ()), output, suffix, limits)


def _draw_program(file: str, described: Machine, output: str, suffix: str, limits: bool | None) -> None:
    program = load_program(file)
    if program.faults:
        reject(program.faults, program.lines, program.name)
    prepare_planner(len(program.lines))
    from mcserver.plot.scene import build_scene
    from mcserver.simulation.simulation import simulate

    kinematics = build_kinematics(described)
    with live_progress() as progress:
        simulation = simulate(program.text, described, kinematics=kinematics, progress=progress, record=True)
    diagnostics = diagnostics_of(simulation.report)
    if simulation.exit_code == ExitCode.REJECTED or simulation.recording is None:
        reject(diagnostics, program.lines, program.name)
    scene = build_scene(
        program.name,
        _with_bodies(described, simulation.bodies),
        simulation.recording,
        simulation.report,
        program.lines,
        kinematics,
    )
    _draw(scene, output, suffix, limits)
    show_diagnostics(diagnostics, program.lines, program.name)
    if simulation.exit_code:
        raise typer.Exit(simulation.exit_code)


def _with_bodies(machine: Machine, given: Sequence[GivenBody]) -> Machine:
    """Return a machine with the bodies that a program brings."""
    if machine.clearance is None or not given:
        return machine
    bodies = (*machine.clearance.bodies, *(each.body for each in given))
    return replace(machine, clearance=replace(machine.clearance, bodies=bodies))


def _draw(scene: Scene, output: str, suffix: str, limits: bool | None) -> None:
    if suffix == ".png":
        from mcserver.plot.figure import draw_png

        write_atomically(
            output,
            lambda stream: draw_png(scene, stream, axes=limits is not False, limits=bool(limits)),
        )
    else:
        from mcserver.plot.html import page_of

        page = page_of(scene).encode()
        write_atomically(output, lambda stream: stream.write(page))
    narration().print(f"drawn: {output}")
