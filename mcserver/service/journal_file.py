"""The journal's file: tables, opening, and pruning."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

import msgspec

from mcserver.errors import ServiceError

Statement = tuple[str, tuple[object, ...]]

SCHEMA_VERSION = 4
PAGE_BYTES = 1024

# Columns of each table in the order of their checksum, which is in the additional column ``crc``.
COLUMNS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "starts": ("instance TEXT UNIQUE NOT NULL", "started_at REAL NOT NULL", "stopped_at REAL"),
        # chunk_rows, chunk_sum: count of a program's rows in ``chunks``, and the sum of their ``crc``
        "programs": (
            "program TEXT UNIQUE NOT NULL",
            "instance TEXT NOT NULL",
            "client TEXT NOT NULL",
            "name TEXT NOT NULL",
            "axes TEXT NOT NULL",
            "start_line INTEGER NOT NULL",
            "on_disconnect TEXT NOT NULL",
            "resume_of TEXT",
            "state TEXT",
            "accepted INTEGER NOT NULL",
            "started INTEGER NOT NULL",
            "done INTEGER NOT NULL",
            "fault BLOB",
            "opened_at REAL NOT NULL",
            "ended_at REAL",
            # state of the machine when it began (`mcserver.planning.start_state.StartState`), what is known
            # of its text (`mcserver.service.journal.KnownText`), and the text's hash
            "origin BLOB",
            "whole INTEGER NOT NULL DEFAULT 0",
            "sha256 TEXT",
            "chunk_rows INTEGER NOT NULL DEFAULT 0",
            "chunk_sum INTEGER NOT NULL DEFAULT 0",
        ),
        # one row per message, not per line: 500 000 lines/s in messages of 100 are 5 000 rows/s
        "chunks": (
            "program TEXT NOT NULL",
            "first INTEGER NOT NULL",
            "last INTEGER NOT NULL",
            "lines BLOB NOT NULL",
        ),
        "faults": ("at REAL NOT NULL", "program TEXT", "line INTEGER NOT NULL", "blob BLOB NOT NULL"),
        # commands, and who gave them; ``program`` is NULL for the whole machine
        "commands": (
            "at REAL NOT NULL",
            "client TEXT NOT NULL",
            "method TEXT NOT NULL",
            "program TEXT",
            "detail TEXT NOT NULL",
        ),
        # count of rows of each table in `COUNTED`, and the sum of their ``crc``; for ``commits`` the count of
        # transactions ever committed
        "sums": ("of TEXT UNIQUE NOT NULL", "rows INTEGER NOT NULL", "total INTEGER NOT NULL"),
    }
)
NAMES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {table: tuple(column.split()[0] for column in columns) for table, columns in COLUMNS.items()}
)
INDEX = "CREATE INDEX chunks_by_program ON chunks(program, first)"
COUNTED = ("starts", "programs", "faults", "commands")
COMMITS = "commits"


def schema() -> list[str]:
    """Return the statements that create the tables of a new journal."""
    made = [
        f"CREATE TABLE {table}(id INTEGER PRIMARY KEY, {', '.join(columns)}, crc INTEGER)"
        for table, columns in COLUMNS.items()
    ]
    return [*made, INDEX]


def row_checksum(*values: object) -> int:
    """Return the checksum of all values of a row, as they are read from the database."""
    return zlib.crc32(msgspec.msgpack.encode(values))


def insertion(table: str, **values: object) -> Statement:
    """Return the statement that appends a row with its checksum.

    Omitted columns are NULL or 0, and an omitted ``id`` is the next one.
    """
    row = [
        values.get(name, 0 if column.endswith("DEFAULT 0") else None)
        for name, column in zip(NAMES[table], COLUMNS[table], strict=True)
    ]
    names = ", ".join(("id", *NAMES[table], "crc"))
    marks = ",".join("?" * (len(row) + 2))
    return f"INSERT INTO {table}({names}) VALUES ({marks})", (values.get("id"), *row, row_checksum(*row))


def _seals() -> Iterator[str]:
    """Yield triggers that update checksums and sums after any change.

    They are temporary, for each writing connection, since `row_checksum` is not a function of SQLite's.
    """
    for table in COLUMNS:
        if table == "sums":
            continue
        names = ", ".join(NAMES[table])
        yield (
            f"CREATE TEMP TRIGGER {table}_changed AFTER UPDATE OF {names} ON {table} BEGIN"
            f" UPDATE {table} SET crc=row_checksum({names}) WHERE id=NEW.id; END"
        )
        for event, row, count, crc in (
            ("INSERT", "NEW", 1, "NEW.crc"),
            ("DELETE", "OLD", -1, "-OLD.crc"),
            ("UPDATE OF crc", "NEW", 0, "NEW.crc-OLD.crc"),
        ):
            if table == "chunks":
                taken = ", accepted=max(accepted, NEW.last)" if count == 1 else ""
                counted = (
                    f"UPDATE programs SET chunk_rows=chunk_rows+{count},"
                    f" chunk_sum=chunk_sum+({crc}){taken} WHERE program={row}.program"
                )
            else:
                sums = f"rows+{count}", f"total+({crc})"
                counted = (
                    f"UPDATE sums SET rows={sums[0]}, total={sums[1]},"
                    f" crc=row_checksum(of, {', '.join(sums)}) WHERE of='{table}'"
                )
            name = f"{table}_{event.split()[0].lower()}_counted"
            yield f"CREATE TEMP TRIGGER {name} AFTER {event} ON {table} BEGIN {counted}; END"


COUNT_COMMIT = f"UPDATE sums SET rows=rows+1, crc=row_checksum(of, rows+1, total) WHERE of='{COMMITS}'"


@contextlib.contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Commit all statements of the block together, or none; outside of a block each statement commits."""
    connection.execute("BEGIN")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        # after some errors SQLite has rolled back already
        with contextlib.suppress(sqlite3.Error):
            connection.execute("ROLLBACK")
        raise


