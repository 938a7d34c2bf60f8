"""Record how far a journal was written, in a small file beside it that survives damage to the journal.

SQLite stops reading a write-ahead log at the first damaged frame, or at the log's end after a truncated
write: later commits are lost silently, as they are if the log is missing. So each transaction is counted in
the database, and here. A database with a lower count than this file has lost transactions. The file also has
the ids of the last programs, to name those that were lost.
"""

from __future__ import annotations

import contextlib
import os
import struct
import threading
import zlib
from collections.abc import Collection
from pathlib import Path

import msgspec

KEPT_PROGRAMS = 200
# boot id, committed transactions, count of those known to be on disk, CRC-32 of these
_HEAD = struct.Struct("<16sQQI")
_SUMMED = struct.Struct("<16sQQ")
_PROGRAMS_AT = 64
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class CommitCount(msgspec.Struct, frozen=True):
    """Content of the file.

    Attributes:
        committed: count of transactions. synced: count of those on disk.
        same_boot: no power cut can have lost any of them.
        programs: ids of the last ones opened, oldest first.
    """

    committed: int = 0
    synced: int = 0
    same_boot: bool = True
    programs: tuple[str, ...] = ()

    @property
    def least(self) -> int:
        """Fewest transactions that an intact journal has."""
        return self.committed if self.same_boot else self.synced


def commit_record_path(journal: Path) -> Path:
    """Return the path of a journal's record."""
    return Path(f"{journal}-commits")


def read_commit_record(journal: Path) -> CommitCount | None:
    """Read the record of a journal; None if it is missing or unreadable."""
    try:
        content = commit_record_path(journal).read_bytes()
        boot, committed, synced, checksum = _HEAD.unpack_from(content)
    except (OSError, struct.error):
        return None
    if checksum != zlib.crc32(content[: _SUMMED.size]):
        return None
    programs = []
    for line in content[_PROGRAMS_AT:].split(b"\n"):
        written, _, program = line.partition(b" ")
        if written == b"%08x" % zlib.crc32(program):
            programs.append(program.decode())
    return CommitCount(committed, synced, any(boot) and boot == _boot_id(), tuple(programs))


class CommitRecord:
    """Maintains the record of a journal that is being written.

    Args:
        committed: transactions in it. gone: programs that are no longer in it.

    Raises:
        OSError: it cannot be written.
    """

    def __init__(self, journal: Path, committed: int, gone: Collection[str] = ()) -> None:
        found = read_commit_record(journal) or CommitCount()
        self._programs = [each for each in found.programs[-KEPT_PROGRAMS:] if each not in gone]
        self._boot = _boot_id()
        self._committed = self._synced = committed
        # commits and syncs are noted by two threads
        self._writing = threading.Lock()
        flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC
        self._file = os.open(commit_record_path(journal), flags, 0o600)
        self._end = 0
        self._write_head()
        self._write_programs()

    def program_opened(self, program: str) -> None:
        """Note the id of a program before it is journaled."""
        self._programs.append(program)
        if len(self._programs) > 2 * KEPT_PROGRAMS:
            del self._programs[:-KEPT_PROGRAMS]
            with contextlib.suppress(OSError):
                self._write_programs()
            return
        # a full disk prevents writing the journal, too
        with contextlib.suppress(OSError):
            self._end += os.pwrite(self._file, _line_of(program), self._end)

    def committed(self, number: int) -> None:
        """Note the count of committed transactions."""
        with self._writing:
            self._committed = number
            with contextlib.suppress(OSError):
                self._write_head()

    def synced(self, number: int) -> None:
        """Note the count of transactions on disk."""
        with self._writing:
            self._synced = number
            with contextlib.suppress(OSError):
                self._write_head()

    def close(self) -> None:
        """Close the file. May be called twice."""
        with self._writing:
            file, self._file = self._file, -1
        if file >= 0:
            os.close(file)

    def _write_head(self) -> None:
        summed = _SUMMED.pack(self._boot, self._committed, self._synced)
        os.pwrite(self._file, summed + struct.pack("<I", zlib.crc32(summed)), 0)

    def _write_programs(self) -> None:
        content = b"".join(map(_line_of, self._programs))
        os.pwrite(self._file, content, _PROGRAMS_AT)
        self._end = _PROGRAMS_AT + len(content)
        os.ftruncate(self._file, self._end)


def _line_of(program: str) -> bytes:
    name = program.encode()
    return b"%08x %b\n" % (zlib.crc32(name), name)


def _boot_id() -> bytes:
    """Return an id that changes with each boot of the computer; zeros if unknown."""
    try:
        return bytes.fromhex(_BOOT_ID.read_text("ascii").strip().replace("-", ""))
    except (OSError, ValueError):
        return bytes(16)
