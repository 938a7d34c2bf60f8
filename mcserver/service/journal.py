"""The service journal: what was accepted, what was done, what failed. SQLite in WAL mode.

Whoever writes goes on at once; one thread commits what has gathered in a transaction and then hands
back the tags that came with it. Lines are acknowledged, and given to the planner, only after that. A
single message that someone waits for may be committed by the caller itself while the thread is idle: a
commit takes 20 µs, since nothing is synced in it, and the way through the thread and back ten times that.
A killed process loses nothing that was committed; a power cut may lose the last `SYNC_PERIOD_S`.
"""

from __future__ import annotations

import contextlib
import os
import queue
import sqlite3
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from mcserver.errors import ServiceError
from mcserver.service.journal_schema import CREATE, SCHEMA_VERSION
from mcserver.service.reports import Fault, LineReport, ProgramState

SYNC_PERIOD_S = 0.25
BATCH = 2000
RETRY_S = 0.5
CHECKPOINT_PERIOD_S = 5.0
INSERT_LINES = "INSERT INTO chunks(program, first, last, lines) VALUES (?,?,?,?)"
PRUNE_PERIOD_S = 30.0

Statement = tuple[str, tuple[object, ...]]
# a statement, and what is handed back once it is committed (None: nothing)
Entry = tuple[Statement | None, object]


class JournalBounds(msgspec.Struct, frozen=True):
    """How much the journal keeps: ended programs, bytes of line text and of reports, server starts."""

    ended_programs: int = 500
    text_bytes: int = 256 * 1024 * 1024
    report_rows: int = 200_000
    starts: int = 1000


