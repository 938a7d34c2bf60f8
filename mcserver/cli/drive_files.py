"""``mcserver drives backup | compare | restore``: parameters of drives as files."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.text import Text

from mcserver.canopen import parameter_backup
from mcserver.canopen.parameter_file import (
    MAX_BYTES,
    ParameterFile,
    differences,
    read_parameters,
    write_parameters,
)
from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.drive_of_machine import AxisArgument, as_json, at_desk_of, described, table
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.errors import UsageFault


def backup(
    axis: AxisArgument,
    machine: MachineOption,
    output: Annotated[str, typer.Option("--output", "-o", metavar="FILE.toml", help="Where to.")],
    json: JsonOption = False,
) -> None:
    """Write the parameters that a drive keeps into a file, with its identity; the drive is only read."""
    with json_answer_on_error(json):
        check_output(output, (".toml",))
        file = _taken(machine, axis)
        text = write_parameters(file).encode()
        write_atomically(output, lambda stream: stream.write(text))
    if json:
        write_json({"ok": True, "parameters": len(file.parameters), "unread": file.unread})
    for each in file.unread:
        narration().print(f"not in the file: {each}")
    narration().print(f"{output}: {len(file.parameters)} parameters of axis {axis}")


def compare(
    left: Annotated[str, typer.Argument(metavar="LEFT", help="An axis, or a file of `backup`.")],
    right: Annotated[str, typer.Argument(metavar="RIGHT", help="An axis, or a file of `backup`.")],
    machine: MachineOption,
    json: JsonOption = False,
) -> None:
    """Compare the parameters of two drives, or of a drive and its file; exit code 1 where they differ."""
    with json_answer_on_error(json):
        sides = [_side(machine, each) for each in (left, right)]
    reason = sides[0].drive.difference(sides[1].drive)
    rows = differences(*sides)
    if json:
        titles = ("object", "name", "left", "right")
        found = [dict(zip(titles, row, strict=True)) for row in rows]
        write_json({"ok": True, "same": not rows, "identity": reason, "differences": found})
    elif rows:
        titled = [f"axis {side}" if side.isdecimal() else side for side in (left, right)]
        cells = [["–" if cell is None else str(cell) for cell in row] for row in rows]
        results().print(table(("object", "name", *titled), cells))
    if reason:
        narration().print(f"they are of different devices: {reason}")
    count = len({*sides[0].values, *sides[1].values})
    narration().print(f"{len(rows)} of {count} parameters differ")
    if rows:
        raise typer.Exit(int(ExitCode.FAILED))


def restore(
    axis: AxisArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Of `mcserver drives backup`.")],
    machine: MachineOption,
    json: JsonOption = False,
) -> None:
    """Write what differs from a file into a drive without energy, and verify every parameter."""
    with json_answer_on_error(json):
        drive = described(machine, axis)
        wanted = _read_file(file)
        if wanted.drive.eds_sha256 != drive.dictionary.sha256:
            narration().print("warning: the drive's EDS is another one than at the backup", style="yellow")
        with at_desk_of(drive.settings) as desk:
            written = parameter_backup.restore(
                desk,
                drive.parameters,
                wanted,
                lambda each, was, now: narration().print(Text(f"{each.title}: {was} → {now}")),
            )
    if json:
        write_json({"ok": True, "written": [as_json(each) for each in written]})
    narration().print(
        f"{len(written)} of {len(wanted.parameters)} parameters written, all verified; kept until the drive "
        f"is switched off: `mcserver drives save {axis}` stores them"
    )


def _side(machine: str, text: str) -> ParameterFile:
    return _taken(machine, int(text)) if text.isdecimal() else _read_file(Path(text))


def _taken(machine: str, axis: int) -> ParameterFile:
    drive = described(machine, axis)
    with at_desk_of(drive.settings) as desk:
        return parameter_backup.take_backup(
            desk,
            drive.parameters,
            datetime.now(UTC).isoformat(timespec="seconds"),
            drive.dictionary.sha256,
        )


def _read_file(path: Path) -> ParameterFile:
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise UsageFault(
            "MC565",
            f"{path} cannot be read: {error.strerror or error}",
            "give a file of `mcserver drives backup`",
        ) from error
    return read_parameters(raw, str(path))
