"""Where answers come from: a folder of programs, or a command that reads the prompt."""

from __future__ import annotations

import os
import re
import selectors
import shlex
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import IO

import msgspec

from mcserver.errors import UsageFault
from mcserver.gcode.text.source import decode

MAX_OUTPUT = 256 * 1024  # bytes of an answer, with whatever a model says around the program
# the last block may be without its end: the answer was cut, or its writer forgot it
_BLOCK = re.compile(r"^[ \t]*(```|~~~)[^\n]*\n(.*?)(?:^[ \t]*\1[ \t]*$|\Z)", re.DOTALL | re.MULTILINE)
_COMMENT = re.compile(r"\([^)]*\)|;.*")
_CODE = re.compile(r"[GM] ?[0-9]", re.IGNORECASE)
# two words of a language in one line: no code has that outside of comments
_PROSE = re.compile(r"\b[^\W\d_]{2,}\b.*\b[^\W\d_]{2,}\b|^\W*[^\W\d_]{3,}\W*$")


class Answer(msgspec.Struct, frozen=True):
    """What was answered, or the reason why it is missing.

    Attributes:
        text: as it came, with whatever stands around the program. duration_s: that it took to get it.
    """

    text: str = ""
    missing: str = ""
    duration_s: float = 0.0


def program_in(answer: str) -> str:
    """Return the last block between lines of ``` that has codes; without one, the text between its prose.

    Prose is taken away before the first line of code and behind the last one only: what stands between
    lines of a program belongs to it.
    """
    text = answer.replace("\r\n", "\n")
    blocks = [str(found[2]) for found in _BLOCK.finditer(text)]
    if blocks:
        return next((block for block in reversed(blocks) if _CODE.search(block)), blocks[-1])
    lines = text.split("\n")
    first, last = 0, len(lines)
    while first < last and _is_prose(lines[first]):
        first += 1
    while last > first and (_is_prose(lines[last - 1]) or not lines[last - 1].strip()):
        last -= 1
    return answer if last - first == len(lines) or first == last else "\n".join([*lines[first:last], ""])


def _is_prose(line: str) -> bool:
    return bool(_PROSE.search(_COMMENT.sub("", line)))


def read_answer(folder: Path, number: int, name: str) -> Answer:
    """Read an answer from ``NNN-name.gcode``, ``name.gcode`` or ``NNN.gcode``.

    Args:
        number: of the task among all of its set, from 1.
    """
    for stem in (f"{number:03d}-{name}", name, f"{number:03d}"):
        file = folder / f"{stem}.gcode"
        if not file.is_file():
            continue
        try:
            with file.open("rb") as stream:
                return _answer(stream.read(MAX_OUTPUT + 1), 0.0)
        except OSError as error:
            return Answer(missing=f"{file.name} cannot be read: {error.strerror or error}")
    return Answer(missing=f"there is no {number:03d}.gcode or {name}.gcode")


class AnsweringCommand:
    """A command that gets each prompt on its standard input and writes a program; no shell takes part.

    Args:
        command: with its arguments, quoted as for a shell.
        timeout_s: after which it is ended with all that it has started.

    Raises:
        UsageFault: MC081 the command is empty or its quotes do not close.
    """

    def __init__(self, command: str, timeout_s: float) -> None:
        try:
            self._words = shlex.split(command)
        except ValueError as error:
            raise UsageFault(
                "MC081", f"{command!r} cannot be split into words: {error}", "close the quotes"
            ) from error
        if not self._words:
            raise UsageFault("MC081", "the command is empty", "such as --command 'llm -m model'")
        self._timeout_s = timeout_s

    def ask(self, prompt: str) -> Answer:
        """Run the command once.

        Raises:
            UsageFault: MC081 it cannot be started.
        """
        start = time.monotonic()
        try:
            process = subprocess.Popen(
                self._words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True
            )
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise UsageFault(
                "MC081", f"{self._words[0]} cannot be started: {reason}", "give its path, or install it"
            ) from error
        assert process.stdin is not None
        assert process.stdout is not None
        feeder = threading.Thread(target=_feed, args=(process.stdin, prompt.encode()), daemon=True)
        feeder.start()
        try:
            output = _read_until(process.stdout, start + self._timeout_s)
            # one that has written too much is ended: it may wait for a reader
            if output is not None and len(output) <= MAX_OUTPUT:
                process.wait(max(0.1, start + self._timeout_s - time.monotonic()))
        except subprocess.TimeoutExpired:
            output = None
        finally:
            _end(process)
            feeder.join()
            process.stdout.close()
        duration = time.monotonic() - start
        if output is None:
            return Answer(missing=f"the command took longer than {self._timeout_s:g} s", duration_s=duration)
        if process.returncode and not output.strip():
            return Answer(missing=f"the command ended with {process.returncode}", duration_s=duration)
        return _answer(output, duration)


def _answer(output: bytes, duration_s: float) -> Answer:
    if len(output) > MAX_OUTPUT:
        return Answer(missing=f"the answer has more than {MAX_OUTPUT} bytes", duration_s=duration_s)
    return Answer(decode(output), duration_s=duration_s)


def _feed(stream: IO[bytes], prompt: bytes) -> None:
    """Write the prompt; a command that does not read it is no fault."""
    try:
        with stream:
            stream.write(prompt)
    except OSError:
        return


def _read_until(stream: IO[bytes], deadline: float) -> bytes | None:
    """Read to the end, or one byte more than an answer may have; None: the time is over."""
    pieces: list[bytes] = []
    size = 0
    with selectors.DefaultSelector() as selector:
        selector.register(stream, selectors.EVENT_READ)
        while size <= MAX_OUTPUT:
            if not selector.select(max(0.0, deadline - time.monotonic())):
                return None
            piece = os.read(stream.fileno(), 65536)
            if not piece:
                break
            pieces.append(piece)
            size += len(piece)
    return b"".join(pieces)[: MAX_OUTPUT + 1]


def _end(process: subprocess.Popen[bytes]) -> None:
    """End the command with everything that it has started, and wait for it."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        process.kill()
    process.wait()
