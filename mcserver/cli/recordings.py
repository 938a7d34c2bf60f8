"""``mcserver recordings show | repair | export``: what is in a recording, files cut off, other programs."""

from __future__ import annotations

import enum
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.options import DEFAULT_MACHINE, JsonOption, MachineOption
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.cli.recorded import open_recording
from mcserver.cli.serving import require_packages
from mcserver.errors import UsageFault

FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="A recording.")]


def build_app() -> typer.Typer:
    """Return the sub-commands about recordings."""
    app = typer.Typer(help="Recordings: what is in them, repair, export.", no_args_is_help=True)

    @app.callback()
    def root() -> None:
        """Recordings: what is in them, repair, export."""

    app.command("show")(show)
    app.command("repair")(repair)
    app.command("export")(export)
    return app


def show(file: FileArgument, json: JsonOption = False) -> None:
    """Say what is in a recording: axes, time, lines, faults."""
    from mcserver.recorder.reading import read_recording

    with json_answer_on_error(json):
        run = read_recording(file)
    cycles = run.cycles
    duration_s = float(cycles.time_s[-1] - cycles.time_s[0])
    faults = [event for event in run.events if event.kind in ("fault", "estop")]
    found = {
        "file": str(file),
        "machine": None if run.machine is None else run.machine.name,
        "axes": [int(axis) for axis in cycles.axes],
        "start": run.start_unix,
        "duration_s": duration_s,
        "cycles": len(cycles.time_s),
        "lines": len(run.lines),
        "program_lines": len(run.text),
        "events": len(run.events),
        "faults": [each.fault.code if each.fault is not None else each.kind for each in faults],
    }
    if json:
        write_json({"ok": True, **found})
        return
    out = results()
    began = (
        datetime.fromtimestamp(run.start_unix, UTC).isoformat(" ", "milliseconds") if run.start_unix else ""
    )
    out.print(f"{file}: {found['machine'] or 'a machine'}, {duration_s:.3f} s {began}".rstrip())
    out.print(f"{len(cycles.axes)} axes, {len(cycles.time_s)} cycles, {len(run.lines)} lines ended")
    for event in faults:
        said = event.kind if event.fault is None else f"{event.fault.code} {event.fault.message}"
        out.print(f"at {event.t:.3f} s of the server: {said}")


def repair(
    file: FileArgument,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Where to; default: beside it, …-repaired.mcap."),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Copy what is whole of a recording that was cut off into a file that every program opens."""
    from mcserver.recorder import repair as repairing

    target = output or repairing.repaired_name(file)
    with json_answer_on_error(json):
        try:
            found = repairing.repair(file, target)
        except OSError as error:
            raise UsageFault(
                "MC581",
                f"{file} cannot be repaired: {error.strerror or error}",
                "is it there, and is there room?",
            ) from error
    if json:
        write_json({"ok": True, "output": str(target), "messages": found.messages, "whole": found.whole})
        return
    seconds = (found.end_ns - found.start_ns) * 1e-9
    state = "it was whole" if found.whole else "its end was missing"
    narration().print(f"{target}: {found.messages} messages, {seconds:.3f} s; {state}")


class Viewer(enum.Enum):
    """Whose channels an export has; Rerun reads those of Foxglove."""

    FOXGLOVE = "foxglove"


def export(
    file: FileArgument,
    _to: Annotated[Viewer, typer.Option("--to", help="Whose channels to add.")] = Viewer.FOXGLOVE,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Where to; default: beside it, …-foxglove.mcap."),
    ] = None,
    machine: MachineOption = DEFAULT_MACHINE,
    rate: Annotated[
        float, typer.Option("--rate", min=1.0, max=50.0, help="Frames and joints a second, at most.")
    ] = 25.0,
    json: JsonOption = False,
) -> None:
    """Copy a recording and add channels that Foxglove and Rerun show in space."""
    target = output or file.with_name(f"{file.stem}-foxglove.mcap")
    with json_answer_on_error(json):
        require_packages("recordings export", "foxglove", ("foxglove_schemas_protobuf", "trimesh"))
        from mcserver.foxglove import export as exporting

        check_output(str(target), (".mcap",))
        opened = open_recording(str(file), machine)
        added = write_atomically(
            str(target),
            lambda stream: exporting.export(
                opened.run, opened.machine, opened.kinematics, file, stream, rate
            ),
        )
    if json:
        write_json({"ok": True, "output": str(target), "added": added})
        return
    narration().print(f"{target}: {added} messages added")
