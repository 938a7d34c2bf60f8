"""How a rejected program is shown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

import typer

from mcserver.cli.console import narration, show_diagnostics
from mcserver.cli.exit_codes import ExitCode
from mcserver.errors import Diagnostic


def reject(diagnostics: Sequence[Diagnostic], lines: Sequence[str], name: str) -> NoReturn:
    """Show every fault of the program ``name`` with its lines, and leave with exit code 4."""
    show_diagnostics(diagnostics, lines, name)
    narration().print(count_faults(diagnostics, name), style="bold red")
    raise typer.Exit(int(ExitCode.REJECTED))


def count_faults(diagnostics: Sequence[Diagnostic], name: str) -> str:
    """Return the closing line of a rejection."""
    errors = [each for each in diagnostics if each.severity == "error"]
    lines = len({each.line for each in errors})
    return f"{name} is rejected: {_count(len(errors), 'error')} in {_count(lines, 'line')}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'s' * (number != 1)}"