class Journal:
    """Appends records, all from one thread; see `mcserver.service.journal_reader` for reading.

    Args:
        path: the database's file; its folder must exist.
        on_commit: called in the writer thread after each commit with the tags of what it holds, in order.
        on_failure: called in the writer thread with the reason each time a batch could not be written; it is
            tried again until it can, and nothing is reported as committed meanwhile.
    """

    def __init__(
        self,
        path: Path,
        *,
        on_commit: Callable[[list[object]], None],
        on_failure: Callable[[str], None],
        bounds: JournalBounds | None = None,
    ) -> None:
        self.path = path
        self._on_commit = on_commit
        self._on_failure = on_failure
        self._bounds = bounds or JournalBounds()
        self._inbox: queue.SimpleQueue[Entry | None] = queue.SimpleQueue()
        # what was given to the thread, and what it has committed; the lock goes with the connection
        self._given = 0
        self._written = 0
        self._writing = threading.Lock()
        self._unsynced = False
        self._stopping = threading.Event()
        self._connection = open_journal(path)
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()

    def server_started(self, instance: str, at: float) -> None:
        """Records this start; programs of earlier instances that had not ended become ``interrupted``."""
        self._put(
            "UPDATE programs SET state='interrupted', ended_at=? WHERE ended_at IS NULL AND instance<>?",
            (at, instance),
        )
        self._put("INSERT INTO starts(instance, started_at) VALUES (?,?)", (instance, at))

    def server_stopped(self, instance: str, at: float) -> None:
        self._put("UPDATE starts SET stopped_at=? WHERE instance=?", (at, instance))

    def program_opened(
        self,
        program: str,
        *,
        instance: str,
        client: str,
        name: str,
        axes: Sequence[int],
        start_line: int,
        on_disconnect: str,
        resume_of: str | None,
        at: float,
        before: Sequence[str] = (),
    ) -> None:
        """Records a program; ``before`` are its lines 1 … start_line - 1, for a later resumption."""
        if before:
            self.lines(program, 1, before)
        self._put(
            "INSERT INTO programs(program, instance, client, name, axes, start_line, on_disconnect,"
            " resume_of, opened_at, accepted, started, done) VALUES (?,?,?,?,?,?,?,?,?,?,?,?)",
            (
                program,
                instance,
                client,
                name,
                ",".join(map(str, axes)),
                start_line,
                on_disconnect,
                resume_of,
                at,
                start_line - 1,
                0,
                start_line - 1,
            ),
        )

    def lines(self, program: str, first: int, lines: Sequence[str], tag: object = None) -> None:
        """Records lines ``first``, ``first + 1``, …; ``tag`` comes back once they are committed."""
        self._put(INSERT_LINES, _lines_row(program, first, lines), tag)

    def lines_at_once(self, program: str, first: int, lines: Sequence[str]) -> bool:
        """Commits lines before it returns, if the thread is idle; else does nothing and says False."""
        if self._given != self._written or not self._writing.acquire(blocking=False):
            return False
        try:
            if self._stopping.is_set():
                return False
            with self._connection:
                self._connection.execute(INSERT_LINES, _lines_row(program, first, lines))
        except sqlite3.Error:
            # the thread has the patience to try again
            return False
        finally:
            self._writing.release()
        self._unsynced = True
        return True

    def rejected(self, program: str, line: int) -> None:
        """Lines from ``line`` on do not count."""
        self._put("DELETE FROM chunks WHERE program=? AND first>=?", (program, line))
        self._put("UPDATE chunks SET last=? WHERE program=? AND last>=?", (line - 1, program, line))

    def progress(self, program: str, started: int, done: int, reports: Sequence[LineReport] = ()) -> None:
        """Records how far a program has come."""
        if reports:
            self._put(
                "INSERT INTO reports(program, first, last, blob) VALUES (?,?,?,?)",
                (program, reports[0].line, reports[-1].line, msgspec.msgpack.encode(reports)),
            )
        self._put(
            "UPDATE programs SET started=max(started,?), done=max(done,?) WHERE program=?",
            (started, done, program),
        )

    def fault(self, fault: Fault, at: float) -> None:
        self._put(
            "INSERT INTO faults(at, program, line, blob) VALUES (?,?,?,?)",
            (at, fault.program, fault.line, msgspec.msgpack.encode(fault)),
        )

    def program_ended(
        self,
        program: str,
        state: ProgramState,
        done: int,
        fault: Fault | None,
        at: float,
        tag: object = None,
    ) -> None:
        self._put(
            "UPDATE programs SET state=?, done=max(done,?), fault=?, ended_at=? WHERE program=?",
            (state, done, None if fault is None else msgspec.msgpack.encode(fault), at, program),
            tag,
        )

    def after(self, tag: object) -> None:
        """``tag`` comes back behind all that was written before."""
        self._given += 1
        self._inbox.put((None, tag))

    def close(self, timeout_s: float = 5.0) -> None:
        """Writes what is left, syncs and closes. Safe to call twice."""
        self._stopping.set()
        self._inbox.put(None)
        self._thread.join(timeout_s)

    def _put(self, sql: str, parameters: tuple[object, ...], tag: object = None) -> None:
        self._given += 1
        self._inbox.put(((sql, parameters), tag))

    def _run(self) -> None:
        wal = -1
        last_sync = last_checkpoint = last_prune = time.monotonic()
        closing = False
        try:
            while not closing:
                batch, closing = self._gather(SYNC_PERIOD_S)
                if batch and not self._write(batch):
                    break
                now = time.monotonic()
                if self._unsynced and (closing or now - last_sync >= SYNC_PERIOD_S):
                    self._unsynced = False
                    last_sync = now
                    wal = self._sync(wal)
                if now - last_checkpoint >= CHECKPOINT_PERIOD_S:
                    last_checkpoint = now
                    with self._writing, contextlib.suppress(sqlite3.Error):
                        self._connection.execute("PRAGMA wal_checkpoint(PASSIVE)")
                if now - last_prune >= PRUNE_PERIOD_S:
                    last_prune = now
                    self._write([(statement, None) for statement in prune(self._bounds)], counts=False)
        finally:
            if wal >= 0:
                os.close(wal)
            with self._writing:
                self._connection.close()

    def _sync(self, wal: int) -> int:
        """Lets what was committed reach the disk; the log's descriptor."""
        if wal < 0:
            with contextlib.suppress(OSError):
                wal = os.open(f"{self.path}-wal", os.O_RDONLY)
        if wal >= 0:
            with contextlib.suppress(OSError):
                os.fdatasync(wal)
        return wal

    def _gather(self, timeout_s: float | None) -> tuple[list[Entry], bool]:
        batch: list[Entry] = []
        try:
            item = self._inbox.get(timeout=timeout_s)
            while item is not None:
                batch.append(item)
                if len(batch) >= BATCH:
                    return batch, False
                item = self._inbox.get_nowait()
        except queue.Empty:
            return batch, False
        return batch, True

    def _write(self, batch: list[Entry], *, counts: bool = True) -> bool:
        """One transaction; tries until it can. False: given up, because the journal is being closed."""
        while True:
            try:
                with self._writing, self._connection:
                    for statement, _ in batch:
                        if statement is not None:
                            self._connection.execute(*statement)
            except sqlite3.Error as error:
                self._on_failure(str(error))
                if self._stopping.wait(RETRY_S):
                    return False
                continue
            self._unsynced = True
            if counts:
                self._written += len(batch)
            tags = [tag for _, tag in batch if tag is not None]
            if tags:
                self._on_commit(tags)
            return True


def _lines_row(program: str, first: int, lines: Sequence[str]) -> tuple[object, ...]:
    return program, first, first + len(lines) - 1, msgspec.msgpack.encode(lines)


def open_journal(path: Path) -> sqlite3.Connection:
    """A connection in WAL mode with the schema in place, for any one thread.

    Raises:
        ServiceError: MC520 the file is no journal of this version, or cannot be written.
    """
    try:
        connection = sqlite3.connect(path, check_same_thread=False, timeout=1.0)
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA synchronous=NORMAL")
        # a checkpoint syncs, which no commit shall wait for; the thread makes them
        connection.execute("PRAGMA wal_autocheckpoint=0")
        version = connection.execute("PRAGMA user_version").fetchone()[0]
        if version not in (0, SCHEMA_VERSION):
            connection.close()
            raise ServiceError(
                "MC520",
                f"the journal {path} has version {version}, not {SCHEMA_VERSION}",
                "move the file away, or give another with --journal",
            )
        with connection:
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
            "DELETE FROM starts WHERE rowid <= ("
            "SELECT rowid FROM starts ORDER BY rowid DESC LIMIT 1 OFFSET ?)",
            (bounds.starts,),
        ),
    ]
