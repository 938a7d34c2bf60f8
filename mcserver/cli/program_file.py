"""Reading a program from a file or from standard input."""

from __future__ import annotations

import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from mcserver.errors import UsageFault

MAX_PROGRAM_BYTES = 512 * 1024 * 1024
STDIN = "-"


def read_program(file: str) -> bytes:
    """Return the bytes of ``file``; ``-`` is standard input.

    Raises:
        UsageFault: MC010 it cannot be read, MC011 it holds more than 512 MiB.
    """
    with open_program(file) as stream:
        return _bounded(stream, "standard input" if file == STDIN else file)


@contextmanager
def open_program(file: str) -> Iterator[BinaryIO]:
    """Open ``file`` inside the block; ``-`` is standard input.

    Raises:
        UsageFault: MC010 it cannot be opened.
    """
    if file == STDIN:
        if sys.stdin is None:
            raise UsageFault("MC010", "standard input is closed", "pipe a program into it, or name a file")
        yield sys.stdin.buffer
        return
    try:
        if stat.S_ISDIR(os.stat(file).st_mode):
            raise UsageFault("MC010", f"{file} is a folder", "name a file of G-code in it")
        stream = Path(file).open("rb")  # noqa: SIM115 closed below
    except FileNotFoundError as error:
        raise UsageFault(
            "MC010", f"there is no file {file}", "check the spelling and the folder; - reads standard input"
        ) from error
    except (OSError, ValueError) as error:
        raise _unreadable(file, error) from error
    with stream:
        yield stream


def _unreadable(file: str, error: OSError | ValueError) -> UsageFault:
    reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return UsageFault(
        "MC010", f"{file} cannot be read: {reason}", "check its permissions; - reads standard input"
    )


def _bounded(stream: BinaryIO, name: str) -> bytes:
    try:
        program = stream.read(MAX_PROGRAM_BYTES + 1)
    except OSError as error:
        raise _unreadable(name, error) from error
    if len(program) > MAX_PROGRAM_BYTES:
        raise UsageFault(
            "MC011",
            f"{name} holds more than {MAX_PROGRAM_BYTES // 1024 // 1024} MiB",
            "split the program, or stream it with mcctl run",
        )
    return program


def shown_name(file: str) -> str:
    """Return how diagnostics call the file."""
    return "<stdin>" if file == STDIN else file
