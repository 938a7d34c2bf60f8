"""Where words go: results and errors of the commands, for people or as JSON."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import sys
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, NoReturn, TypeVar

import typer
from rich.text import Text

from mcclient.cli.terminal import narration as narration
from mcclient.cli.terminal import results as results
from mcclient.cli.terminal import write_text as write_text
from mcclient.cli.visible import visible_json
from mcclient.errors import MotionError, ProgramError, RequestRefused

T = TypeVar("T")

USAGE = 2


def say(text: str, style: str = "") -> None:
    """A sentence of narration."""
    narration().print(Text(text, style=style))


def as_plain(value: Any) -> Any:
    """Return a dataclass, or a list of them, as maps and lists for JSON."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    if isinstance(value, list | tuple):
        return [as_plain(each) for each in value]
    return value


def write_json(value: Any) -> None:
    """One JSON value and a line end on standard output."""
    sys.stdout.write(visible_json(json.dumps(as_plain(value), ensure_ascii=False)) + "\n")
    sys.stdout.flush()


def show_error(error: MotionError) -> None:
    """A coded error with its remedy, on standard error."""
    console = narration()
    # at a terminal between words; in a file each is one line
    soft = not console.is_terminal
    console.print(Text.assemble((f"error[{error.code}]", "bold red"), f": {error.message}"), soft_wrap=soft)
    if error.hint:
        console.print(Text.assemble("  = ", ("help", "bold"), f": {error.hint}"), soft_wrap=soft)


def error_as_json(error: MotionError) -> dict[str, Any]:
    """Return what ``--json`` gives of an error."""
    shown: dict[str, Any] = {"code": error.code, "message": error.message, "hint": error.hint}
    if error.details:
        shown["details"] = error.details
    if error.line:
        shown["line"] = error.line
    if isinstance(error, ProgramError):
        shown |= {"program": error.program, "accepted": error.accepted, "done": error.done}
    return {"ok": False, "error": shown, "diagnostics": as_plain(error.diagnostics)}


def exit_code_of(error: MotionError) -> int:
    """0 ok, 1 failed while running, 2 usage, 3 configuration, 4 program rejected, 5 nobody answers."""
    if isinstance(error, RequestRefused) and error.is_wrong_value:
        return USAGE
    return error.exit_code


@contextmanager
def errors_shown(as_json: bool) -> Iterator[None]:
    """Errors become a message, with ``--json`` an object on standard output too, and the exit code."""
    try:
        yield
    except MotionError as error:
        fail(error, as_json)


def fail(error: MotionError, as_json: bool) -> NoReturn:
    """Tells the error and leaves with its exit code."""
    if as_json:
        write_json(error_as_json(error))
    show_error(error)
    raise typer.Exit(exit_code_of(error)) from error


def carry_out(work: Callable[[], Coroutine[Any, Any, T]], as_json: bool) -> T:
    """Run a coroutine to its end, and show its errors."""
    with errors_shown(as_json):
        return asyncio.run(work())
    raise AssertionError("errors_shown leaves by itself")
