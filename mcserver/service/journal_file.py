"""The journal's file: its tables, how it is opened, and how it is kept within bounds."""

from __future__ import annotations

import contextlib
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import msgspec

from mcserver.errors import ServiceError

SCHEMA_VERSION = 2
PAGE_BYTES = 1024

CREATE: tuple[str, ...] = (
    "CREATE TABLE IF NOT EXISTS starts(instance TEXT PRIMARY KEY, started_at REAL NOT NULL, stopped_at REAL)",
    "CREATE TABLE IF NOT EXISTS programs("
    " id INTEGER PRIMARY KEY, program TEXT UNIQUE NOT NULL, instance TEXT NOT NULL, client TEXT NOT NULL,"
    " name TEXT NOT NULL, axes TEXT NOT NULL, start_line INTEGER NOT NULL, on_disconnect TEXT NOT NULL,"
    " resume_of TEXT, state TEXT, accepted INTEGER NOT NULL, started INTEGER NOT NULL, done INTEGER NOT NULL,"
    " fault BLOB, opened_at REAL NOT NULL, ended_at REAL, crc INTEGER)",
    # one row a message, not a line: 500 000 lines/s in messages of 100 are 5 000 rows/s
    "CREATE TABLE IF NOT EXISTS chunks("
    " id INTEGER PRIMARY KEY, program TEXT NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL,"
    " lines BLOB NOT NULL, crc INTEGER)",
    "CREATE INDEX IF NOT EXISTS chunks_by_program ON chunks(program, first)",
    "CREATE TABLE IF NOT EXISTS reports("
    " id INTEGER PRIMARY KEY, program TEXT NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL,"
    " blob BLOB NOT NULL, crc INTEGER)",
    "CREATE INDEX IF NOT EXISTS reports_by_program ON reports(program, first)",
    "CREATE TABLE IF NOT EXISTS faults("
    " id INTEGER PRIMARY KEY, at REAL NOT NULL, program TEXT, line INTEGER NOT NULL, blob BLOB NOT NULL,"
    " crc INTEGER)",
    # who ordered what; ``program`` is NULL where the whole machine was meant
    "CREATE TABLE IF NOT EXISTS commands("
    " id INTEGER PRIMARY KEY, at REAL NOT NULL, client TEXT NOT NULL, method TEXT NOT NULL, program TEXT,"
    " detail TEXT NOT NULL, crc INTEGER)",
)

Statement = tuple[str, tuple[object, ...]]


class JournalConnection(Protocol):
    """The part of `sqlite3.Connection` that the journal uses; tests have one with a full disk.

    A statement outside `transaction` is one by itself.
    """

    def execute(self, statement: str, parameters: tuple[object, ...] = ..., /) -> object: ...
    def close(self) -> None: ...


@contextlib.contextmanager
def transaction(connection: JournalConnection) -> Iterator[None]:
    """Commit all statements of the block together, or none."""
    connection.execute("BEGIN")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        # SQLite has rolled back by itself after some errors
        with contextlib.suppress(sqlite3.Error):
            connection.execute("ROLLBACK")
        raise


class JournalBounds(msgspec.Struct, frozen=True):
    """How much the journal keeps: ended programs, bytes of line text, reports, server starts, commands."""

    ended_programs: int = 500
    text_bytes: int = 256 * 1024 * 1024
    report_rows: int = 200_000
    starts: int = 1000
    commands: int = 100_000


def open_journal(path: Path) -> sqlite3.Connection:
    """A connection in WAL mode with the schema in place, for any one thread.

    Raises:
        ServiceError: MC520 the file is no journal of this version, or cannot be written.
    """
    try:
        # no transactions but those asked for: a single statement commits itself, without BEGIN and COMMIT
        connection = sqlite3.connect(path, check_same_thread=False, timeout=1.0, isolation_level=None)
        # of a new file: a commit writes whole pages, and most commits are a single short row
        connection.execute(f"PRAGMA page_size={PAGE_BYTES}")
        connection.execute("PRAGMA journal_mode=WAL")
        # no commit shall wait for the disk: another connection syncs, and makes the checkpoints (DiskSync)
        connection.execute("PRAGMA synchronous=OFF")
        connection.execute("PRAGMA wal_autocheckpoint=0")
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version == 1:
            # rows of then have no checksum
            with transaction(connection):
                for table in ("programs", "chunks", "reports", "faults"):
                    connection.execute(f"ALTER TABLE {table} ADD COLUMN crc INTEGER")
                connection.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
            version = SCHEMA_VERSION
        if version not in (0, SCHEMA_VERSION):
            connection.close()
            raise ServiceError(
                "MC520",
                f"the journal {path} has version {version}, not {SCHEMA_VERSION}",
                "move the file away, or give another with --journal",
            )
        with transaction(connection):
            for statement in CREATE:
                connection.execute(statement)
            connection.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
    except sqlite3.Error as error:
        raise ServiceError(
            "MC520", f"the journal {path} cannot be used: {error}", "give a writable file with --journal"
        ) from error
    return connection


def prune(bounds: JournalBounds) -> list[Statement]:
    """Statements that bring the journal back within its bounds, the oldest first.

    Text goes oldest first whatever program it belongs to: a program that runs for days loses its oldest
    lines, which a resumption then has to bring itself (MC514).
    """
    return [
        (
            "DELETE FROM programs WHERE ended_at IS NOT NULL AND id <= ("
            "SELECT id FROM programs WHERE ended_at IS NOT NULL ORDER BY id DESC LIMIT 1 OFFSET ?)",
            (bounds.ended_programs,),
        ),
        ("DELETE FROM chunks WHERE program NOT IN (SELECT program FROM programs)", ()),
        ("DELETE FROM reports WHERE program NOT IN (SELECT program FROM programs)", ()),
        (
            "DELETE FROM chunks WHERE id <= (SELECT id FROM (SELECT id, sum(length(lines)) OVER "
            "(ORDER BY id DESC) AS size FROM chunks) WHERE size > ? ORDER BY id DESC LIMIT 1)",
            (bounds.text_bytes,),
        ),
        (
            "DELETE FROM reports WHERE id <= (SELECT id FROM reports ORDER BY id DESC LIMIT 1 OFFSET ?)",
            (bounds.report_rows,),
        ),
        (
            "DELETE FROM faults WHERE id <= (SELECT id FROM faults ORDER BY id DESC LIMIT 1 OFFSET ?)",
            (bounds.starts,),
        ),
        (
            "DELETE FROM commands WHERE id <= (SELECT id FROM commands ORDER BY id DESC LIMIT 1 OFFSET ?)",
            (bounds.commands,),
        ),
        (
            "DELETE FROM starts WHERE rowid <= ("
            "SELECT rowid FROM starts ORDER BY rowid DESC LIMIT 1 OFFSET ?)",
            (bounds.starts,),
        ),
    ]
