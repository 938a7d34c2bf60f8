"""Reading a program from a file or from standard input."""

from __future__ import annotations

import os
import stat
import sys
from pathlib import Path
from typing import BinaryIO

from mcserver.errors import UsageFault

MAX_PROGRAM_BYTES = 512 * 1024 * 1024
STDIN = "-"


def read_program(file: str) -> bytes:
    """The bytes of ``file``; ``-`` is standard input.

    Raises:
        UsageFault: MC010 it cannot be read, MC011 it holds more than 512 MiB.
    """
    if file == STDIN:
        if sys.stdin is None:
            raise UsageFault("MC010", "standard input is closed", "pipe a program into it, or name a file")
        return _bounded(sys.stdin.buffer, "standard input")
    try:
        if stat.S_ISDIR(os.stat(file).st_mode):
            raise UsageFault("MC010", f"{file} is a folder", "name a file of G-code in it")
        with Path(file).open("rb") as stream:
            return _bounded(stream, file)
    except FileNotFoundError as error:
        raise UsageFault(
            "MC010", f"there is no file {file}", "check the spelling and the folder; - reads standard input"
        ) from error
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise UsageFault(
            "MC010", f"{file} cannot be read: {reason}", "check its permissions; - reads standard input"
        ) from error


def _bounded(stream: BinaryIO, name: str) -> bytes:
    program = stream.read(MAX_PROGRAM_BYTES + 1)
    if len(program) > MAX_PROGRAM_BYTES:
        raise UsageFault(
            "MC011",
            f"{name} holds more than {MAX_PROGRAM_BYTES // 1024 // 1024} MiB",
            "split the program, or stream it with mcctl run",
        )
    return program


def shown_name(file: str) -> str:
    """How diagnostics call the file."""
    return "<stdin>" if file == STDIN else file
