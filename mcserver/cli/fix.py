"""``mcserver fix`` and ``mcserver format``: a program's text made right where that is certain, and tidy."""

from __future__ import annotations

import difflib
import sys
from typing import Annotated

import typer

from mcserver.cli.console import (
    json_answer_on_error,
    narration,
    show_diagnostics,
    write_json,
    write_text,
)
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import DEFAULT_MACHINE, JsonOption, MachineOption, ProgramArgument
from mcserver.cli.output_file import write_atomically
from mcserver.cli.program_file import STDIN, read_program, shown_name
from mcserver.cli.rejection import count_faults
from mcserver.gcode.program_check import check_program
from mcserver.gcode.text.source import BOM, decode, split_lines
from mcserver.language.fix import fix_program, lines_with_ends
from mcserver.language.format import format_program
from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics

DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Show the difference and write nothing.")]
CheckOption = Annotated[
    bool, typer.Option("--check", help="Write nothing; exit code 1 if the file would change.")
]


def fix(
    file: ProgramArgument,
    machine: MachineOption = DEFAULT_MACHINE,
    dry_run: DryRunOption = False,
    json: JsonOption = False,
) -> None:
    """Apply the remedies that are certain and show the difference. Exit code 4 if faults remain."""
    with json_answer_on_error(json):
        described = load_machine(machine)
        kinematics = build_kinematics(described)
        raw = read_program(file)
        before = decode(raw)
    done = fix_program(before, lambda text: check_program(text, described, kinematics))
    if not dry_run:
        _write(file, raw, before, done.text)
    rejected = any(each.severity == "error" for each in done.remaining)
    if json:
        write_json(
            {
                "ok": not rejected,
                "applied": [each.as_json() for each in done.applied],
                "diff": _difference(before, done.text, file),
                "diagnostics": [each.as_json() for each in done.remaining],
            }
        )
    else:
        _show(file, _difference(before, done.text, file), dry_run=dry_run)
    show_diagnostics(done.remaining, split_lines(done.text), shown_name(file))
    if rejected:
        narration().print(count_faults(done.remaining, shown_name(file)), style="bold red")
        raise typer.Exit(int(ExitCode.REJECTED))


def format_file(file: ProgramArgument, check: CheckOption = False) -> None:
    """Format a program: blanks, capitals, two-digit codes, plain numbers. Faulty lines stay as they are."""
    raw = read_program(file)
    before = decode(raw)
    after = format_program(before)
    if check:
        if after != before:
            narration().print(f"{shown_name(file)} would be formatted anew")
            raise typer.Exit(int(ExitCode.FAILED))
        return
    _write(file, raw, before, after)


def _write(file: str, raw: bytes, before: str, after: str) -> None:
    """Write a file that has changed, with its byte order mark; standard input goes to standard output."""
    mark = BOM if raw.startswith(BOM.encode()) else ""
    if file == STDIN:
        sys.stdout.buffer.write((mark + after).encode())
        sys.stdout.flush()
    elif after != before:
        content = (mark + after).encode()
        write_atomically(file, lambda stream: stream.write(content))


def _show(file: str, difference: str, *, dry_run: bool) -> None:
    """Show the difference: as the result, or beside the program that standard output holds."""
    write_text(difference, sys.stderr if file == STDIN and not dry_run else sys.stdout)
    if not difference:
        narration().print(f"{shown_name(file)}: nothing to fix with certainty")


def _difference(before: str, after: str, file: str) -> str:
    """Write the unified difference of two texts."""
    name = shown_name(file)
    old, new = (["".join(pair) for pair in lines_with_ends(text)] for text in (before, after))
    lines = difflib.unified_diff(old, new, f"{name} (before)", f"{name} (after)")
    return "".join(
        line if line.endswith("\n") else f"{line}\n\\ No newline at end of file\n" for line in lines
    )