class JournalBounds(msgspec.Struct, frozen=True):
    """Bounds of the journal: ended programs, bytes of line text, server starts, commands."""

    ended_programs: int = 500
    text_bytes: int = 256 * 1024 * 1024
    starts: int = 1000
    commands: int = 100_000


@contextlib.contextmanager
def refusing_unusable(path: Path) -> Iterator[None]:
    """Convert errors of the disk and of SQLite in the block.

    Raises:
        ServiceError: MC520 the journal cannot be used.
    """
    try:
        yield
    except (sqlite3.Error, OSError) as error:
        raise ServiceError(
            "MC520", f"the journal {path} cannot be used: {error}", "give a writable file with --journal"
        ) from error


def open_journal(path: Path) -> sqlite3.Connection:
    """Return a connection in WAL mode with the schema created, for use in one thread at a time.

    An existing journal is of this version: see `mcserver.service.journal_repair.prepare_journal`.

    Raises:
        ServiceError: MC520 the file is not a database, or cannot be written.
    """
    with refusing_unusable(path), contextlib.ExitStack() as failed:
        # SQLite gives its files beside it the same permissions
        os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600))
        # only explicit transactions: a single statement commits itself, without BEGIN and COMMIT
        connection = sqlite3.connect(path, check_same_thread=False, timeout=1.0, isolation_level=None)
        failed.callback(connection.close)
        _prepare(connection)
        failed.pop_all()
    return connection


def _prepare(connection: sqlite3.Connection) -> None:
    """Create the schema in a new file."""
    # in a new file: a commit writes whole pages, and is mostly a single short row
    connection.execute(f"PRAGMA page_size={PAGE_BYTES}")
    connection.execute("PRAGMA journal_mode=WAL")
    connection.execute("PRAGMA synchronous=NORMAL")
    # a checkpoint syncs, which a commit must not wait for: `DiskSync` makes them
    connection.execute("PRAGMA wal_autocheckpoint=0")
    if connection.execute("PRAGMA user_version").fetchone() == (0,):
        with transaction(connection):
            for statement in schema():
                connection.execute(statement)
            for name in (*COUNTED, COMMITS):
                connection.execute(*insertion("sums", of=name, rows=0, total=0))
            connection.execute(f"PRAGMA user_version={SCHEMA_VERSION}")
    connection.create_function("row_checksum", -1, row_checksum, deterministic=True)
    for trigger in _seals():
        connection.execute(trigger)


def count_commits(connection: sqlite3.Connection) -> int:
    """Return the journal's count of transactions."""
    rows = connection.execute("SELECT rows FROM sums WHERE of=?", (COMMITS,))
    return int(next(iter(rows), (0,))[0])


def prune(bounds: JournalBounds) -> list[Statement]:
    """Return statements that bring the journal within its bounds, removing the oldest first.

    Text is removed oldest first, of whatever program: a program that runs for days loses its oldest lines,
    which a resumption then has to bring itself (MC514).
    """
    return [
        (
            "DELETE FROM programs WHERE ended_at IS NOT NULL AND id <= ("
            "SELECT id FROM programs WHERE ended_at IS NOT NULL ORDER BY id DESC LIMIT 1 OFFSET ?)",
            (bounds.ended_programs,),
        ),
        ("DELETE FROM chunks WHERE program NOT IN (SELECT program FROM programs)", ()),
        (
            "DELETE FROM chunks WHERE id <= (SELECT id FROM (SELECT id, sum(length(lines)) OVER "
            "(ORDER BY id DESC) AS size FROM chunks) WHERE size > ? ORDER BY id DESC LIMIT 1)",
            (bounds.text_bytes,),
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
