"""Prepare a journal before use: upgrade one of an older version, rebuild a damaged one.

Both copy what is intact into a new database. A program that is not completely intact is removed and named: a
count that may be wrong is worse than none.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import sqlite3
import time
from pathlib import Path

import msgspec

from mcserver.errors import ServiceError
from mcserver.service.commit_record import CommitCount, CommitRecord, read_commit_record
from mcserver.service.journal_check import UNRECORDED, Findings, JournalContent, examine, opened, refusal
from mcserver.service.journal_file import (
    COMMITS,
    NAMES,
    SCHEMA_VERSION,
    insertion,
    open_journal,
    refusing_unusable,
    row_checksum,
    transaction,
)
from mcserver.terminal import visible

NAMED = 20
# of a database: SQLite takes a shorter file for a new one, and overwrites it
LEAST_BYTES = 512
COPIED = ("starts", "programs", "chunks", "faults", "commands")


class Damage(msgspec.Struct, frozen=True):
    """Damage to a journal.

    Attributes:
        message: what is lost. kept: path of the damaged file. lost: ids of removed programs.
    """

    message: str
    kept: Path
    lost: tuple[str, ...] = ()


class JournalLock:
    """Locks a journal for one server, until `release` or the end of the process.

    Args:
        path: of the journal; the lock is a file beside it.

    Raises:
        ServiceError: MC526 another server has it; MC520 the lock's file cannot be created.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._file = os.open(f"{path}.lock", os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
        except OSError as error:
            raise ServiceError(
                "MC520",
                f"the journal {path} cannot be locked: {error}",
                "give a writable file with --journal",
            ) from error
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(self._file)
            raise ServiceError(
                "MC526",
                f"another server uses the journal {path}",
                "end that server first, or give this one a journal of its own with --journal",
            ) from error

    def release(self) -> None:
        os.close(self._file)


def prepare_journal(path: Path) -> Damage | None:
    """Check a journal that is not open, and leave an intact one of this version.

    Returns:
        The damage found; None without any.

    Raises:
        ServiceError: MC520 it cannot be read or written, or what it lost is unknown.
    """
    record = read_commit_record(path)
    with refusing_unusable(path):
        if path.is_dir():
            raise refusal(path, "it is a folder")
        size = path.stat().st_size if path.exists() else 0
        if size < LEAST_BYTES and (record is not None or not size):
            return _gone(path, record)
        if size < LEAST_BYTES:
            raise refusal(path, "it is too short")
        with opened(path) as content:
            if content is None:
                return _gone(path, record)
            found = examine(content, record)
            if content.version == SCHEMA_VERSION and not found.damage:
                return None
            rebuilt = _copied(content, found, path)
        kept = _kept_name(path) if found.damage else None
        _put_in_place(path, rebuilt, kept)
        CommitRecord(path, found.commits, found.lost).close()
    return None if kept is None else Damage(_said(found.damage, found.lost), kept, tuple(found.lost))


def _gone(path: Path, record: CommitCount | None) -> Damage | None:
    """Start a new journal where there is no database, and move away what is left of an old one."""
    wal = Path(f"{path}-wal")
    if not wal.exists() and (record is None or not record.committed):
        return None
    kept = _kept_name(path)
    for source, target in _files(path, kept):
        source.replace(target)
    lost = () if record is None else record.programs
    CommitRecord(path, 0, lost).close()
    damage = ["its database is gone"] if record is not None else ["its database is gone", UNRECORDED]
    return Damage(_said(damage, list(lost)), kept, tuple(lost))


def _copied(content: JournalContent, found: Findings, path: Path) -> Path:
    """Write a new database with everything that is intact."""
    rebuilt = Path(f"{path}.new")
    for suffix in ("", "-wal", "-shm"):
        Path(f"{rebuilt}{suffix}").unlink(missing_ok=True)
    with contextlib.closing(open_journal(rebuilt)) as connection, transaction(connection):
        for table in COPIED:
            for number, row, sound in content.rows(table):
                if not sound or (table in _OF_PROGRAMS and row["program"] not in found.kept):
                    continue
                # sums are computed again; an older version has columns that were removed
                values = {name: row[name] for name in NAMES[table] if name not in _SUM_COLUMNS}
                connection.execute(*insertion(table, id=number, **values))
        connection.execute("UPDATE sums SET rows=? WHERE of=?", (found.commits, COMMITS))
        checksum = row_checksum(COMMITS, found.commits, 0)
        connection.execute("UPDATE sums SET crc=? WHERE of=?", (checksum, COMMITS))
    with open(rebuilt, "rb") as file:
        os.fsync(file.fileno())
    return rebuilt


_OF_PROGRAMS = ("programs", "chunks")
_SUM_COLUMNS = ("chunk_rows", "chunk_sum")


def _put_in_place(path: Path, rebuilt: Path, kept: Path | None) -> None:
    """Replace a database after removing its log, which would be taken for the new one's."""
    if kept is None:
        with contextlib.closing(sqlite3.connect(path)) as connection:
            connection.execute("PRAGMA journal_mode=DELETE")
    else:
        # the database last: until then a start finds it, and notices that its log is lost
        for source, target in reversed(_files(path, kept)):
            if source == path:
                shutil.copy2(source, target)
            else:
                source.replace(target)
    os.replace(rebuilt, path)


def _files(path: Path, kept: Path) -> list[tuple[Path, Path]]:
    pairs = [(Path(f"{path}{suffix}"), Path(f"{kept}{suffix}")) for suffix in ("", "-wal", "-shm")]
    return [(source, target) for source, target in pairs if source.exists()]


def _kept_name(path: Path) -> Path:
    stamp = time.strftime("%Y%m%d-%H%M%S", time.gmtime())
    kept, number = path.with_name(f"{path.name}.damaged-{stamp}"), 1
    while kept.exists() or Path(f"{kept}-wal").exists():
        number += 1
        kept = path.with_name(f"{path.name}.damaged-{stamp}-{number}")
    return kept


def _said(damage: list[str], lost: list[str]) -> str:
    if not lost and UNRECORDED in damage:
        return f"{'; '.join(damage)}, and whether programs are lost is not known"
    if not lost:
        return f"{'; '.join(damage)}; no program is lost"
    more = f" and {len(lost) - NAMED} more" if len(lost) > NAMED else ""
    return f"{'; '.join(damage)}; set aside: {', '.join(map(visible, lost[:NAMED]))}{more}"
