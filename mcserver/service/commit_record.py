"""How far a journal was written: a small file beside it, which outlives what damage takes of the journal.

SQLite ends its reading of a write-ahead log at the first damaged frame, or at the log's end, as after a write
that was cut short: whatever was committed behind it is gone without a word, and so it is with a log that is
missing. So each transaction counts itself in the database, and here. A database that has counted less than
this file has lost transactions. The ids of the last programs stand here too, for those that it has lost.
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

from mcserver.errors import ServiceError

KEPT_PROGRAMS = 200
# boot id, transactions committed, those of them that are known to be on the disk, CRC-32 of these
_HEAD = struct.Struct("<16sQQI")
_SUMMED = struct.Struct("<16sQQ")
_PROGRAMS_AT = 64
_BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class CommitCount(msgspec.Struct, frozen=True):
    """What the file says.

    Attributes:
        committed: transactions. synced: those that the disk had.
        same_boot: no power cut can have taken any of them.
        programs: ids of the last ones opened, oldest first.
    """

    committed: int = 0
    synced: int = 0
    same_boot: bool = True
    programs: tuple[str, ...] = ()

    @property
    def least(self) -> int:
        """How many transactions a sound journal has at least."""
        return self.committed if self.same_boot else self.synced


def commit_record_path(journal: Path) -> Path:
    """Return where the record of a journal is."""
    return Path(f"{journal}-commits")


def read_commit_record(journal: Path) -> CommitCount | None:
    """Read the record of a journal; None: there is none, or it cannot be read."""
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
    """Keeps the record of a journal that is being written.

    Args:
        journal: the database's file.
        committed: transactions that it has counted. gone: programs that it has no more.

    Raises:
        OSError: it cannot be written.
    """

    def __init__(self, journal: Path, committed: int, gone: Collection[str] = ()) -> None:
        found = read_commit_record(journal) or CommitCount()
        self._programs = [each for each in found.programs[-KEPT_PROGRAMS:] if each not in gone]
        self._boot = _boot_id()
        self._committed = self._synced = committed
        # who commits and who syncs are two threads
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
        # a full disk keeps the journal from being written too
        with contextlib.suppress(OSError):
            self._end += os.pwrite(self._file, _line_of(program), self._end)

    def committed(self, number: int) -> None:
        """Note how many transactions are committed."""
        with self._writing:
            self._committed = number
            with contextlib.suppress(OSError):
                self._write_head()

    def synced(self, number: int) -> None:
        """Note how many of them the disk has."""
        with self._writing:
            self._synced = number
            with contextlib.suppress(OSError):
                self._write_head()

    def close(self) -> None:
        """Write no more. Safe to call twice."""
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


def open_commit_record(journal: Path, committed: int) -> CommitRecord:
    """Keep the record of a journal that has counted so many transactions.

    Raises:
        ServiceError: MC520 it cannot be written.
    """
    try:
        return CommitRecord(journal, committed)
    except OSError as error:
        raise ServiceError(
            "MC520", f"the journal {journal} cannot be used: {error}", "give a writable file with --journal"
        ) from error


def _line_of(program: str) -> bytes:
    name = program.encode()
    return b"%08x %b\n" % (zlib.crc32(name), name)


def _boot_id() -> bytes:
    """Return what is another one after each start of the computer; zeros where it is not known."""
    try:
        return bytes.fromhex(_BOOT_ID.read_text("ascii").strip().replace("-", ""))
    except (OSError, ValueError):
        return bytes(16)
