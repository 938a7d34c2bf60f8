"""``mcserver view``: a program simulated, or a recording, played in three dimensions in a browser."""

from __future__ import annotations

import asyncio
import os
import tempfile
from typing import Annotated

import typer

from mcserver.cli.console import json_answer_on_error, narration, show_diagnostics, write_json
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import DEFAULT_MACHINE, HostOption, JsonOption, MachineOption, PortOption
from mcserver.cli.program_text import load_program
from mcserver.cli.recorded import OpenedRecording, is_recording_name, open_recording
from mcserver.cli.rejection import reject
from mcserver.cli.serving import announcing, require_packages
from mcserver.cli.simulate import live_progress
from mcserver.cli.simulation_report import diagnostics_of
from mcserver.errors import UsageFault
from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.view.stage import Up


def view(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE", help="A G-code program to simulate and play, or a recording (.mcap, .npz)."
        ),
    ],
    machine: MachineOption = DEFAULT_MACHINE,
    host: HostOption = "127.0.0.1",
    port: PortOption = 8080,
    up: Annotated[Up, typer.Option("--up", help="Which way is up.")] = Up.AUTO,
    json: JsonOption = False,
) -> None:
    """Play a program, simulated, or a recording in a browser. `mcserver web` shows a running server."""
    with json_answer_on_error(json):
        require_packages("view", "web", ("nicegui", "mcclient"))
        opened, zeros = (
            (open_recording(file, machine), {})
            if is_recording_name(file)
            else _simulated(file, machine, json)
        )
        recorded = [int(axis) for axis in opened.run.cycles.axes]
        if recorded != [axis.index for axis in opened.machine.axes]:
            raise UsageFault(
                "MC017",
                f"{file} has the axes {recorded}, which are not those of {opened.machine.name}",
                "name the machine of the recording with --machine",
            )
        with tempfile.TemporaryDirectory() as folder:
            # before NiceGUI is imported: it would keep its own state in the working folder
            os.environ.setdefault("NICEGUI_STORAGE_PATH", folder)
            from mcserver.doors.listening import Address
            from mcserver.web.replay import replay_of
            from mcserver.web.viewer import model_of, serve_view

            run = opened.run
            replay = replay_of(run.cycles, opened.machine, opened.kinematics, run.text, zeros)
            model, missing = model_of(opened.machine, replay, up)
            if missing:
                narration().print(
                    f"{len(missing)} meshes were not found, such as {missing[0]}: their links are bones"
                )
            name = f"{run.name} on {opened.machine.name}"
            asyncio.run(
                serve_view(name, replay, model, Address(host, port, on_ready=announcing(name, json=json)))
            )


def _simulated(file: str, machine: str, json: bool) -> tuple[OpenedRecording, dict[str, list[float]]]:
    """Return the recording of a program's simulation, and the zeros that it has set."""
    from mcserver.recorder.reading import RecordedRun
    from mcserver.simulation.simulation import simulate
    from mcserver.view.zeros import work_zeros

    described = load_machine(machine)
    kinematics = build_kinematics(described)
    program = load_program(file)
    if program.faults:
        if json:
            write_json({"ok": False, "diagnostics": [each.as_json() for each in program.faults]})
        reject(program.faults, program.lines, program.name)
    with live_progress() as progress:
        simulation = simulate(program.text, described, kinematics=kinematics, progress=progress, record=True)
    diagnostics = diagnostics_of(simulation.report)
    recording = simulation.recording
    if simulation.exit_code == ExitCode.REJECTED or recording is None or not len(recording.time_s):
        if json:
            write_json({"ok": False, "diagnostics": simulation.report["diagnostics"]})
        reject(diagnostics, program.lines, program.name)
    show_diagnostics(diagnostics, program.lines, program.name)
    text = dict(enumerate(program.lines, 1))
    run = RecordedRun(program.name, recording, 0.0, described, [], [], text)
    offsets = simulation.report.get("work_offsets", ()) if not described.tools else ()
    zeros = work_zeros({each["system"]: each["origin"] for each in offsets})
    return OpenedRecording(run, described, kinematics), zeros
