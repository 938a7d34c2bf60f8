"""Small files beside the journal that are written atomically."""

from __future__ import annotations

import contextlib
import logging
import os
import threading
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

log = logging.getLogger(__name__)

# runs a function that writes, and raises `OSError` if it cannot
Write = Callable[[Callable[[], None]], None]


def private(path: str, flags: int) -> int:
    """Open a file readable only by its owner; the ``opener`` of `open`."""
    return os.open(path, flags, 0o600)


def replace_file(path: Path, content: bytes) -> None:
    """Replace a file atomically: readers, after a power cut too, find all of the old or of the new content.

    Raises:
        OSError: it cannot be written; the old content is unchanged.
    """
    aside = path.with_name(f"{path.name}.new")
    with open(aside, "wb", opener=private) as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(aside, path)
    folder = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
    try:
        # sync the new name, too
        os.fsync(folder)
    finally:
        os.close(folder)


def with_checksum(content: bytes) -> bytes:
    """Return the content of a file: one line, and its checksum in another."""
    return b"%b\n%08x\n" % (content, zlib.crc32(content))


def without_checksum(held: bytes) -> bytes:
    """Return a file's content after verifying it; files from before the checksum have one line.

    Raises:
        ValueError: it is damaged.
    """
    content, line_end, checksum = held.partition(b"\n")
    if line_end and held != with_checksum(content):
        raise ValueError(
            f"its checksum is {checksum[:8]!r}, of what it holds it is {zlib.crc32(content):08x}"
        )
    return content


def write_at_once(run: Callable[[], None]) -> None:
    """Write in the caller's thread; after an error the content is only in memory."""
    with contextlib.suppress(OSError):
        run()


class KeptFiles:
    """Files whose newest content is written in the thread that its owner chooses.

    Args:
        code: of an error, for the log. what: the content, for people.
        write: may wait for the disk; its calls are in order, and after an error they are repeated.

    Attributes:
        failure: of the last write; empty: it succeeded, or there was none.
    """

    def __init__(self, code: str, what: str, write: Write) -> None:
        self.failure = ""
        self._code, self._what = code, what
        self._write = write
        # one write is scheduled at a time, and takes the newest content
        self._lock = threading.Lock()
        self._waiting: dict[Path, bytes] = {}
        self._ordered = False

    def put(self, files: Mapping[Path, bytes]) -> None:
        """Schedule writing of files; those of one call in the order of their names."""
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
