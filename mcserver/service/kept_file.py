"""Small files beside the journal that have to be whole whenever the server ends."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

log = logging.getLogger(__name__)

# runs what writes, which raises `OSError` where it cannot
Write = Callable[[Callable[[], None]], None]


def private(path: str, flags: int) -> int:
    """Open a file that only its owner reads; the ``opener`` of `open`."""
    return os.open(path, flags, 0o600)


def replace_file(path: Path, content: bytes) -> None:
    """Write a file anew: whoever reads it, after a power cut too, finds all of the old one or of the new one.

    Raises:
        OSError: it cannot be written; the old one is as it was.
    """
    aside = path.with_name(f"{path.name}.new")
    with open(aside, "wb", opener=private) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(aside, path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
    try:
        # the new name, too
        os.fsync(folder)
    finally:
        os.close(folder)


def with_checksum(content: bytes) -> bytes:
    """Return what a file is to hold: one line, and its checksum in another."""
    return b"%b\n%08x\n" % (content, zlib.crc32(content))


def without_checksum(held: bytes) -> bytes:
    """Return the content of a file as it was written; one of before there was a checksum is one line.

    Raises:
        ValueError: it is not as it was written.
    """
    content, line_end, checksum = held.partition(b"\n")
    if line_end and held != with_checksum(content):
        raise ValueError(
            f"its checksum is {checksum[:8]!r}, of what it holds it is {zlib.crc32(content):08x}"
        )
    return content


def write_at_once(run: Callable[[], None]) -> None:
    """Write in the caller's thread; what fails is in memory alone."""
    with contextlib.suppress(OSError):
        run()


class KeptFiles:
    """Files whose newest content is written in whatever thread its owner has for that.

    Args:
        code: of an error, for the log. what: is kept in them, for people.
        write: may wait for the disk; each call of it is behind the one before, and what fails is tried again.

    Attributes:
        failure: why they could not be written; empty: they could, or nothing has been tried.
    """

    def __init__(self, code: str, what: str, write: Write) -> None:
        self.failure = ""
        self._code, self._what = code, what
        self._write = write
        # one write is ordered at a time, and takes the newest
        self._lock = threading.Lock()
        self._waiting: dict[Path, bytes] = {}
        self._ordered = False

    def put(self, files: Mapping[Path, bytes]) -> None:
        """Have files written; those of one call in the order of their names."""
        with self._lock:
            self._waiting |= files
            ordered, self._ordered = self._ordered, True
        if not ordered:
            self._write(self._write_waiting)

    def _write_waiting(self) -> None:
        with self._lock:
            files, self._waiting, self._ordered = self._waiting, {}, False
        try:
            for path in sorted(files):
                replace_file(path, files[path])
        except OSError as error:
            with self._lock:
                self._waiting = {**files, **self._waiting}
            failure = f"the {self._what} could not be kept in {min(files)}: {error}"
            if failure != self.failure:
                log.error("%s: %s", self._code, failure)
            self.failure = failure
            raise OSError(failure) from error
        self.failure = ""
