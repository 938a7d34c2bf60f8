"""The service journal: what was accepted, what was done, what failed. SQLite in WAL mode.

One thread commits what has gathered in a transaction; callbacks that came with it then run in the loop, in
order. Lines are acknowledged, and sent to the planner, only from there. Lines that someone waits for are kept
in a log (`mcserver.service.line_log`) at once where the thread has nothing of their program, and come into
the database with its next transaction: the detour through the thread takes a hundred times as long, and
seconds while it waits for a slow disk. A killed process loses nothing of what was committed or kept; a power
cut may lose the last `SYNC_PERIOD_S`.
"""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import sqlite3
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec

from mcserver.service.journal_check import row_checksum
from mcserver.service.journal_file import (
    JournalBounds,
    JournalConnection,
    Statement,
    open_journal,
    prune,
    taken_records,
    transaction,
)
from mcserver.service.line_log import LOG_BYTES, LineLog, LoggedLines, line_log_path, read_line_log
from mcserver.service.reports import Fault, LineReport, ProgramState

log = logging.getLogger(__name__)

SYNC_PERIOD_S = 0.25
BATCH = 2000
RETRY_S = 0.5
CHECKPOINT_PERIOD_S = 5.0
INSERT_LINES = "INSERT INTO chunks(program, first, last, lines, crc) VALUES (?,?,?,?,?)"
# from the log of a server that was killed: lines that go on where their program has come to; a log that was
# left beside an older database may have others
INSERT_LEFT_LINES = (
    "INSERT INTO chunks(program, first, last, lines, crc) SELECT ?,?,?,?,? WHERE EXISTS("
    "SELECT 1 FROM programs WHERE program=? AND ?=1 + max(start_line - 1, coalesce("
    "(SELECT max(last) FROM chunks WHERE chunks.program=programs.program), 0)))"
)
PRUNE_PERIOD_S = 30.0

OnCommitted = Callable[[], None]


class Entry(NamedTuple):
    """What the thread is given.

    Attributes:
        statement: to be executed. on_committed: called once it is committed.
        record, lines: what the log of lines keeps already, and its number there; 0: it is not in there.
            Without a statement the lines are to be inserted.
        program: whose lines come behind this; empty: of none.
    """

    statement: Statement | None
    on_committed: OnCommitted | None
    record: int = 0
    lines: LoggedLines | None = None
    program: str = ""


