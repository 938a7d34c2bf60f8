"""Long programs handed over to the server as files, to be checked, and simulated while they run."""

from __future__ import annotations

import asyncio
import hashlib
import os
from codecs import BOM_UTF8
from pathlib import Path
from typing import BinaryIO

from mcclient.calls import Caller
from mcclient.errors import RequestRefused
from mcclient.wire import unpack

PART_BYTES = 1 << 20
# one part waits for a disk at most so long [s]
PART_DEADLINE_S = 60.0


def hash_of_file(path: Path) -> str:
    """Return the SHA-256 of a file's bytes, hexadecimal. Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def text_of_program(content: bytes, name: str) -> str:
    """Return the text of a program's file, by which approvals know it: without a byte order mark.

    Raises:
        RequestRefused: MC511 it is no text.
    """
    lines = enumerate(content.removeprefix(BOM_UTF8).split(b"\n"), start=1)
    return "\n".join(text_of_line(line, name, number) for number, line in lines)


def text_of_line(line: bytes, name: str, number: int) -> str:
    """Decode a line: UTF-8, else Windows' Latin-1, as older CAM systems write comments.

    Raises:
        RequestRefused: MC511 it is no text.
    """
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        if b"\0" in line:
            raise RequestRefused(
                "MC511", f"{name} is no text: line {number} has a byte 0", "is it the right file?"
            ) from None
        return line.decode("cp1252", "replace")


async def put_text(caller: Caller, path: Path, sha256: str | None = None) -> str:
    """Hand a file over; what the server has of it already is not sent again.

    Args:
        sha256: of it, as `hash_of_file` gives it; None: it is reckoned here.

    Returns:
        Its SHA-256, by which `Machine.check` and `Machine.program` name it.

    Raises:
        RequestRefused: MC511 it cannot be read, or has changed meanwhile; MC590, MC591 the server does not
            take it.
    """
    try:
        if sha256 is None:
            sha256 = await asyncio.to_thread(hash_of_file, path)
        size = os.path.getsize(path)
        with path.open("rb") as file:
            received, complete = 0, False
            while not complete:
                part = await asyncio.to_thread(_part, file, received)
                if not part and received < size:
                    raise RequestRefused("MC511", f"{path} became shorter", "run it again")
                request = {"sha256": sha256, "size": size, "offset": received, "part": part}
                reply = unpack(
                    await caller.call(
                        "put_text", request, deadline_s=PART_DEADLINE_S, attempt_s=PART_DEADLINE_S / 4.0
                    )
                )
                received, complete = reply["received"], reply["complete"]
    except OSError as error:
        raise RequestRefused(
            "MC511", f"{path} cannot be read: {error.strerror or error}", "name a G-code file"
        ) from error
    return sha256


def _part(file: BinaryIO, offset: int) -> bytes:
    file.seek(offset)
    return file.read(PART_BYTES)
