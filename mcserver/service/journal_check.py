"""Damage of a journal's file, found before it is used: SQLite itself passes over much of it in silence.

SQLite ends its reading of the write-ahead log at the first frame whose checksum is wrong, as after a write
that was cut short; whatever was committed behind a damaged frame is gone without a word. So the log's frames
are checked here (https://www.sqlite.org/fileformat2.html#the_write_ahead_log), then the database's structure,
then the checksums of the rows.
"""

from __future__ import annotations

import contextlib
import fcntl
import shutil
import sqlite3
import struct
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

import msgspec

from mcserver.errors import ServiceError

_WAL_HEADER = struct.Struct(">8I")
_FRAME_HEADER = struct.Struct(">6I")
_LITTLE, _BIG = 0x377F0682, 0x377F0683
_WORD = 0xFFFFFFFF
# In the head of the wal-index (-shm), in the computer's byte order: the last committed frame, the salts.
_INDEX_LAST_FRAME = 16
_INDEX_SALTS = 32


class Damage(msgspec.Struct, frozen=True):
    """A journal that was damaged.

    Attributes:
        message: what is lost. kept: where the file as it was is kept.
    """

    message: str
    kept: Path


class JournalLock:
    """Holds a journal for one server, until `release` or the end of the process.

    Args:
        path: the journal's file; the lock is a file beside it.

    Raises:
        ServiceError: MC526 another server has it; MC520 the lock's file cannot be made.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = open(f"{path}.lock", "a")  # noqa: SIM115
        except OSError as error:
            raise ServiceError(
                "MC520",
                f"the journal {path} cannot be locked: {error}",
                "give a writable file with --journal",
            ) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.close()
            raise ServiceError(
                "MC526",
                f"another server uses the journal {path}",
                "end that server first, or give this one a journal of its own with --journal",
            ) from error

    def release(self) -> None:
        self._file.close()


def repair_journal(path: Path) -> Damage | None:
    """Check a journal that is not open; keep a damaged one aside and leave one that can be used.

    With a damaged log the database goes on with what came before the damage; a damaged database is replaced
    by an empty one.
    """
    if not path.exists():
        return None
    kept = path.with_name(f"{path.name}.damaged-{time.strftime('%Y%m%d-%H%M%S', time.gmtime())}")
    lost = wal_damage(path)
    if lost:
        # before anything opens the database, which would take the log's sound part and delete the rest
        for source, target in _files(path, kept):
            shutil.copy2(source, target)
    broken = database_damage(path)
    if broken:
        for source, target in _files(path, kept):
            if lost:
                source.unlink()
            else:
                source.replace(target)
        broken += ": its history begins anew"
    return Damage("; ".join(filter(None, (lost, broken))), kept) if lost or broken else None


def _files(path: Path, kept: Path) -> list[tuple[Path, Path]]:
    pairs = [(Path(f"{path}{suffix}"), Path(f"{kept}{suffix}")) for suffix in ("", "-wal", "-shm")]
    return [(source, target) for source, target in pairs if source.exists()]


# ---------------------------------------------------------------- the write-ahead log


def wal_damage(path: Path) -> str:
    """Say what the write-ahead log has lost; empty: nothing."""
    try:
        wal = Path(f"{path}-wal").read_bytes()
    except FileNotFoundError:
        return ""
    if len(wal) < _WAL_HEADER.size:
        return ""
    magic, _, page_size, _, salt_1, salt_2, *header_sum = _WAL_HEADER.unpack_from(wal)
    order = {_LITTLE: "<", _BIG: ">"}.get(magic)
    frames = wal[_WAL_HEADER.size :]
    if order is None or _checksum(order, (0, 0), wal[:24]) != tuple(header_sum):
        return "the head of its write-ahead log is damaged" if any(frames) else ""
    count = len(frames) // (_FRAME_HEADER.size + page_size)
    sums = tuple(header_sum)
    valid: int | None = None
    for number in range(count):
        at = number * (_FRAME_HEADER.size + page_size)
        head = frames[at : at + _FRAME_HEADER.size]
        page = frames[at + _FRAME_HEADER.size : at + _FRAME_HEADER.size + page_size]
        _, _, *salts, first_sum, second_sum = _FRAME_HEADER.unpack(head)
        right = salts == [salt_1, salt_2] and _checksum(order, sums, head[:8] + page) == (
            first_sum,
            second_sum,
        )
        if not right and valid is None:
            valid = number
        elif right and valid is not None:
            # a frame behind the first wrong one continues the log: no write that was cut short
            return (
                f"a page of its write-ahead log is damaged, and {count - valid} pages from there on are lost"
            )
        sums = (first_sum, second_sum)
    valid = count if valid is None else valid
    committed = _last_committed(path, struct.pack(">2I", salt_1, salt_2))
    if committed > valid:
        return f"the last {committed - valid} pages of its write-ahead log are lost"
    return ""


def _last_committed(path: Path, salts: bytes) -> int:
    """Number of the last frame that the wal-index knows as committed; 0 where it is of another log."""
    with contextlib.suppress(OSError), open(f"{path}-shm", "rb") as index:
        head = index.read(48)
        if len(head) == 48 and head[_INDEX_SALTS : _INDEX_SALTS + 8] == salts:
            (last,) = struct.unpack_from("=I", head, _INDEX_LAST_FRAME)
            return int(last)
    return 0


def _checksum(order: str, start: tuple[int, ...], content: bytes) -> tuple[int, int]:
    """SQLite's checksum of a header or frame, continued from ``start``."""
    first, second = start
    words = iter(struct.unpack(f"{order}{len(content) // 4}I", content))
    for word, following in zip(words, words, strict=True):
        first = (first + word + second) & _WORD
        second = (second + following + first) & _WORD
    return first, second


# ---------------------------------------------------------------- the database


def database_damage(path: Path) -> str:
    """Say what is wrong with the database; empty: nothing. Its log counts as far as it is sound."""
    try:
        with contextlib.closing(sqlite3.connect(path)) as connection:
            (verdict,) = connection.execute("PRAGMA quick_check(1)").fetchone()
            if verdict != "ok":
                return f"the database is damaged ({verdict})"
            version = connection.execute("PRAGMA user_version").fetchone()[0]
            wrong = next(_wrong_rows(connection), "") if version == CHECKED_VERSION else ""
            return f"a record is damaged ({wrong})" if wrong else ""
    except sqlite3.DatabaseError as error:
        if error.sqlite_errorcode == sqlite3.SQLITE_NOTADB:
            # another file, or a journal whose head is damaged: `open_journal` refuses it, people decide
            return ""
        return f"the database is damaged ({error})"


# The version of the schema whose rows have checksums.
CHECKED_VERSION = 2
_CHECKED = {
    "programs": "program, instance, client, name, axes, start_line, on_disconnect, resume_of, opened_at",
    "chunks": "program, first, lines",
    "reports": "program, first, last, blob",
    "faults": "at, program, line, blob",
    "commands": "at, client, method, program, detail",
}


def row_checksum(*values: object) -> int:
    """Checksum of the values of a row that never change."""
    return zlib.crc32(msgspec.msgpack.encode(values))


def _wrong_rows(connection: sqlite3.Connection) -> Iterator[str]:
    present = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type='table'")}
    for table, columns in _CHECKED.items():
        if table == "commands" and table not in present:
            # a journal of before they were kept
            continue
        for crc, *values in connection.execute(f"SELECT crc, {columns} FROM {table}"):
            if crc is not None and crc != row_checksum(*values):
                yield f"in {table}"