class Journal:
    """Appends records, all from one thread; see `mcserver.service.journal_reader` for reading.

    Args:
        path: the database's file; its folder must exist.
        call_soon: runs a function in the thread that owns the journal; called in the writer thread.
        on_failure: called there with the reason each time a batch could not be written, and with "" when one
            could again; it is tried until then, and nothing is reported as committed meanwhile.
        threaded: writes in a thread of its own; else its owner calls `write_pending`, on whatever clock.
        log_bytes: size of the log of lines.
    """

    def __init__(
        self,
        path: Path,
        *,
        call_soon: Callable[[Callable[[], None]], None],
        on_failure: Callable[[str], None],
        bounds: JournalBounds | None = None,
        connect: Callable[[Path], JournalConnection] = open_journal,
        threaded: bool = True,
        log_bytes: int = LOG_BYTES,
    ) -> None:
        self.path = path
        self._call_soon = call_soon
        self._on_failure = on_failure
        self._bounds = bounds or JournalBounds()
        self._inbox: queue.SimpleQueue[Entry | None] = queue.SimpleQueue()
        # lines in the log that the thread is not woken for: they go ahead of the next entry, or when it
        # wakes by itself
        self._later: list[Entry] = []
        self._giving = threading.Lock()
        # how many entries that lines of a program come behind are not settled; it belongs to the owner, as
        # does the number of the last record that the database has
        self._ahead: Counter[str] = Counter()
        self._taken = 0
        self._unsynced = False
        self._stopping = threading.Event()
        self._connection = connect(path)
        self._lines_log = self._open_log(log_bytes)
        # what could not be written yet, without a thread
        self._failed: list[Entry] = []
        self._thread: threading.Thread | None = None
        if threaded:
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
        named = ",".join(map(str, axes))
        lasting = (program, instance, client, name, named, start_line, on_disconnect, resume_of, at)
        self._put(
            "INSERT INTO programs(program, instance, client, name, axes, start_line, on_disconnect,"
            " resume_of, opened_at, accepted, started, done, crc) VALUES (?,?,?,?,?,?,?,?,?,?,?,?,?)",
            (*lasting, start_line - 1, 0, start_line - 1, row_checksum(*lasting)),
            program=program,
        )

    def lines(
        self,
        program: str,
        first: int,
        lines: Sequence[str],
        on_committed: OnCommitted | None = None,
        *,
        urgent: bool = False,
    ) -> None:
        """Records lines ``first``, ``first + 1``, …

        Args:
            on_committed: called once they are committed.
            urgent: someone waits: commits before it returns, if the thread has nothing to do.
        """
        last = first + len(lines) - 1
        text = msgspec.msgpack.encode(lines)
        logged = LoggedLines(program, first, last, text)
        record = self._log(logged) if urgent else 0
        if not record:
            self._put(INSERT_LINES, _row_of(logged), on_committed, program=program)
            return
        with self._giving:
            self._later.append(Entry(None, None, record, logged))
        if on_committed is not None:
            on_committed()

    def _log(self, record: LoggedLines) -> int:
        """Return the record's number in the log of lines; 0: it has to go through the thread."""
        # what was given of the program before has to be through with its callbacks too
        if self._lines_log is None or self._ahead[record.program] or self._stopping.is_set():
            return 0
        return self._lines_log.append(record)

    def rejected(self, program: str, line: int) -> None:
        """Lines from ``line`` on do not count."""
        self._put("DELETE FROM chunks WHERE program=? AND first>=?", (program, line), program=program)
        shorten = "UPDATE chunks SET last=? WHERE program=? AND last>=?"
        self._put(shorten, (line - 1, program, line), program=program)

    def progress(
        self,
        program: str,
        started: int,
        done: int,
        reports: Sequence[LineReport] = (),
        on_committed: OnCommitted | None = None,
    ) -> None:
        """Records how far a program has come."""
        if reports:
            row = program, reports[0].line, reports[-1].line, msgspec.msgpack.encode(reports)
            self._put(
                "INSERT INTO reports(program, first, last, blob, crc) VALUES (?,?,?,?,?)",
                (*row, row_checksum(*row)),
            )
        self._put(
            "UPDATE programs SET started=max(started,?), done=max(done,?) WHERE program=?",
            (started, done, program),
            on_committed,
        )

    def fault(self, fault: Fault, at: float) -> None:
        row = at, fault.program, fault.line, msgspec.msgpack.encode(fault)
        self._put(
            "INSERT INTO faults(at, program, line, blob, crc) VALUES (?,?,?,?,?)",
            (*row, row_checksum(*row)),
        )

    def command(self, at: float, client: str, method: str, program: str | None, detail: str) -> None:
        """Record who ordered what; ``program`` is None where the whole machine was meant."""
        row = at, client, method, program, detail
        self._put(
            "INSERT INTO commands(at, client, method, program, detail, crc) VALUES (?,?,?,?,?,?)",
            (*row, row_checksum(*row)),
        )

    def program_ended(
        self,
        program: str,
        state: ProgramState,
        done: int,
        fault: Fault | None,
        at: float,
        on_committed: OnCommitted | None = None,
    ) -> None:
        self._put(
            "UPDATE programs SET state=?, done=max(done,?), fault=?, ended_at=? WHERE program=?",
            (state, done, None if fault is None else msgspec.msgpack.encode(fault), at, program),
            on_committed,
        )

    def after(self, on_committed: OnCommitted) -> None:
        """Calls back behind all that was written before."""
        self._give(Entry(None, on_committed))

    def close(self, timeout_s: float = 5.0) -> None:
        """Writes what is left, syncs and closes. Safe to call twice."""
        self._stopping.set()
        if self._thread is None:
            self._connection.close()
        else:
            with self._giving:
                self._inbox.put(None)
            self._thread.join(timeout_s)
        if self._lines_log is not None:
            self._lines_log.close()
            self._lines_log = None

    def write_pending(self) -> None:
        """Try once to commit what has gathered, without a thread."""
        batch = self._failed
        if not batch:
            while not self._inbox.empty() and (entry := self._inbox.get()) is not None:
                batch.append(entry)
            batch += self._take_later()
        failure = self._commit(batch) if batch else ""
        if failure:
            self._failed = batch
            self._on_failure(failure)
        elif batch:
            self._failed = []
            self._on_failure("")
            self._settle(batch)

    def _put(
        self,
        sql: str,
        parameters: tuple[object, ...],
        on_committed: OnCommitted | None = None,
        *,
        program: str = "",
    ) -> None:
        self._give(Entry((sql, parameters), on_committed, program=program))

    def _give(self, entry: Entry) -> None:
        if entry.program:
            self._ahead[entry.program] += 1
        with self._giving:
            for each in self._later:
                self._inbox.put(each)
            self._later.clear()
            self._inbox.put(entry)

    def _take_later(self) -> list[Entry]:
        with self._giving:
            if not self._inbox.empty():
                # it may hold older records: the database has all records before the last one that it has
                return []
            taken, self._later = self._later, []
        return taken

    def _open_log(self, size: int) -> LineLog | None:
        """Open the log of lines, and give the thread what the database does not have of it."""
        path = line_log_path(self.path)
        self._taken = taken_records(self.path)
        kept = read_line_log(path)
        left = [(number, lines) for number, lines in kept.records if number > self._taken]
        for number, lines in left:
            inserted = INSERT_LEFT_LINES, (*_row_of(lines), lines.program, lines.first)
            self._inbox.put(Entry(inserted, None, number))
        last = max([self._taken, *(number for number, _ in kept.records)])
        try:
            return LineLog(path, last, kept.end if left else 0, size=size)
        except OSError as error:
            log.warning("lines are journaled without a log of lines, which is slower: %s: %s", path, error)
            return None

    def _run(self) -> None:
        wal = -1
        last_sync = last_checkpoint = last_prune = time.monotonic()
        closing = False
        try:
            while not closing:
                waited = time.monotonic() - last_sync if self._unsynced else 0.0
                batch, closing = self._gather(max(0.0, SYNC_PERIOD_S - waited))
                if batch:
                    if not self._write(batch):
                        break
                    self._call_soon(partial(self._settle, batch))
                now = time.monotonic()
                if self._unsynced and (closing or now - last_sync >= SYNC_PERIOD_S):
                    self._unsynced = False
                    last_sync = now
                    wal = self._sync(wal)
                if now - last_checkpoint >= CHECKPOINT_PERIOD_S:
                    last_checkpoint = now
                    with contextlib.suppress(sqlite3.Error):
                        self._connection.execute("PRAGMA wal_checkpoint(PASSIVE)")
                if now - last_prune >= PRUNE_PERIOD_S:
                    last_prune = now
                    self._write([Entry(statement, None) for statement in prune(self._bounds)])
        finally:
            if wal >= 0:
                os.close(wal)
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
            return batch + self._take_later(), False
        return batch + self._take_later(), True

    def _write(self, batch: list[Entry]) -> bool:
        """Commits one transaction; tries until it can. False: given up, because the journal is being
        closed."""
        failed = False
        while failure := self._commit(batch):
            failed = True
            self._call_soon(partial(self._on_failure, failure))
            if self._stopping.wait(RETRY_S):
                return False
        if failed:
            self._call_soon(partial(self._on_failure, ""))
        return True

    def _commit(self, batch: list[Entry]) -> str:
        """Commit one transaction; why not, where that fails."""
        try:
            with transaction(self._connection):
                for entry in batch:
                    if entry.statement is not None:
                        self._connection.execute(*entry.statement)
                    elif entry.lines is not None:
                        self._connection.execute(INSERT_LINES, _row_of(entry.lines))
                records = [entry.record for entry in batch if entry.record]
                if records:
                    self._connection.execute("UPDATE line_log SET taken=?", (records[-1],))
        except sqlite3.Error as error:
            return str(error)
        self._unsynced = True
        return ""

    def _settle(self, batch: list[Entry]) -> None:
        for entry in batch:
            if entry.record:
                self._taken = entry.record
            if entry.program:
                self._ahead[entry.program] -= 1
                if not self._ahead[entry.program]:
                    del self._ahead[entry.program]
        if self._lines_log is not None and self._taken == self._lines_log.number:
            self._lines_log.clear()
        for entry in batch:
            if entry.on_committed is not None:
                entry.on_committed()


def _row_of(lines: LoggedLines) -> tuple[str, int, int, bytes, int]:
    """Return the row of ``chunks`` that has these lines."""
    checksum = row_checksum(lines.program, lines.first, lines.text)
    return lines.program, lines.first, lines.last, lines.text, checksum
