"""The folder of a machine's recordings: names, what is there, and room on the disk."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import time
from pathlib import Path
from typing import Literal

import msgspec

from mcserver.errors import ServiceError

SUFFIX = ".mcap"
# A file that is being written, or that a killed recorder has left behind.
UNFINISHED = ".mcap.part"
BLACK_BOX = "blackbox-"
MAX_PART_BYTES = 1 << 20

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
RecordingKind = Literal["recording", "blackbox"]
RecordingState = Literal["writing", "done", "unfinished"]


class RecordingInfo(msgspec.Struct, frozen=True):
    """A recording on the server's disk.

    Attributes:
        name: without a suffix. kind: ``blackbox`` was written by itself or by ``record_save``.
        state: ``unfinished`` was left by a recorder that was killed, and is repaired at the next start.
        size: bytes. modified_at: Unix time [s].
    """

    name: str
    kind: RecordingKind
    state: RecordingState
    size: int
    modified_at: float


class RecordingPart(msgspec.Struct, frozen=True):
    """Bytes of a recording from ``offset`` on; ``size`` is the whole file's."""

    name: str
    offset: int
    size: int
    data: bytes


def check_name(name: str) -> str:
    """Return the name as given.

    Raises:
        ServiceError: MC584 it cannot be a file's name.
    """
    if _NAME.fullmatch(name) is None or name.endswith((SUFFIX, UNFINISHED)):
        raise ServiceError(
            "MC584",
            f"{name!r} cannot be a recording's name",
            "use letters, digits, '-', '_', '.'; without a suffix",
        )
    return name


def time_stamp(unix_s: float) -> str:
    """Such as ``20260314T150926.5Z``: sorts by time."""
    tenths = int(unix_s * 10.0)
    return time.strftime("%Y%m%dT%H%M%S", time.gmtime(tenths // 10)) + f".{tenths % 10}Z"


class RecordingFolder:
    """Reads and tidies a folder; only the recorder's process writes files there.

    Args:
        path: need not be there.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def finished(self, name: str) -> Path:
        return self.path / f"{check_name(name)}{SUFFIX}"

    def unfinished(self, name: str) -> Path:
        return self.path / f"{check_name(name)}{UNFINISHED}"

    def taken(self, name: str) -> bool:
        """Return whether there is a recording of that name."""
        return self.finished(name).exists() or self.unfinished(name).exists()

    def entries(self, writing: frozenset[str] = frozenset()) -> list[RecordingInfo]:
        """Return the newest first; an unreadable folder is empty.

        Args:
            writing: names of those being written now.
        """
        found = []
        with contextlib.suppress(OSError), os.scandir(self.path) as entries:
            for entry in entries:
                name, state = _name_of(entry.name, writing)
                if name is None:
                    continue
                with contextlib.suppress(OSError):
                    status = entry.stat()
                    kind: RecordingKind = "blackbox" if name.startswith(BLACK_BOX) else "recording"
                    found.append(RecordingInfo(name, kind, state, status.st_size, status.st_mtime))
        return sorted(found, key=lambda each: each.modified_at, reverse=True)

    def read(self, name: str, offset: int, size: int) -> RecordingPart:
        """Part of a finished recording.

        Raises:
            ServiceError: MC585 no recording has that name, or it cannot be read.
        """
        path = self.finished(name)
        try:
            with path.open("rb") as stream:
                whole = os.fstat(stream.fileno()).st_size
                stream.seek(offset)
                return RecordingPart(name, offset, whole, stream.read(min(size, MAX_PART_BYTES)))
        except OSError as error:
            raise ServiceError(
                "MC585",
                f"there is no recording {name!r} to read: {error.strerror}",
                "mcctl record list shows what is there; one that is being written has to be stopped first",
            ) from error

    def room(self) -> int:
        """Free bytes on the disk. Raises OSError."""
        return shutil.disk_usage(self.path).free

    def prune(self, keep: int, max_bytes: int) -> list[str]:
        """Delete the oldest black boxes beyond a number and a size; recordings stay.

        Returns:
            The names of those deleted.
        """
        boxes = [each for each in self.entries() if each.kind == "blackbox" and each.state == "done"]
        gone, total = [], 0
        for number, box in enumerate(boxes, start=1):
            total += box.size
            # the newest is what somebody is about to look at
            if number > 1 and (number > keep or total > max_bytes):
                with contextlib.suppress(OSError):
                    self.finished(box.name).unlink()
                    gone.append(box.name)
        return gone


def _name_of(file: str, writing: frozenset[str]) -> tuple[str | None, RecordingState]:
    for suffix, state in ((UNFINISHED, "unfinished"), (SUFFIX, "done")):
        name = file.removesuffix(suffix)
        if name != file and _NAME.fullmatch(name):
            if state == "done":
                return name, "done"
            return name, "writing" if name in writing else "unfinished"
    return None, "done"
