"""Lines on their way into the journal's database: a file of fixed size that takes each message in one write.

A transaction of SQLite is ten system calls and several pages, and a client that waits for its acknowledgement
waits for all of them. So lines that somebody waits for are appended here, where they outlive the process just
as well, and come into the database with its next transaction. That transaction notes the number of the last
record it has taken, so a start after a kill brings in what is left, and nothing twice.

A record is a head (length of the payload, its CRC-32, its number) and the payload, in MessagePack; a head of
zeros ends the log. Once the database has every record the next one is written over the first.
"""

from __future__ import annotations

import logging
import os
import struct
import zlib
from pathlib import Path
from typing import NamedTuple

import msgspec

log = logging.getLogger(__name__)

LOG_BYTES = 1024 * 1024
_HEAD = struct.Struct("<IIQ")
_NUMBERS = struct.Struct("<QI")
_END = bytes(_HEAD.size)


class LoggedLines(msgspec.Struct, frozen=True, array_like=True):
    """Lines ``first`` … ``last`` of a program; ``text`` is their list in MessagePack."""

    program: str
    first: int
    last: int
    text: bytes


class Kept(NamedTuple):
    """What a log holds.

    Attributes:
        records: by their numbers, in order. end: of the last sound one [bytes].
        damaged: a record behind them cannot be read.
    """

    records: list[tuple[int, LoggedLines]]
    end: int
    damaged: bool


def line_log_path(journal: Path) -> Path:
    """Return where the log of a journal is."""
    return Path(f"{journal}-lines")


class LineLog:
    """Appends records; one thread at a time.

    Args:
        path: the file; it is made, and its blocks are reserved, so that a full disk comes to light here.
        number: of the last record that was ever written.
        at: end of the records that are still needed [bytes]; what is behind it goes.

    Attributes:
        number: of the last record.

    Raises:
        OSError: it cannot be written.
    """

    def __init__(self, path: Path, number: int, at: int = 0, *, size: int = LOG_BYTES) -> None:
        self.number = number
        self._at = at
        self._size = size
        self._encode = msgspec.msgpack.Encoder().encode
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            os.posix_fallocate(self._file, 0, size)
            os.pwrite(self._file, _END, at)
        except OSError:
            os.close(self._file)
            raise

    def append(self, record: LoggedLines) -> int:
        """Return the record's number; 0 where it cannot be written, and then it counts as never given."""
        payload = self._encode(record)
        number = self.number + 1
        size = _HEAD.size + len(payload)
        if self._at + size + len(_END) > self._size:
            return 0
        written = _HEAD.pack(len(payload), _checksum(number, payload), number) + payload + _END
        try:
            if os.pwrite(self._file, written, self._at) != len(written):
                return 0
        except OSError as error:
            log.warning("the log of lines cannot be written: %s", error)
            return 0
        self.number = number
        self._at += size
        return number

    def clear(self) -> None:
        """The database has every record."""
        self._at = 0

    def close(self) -> None:
        os.close(self._file)


def read_line_log(path: Path) -> Kept:
    """Read a log that nobody writes; a file that is not there holds nothing."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        content = b""
    records: list[tuple[int, LoggedLines]] = []
    at = before = 0
    while content[at : at + _HEAD.size] not in (_END, b""):
        record = _record_at(content, at)
        if record is None or (before and record[0] != before + 1):
            return Kept(records, at, damaged=True)
        before, lines, size = record
        records.append((before, lines))
        at += size
    return Kept(records, at, damaged=False)


def _record_at(content: bytes, at: int) -> tuple[int, LoggedLines, int] | None:
    """Number, payload and size of a record [bytes]; None: it is not as it was written."""
    if at + _HEAD.size > len(content):
        return None
    size, checksum, number = _HEAD.unpack_from(content, at)
    end = at + _HEAD.size + size
    payload = content[at + _HEAD.size : end]
    if checksum != _checksum(number, payload):
        return None
    try:
        return number, msgspec.msgpack.decode(payload, type=LoggedLines), end - at
    except (msgspec.DecodeError, UnicodeDecodeError):
        return None


def _checksum(number: int, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(_NUMBERS.pack(number, len(payload))))
