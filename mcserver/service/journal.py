"""The service journal: what was accepted, what was done, what failed. SQLite in WAL mode.

One thread commits what has gathered in a transaction; callbacks that came with it then run in the loop, in
order. Lines are acknowledged, and sent to the planner, only from there, and what a client may act on after a
restart is said only from there. A killed process loses nothing of what was committed; a power cut may lose
what another thread has not synced yet (`mcserver.service.disk_sync`).
"""

from __future__ import annotations

import enum
import queue
import sqlite3
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import msgspec

from mcserver.planning.start_state import StartState
from mcserver.service.commit_record import CommitRecord
from mcserver.service.disk_sync import DiskSync
from mcserver.service.journal_file import (
    COUNT_COMMIT,
    JournalBounds,
    Statement,
    count_commits,
    insertion,
    open_journal,
    prune,
    refusing_unusable,
    transaction,
)
from mcserver.service.reports import Fault, ProgramState

BATCH = 2000
RETRY_S = 0.5
PRUNE_PERIOD_S = 30.0
# Entries that wait for the thread, above which commands are not recorded.
MOST_WAITING = 10_000

OnCommitted = Callable[[], None]


class KnownText(enum.IntEnum):
    """What is known of a program's text."""

    PART = 0  # its client may have more lines
    WHOLE = 1
    NONE = 2  # moved by hand or by streamed targets: nothing that could be gone on with


class Entry(NamedTuple):
    """What the thread is given: a statement, or what writes a file beside, and what is called once it is
    committed."""

    statement: Statement | None
    on_committed: OnCommitted | None = None
    write: Callable[[], None] | None = None


class Journal:
    """Appends records, all from one thread; see `mcserver.service.journal_reader` for reading.

    Args:
        path: the database's file; its folder must exist.
        call_soon: runs a function in the thread that owns the journal; called in the writer thread.
        on_failure: called there with the reason each time a batch could not be written, and with "" when one
            could again; it is tried until then, and nothing is reported as committed meanwhile.
        threaded: writes and syncs in threads of its own; else its owner calls `write_pending`, on whatever
            clock.
    """

    def __init__(
        self,
        path: Path,
        *,
        call_soon: Callable[[Callable[[], None]], None],
        on_failure: Callable[[str], None],
        connect: Callable[[Path], sqlite3.Connection] = open_journal,
        threaded: bool = True,
    ) -> None:
        self.path = path
        self._call_soon = call_soon
        self._on_failure = on_failure
        self._inbox: queue.SimpleQueue[Entry | None] = queue.SimpleQueue()
        # when what is being committed was begun [s of `time.monotonic`]
        self._committing_since: float | None = None
        self._stopping = threading.Event()
        self._connection = connect(path)
        self._commits = count_commits(self._connection)
        with refusing_unusable(path):
            self._record = CommitRecord(path, self._commits)
        # what could not be written yet, without a thread
        self._failed: list[Entry] = []
        self._thread: threading.Thread | None = None
        self._sync: DiskSync | None = None
        if threaded:
            self._sync = DiskSync(path, self._synced)
            self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
            self._thread.start()

    def server_started(self, instance: str, at: float, on_committed: OnCommitted | None = None) -> None:
        """Record this start; programs of earlier instances that had not ended become ``interrupted``."""
        self._put(
            "UPDATE programs SET state='interrupted', ended_at=? WHERE ended_at IS NULL AND instance<>?",
            (at, instance),
            on_committed,
        )
        self._append("starts", instance=instance, started_at=at)

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
        sha256: str | None = None,
        by_hand: bool = False,
    ) -> None:
        """Record a program.

        Args:
            before: its lines from 1 on that are known already, through start_line - 1 at least, for a later
                resumption. sha256: of its whole text. by_hand: it is a jog, a search, or servo mode.
        """
        self._record.program_opened(program)
        self._append(
            "programs",
            program=program,
            instance=instance,
            client=client,
            name=name,
            axes=",".join(map(str, axes)),
            start_line=start_line,
            on_disconnect=on_disconnect,
            resume_of=resume_of,
            accepted=start_line - 1,
            started=0,
            done=start_line - 1,
            opened_at=at,
            sha256=sha256,
            whole=KnownText.NONE if by_hand else KnownText.PART,
        )
        if before:
            self.lines(program, 1, before)

    def program_begun(self, program: str, origin: StartState) -> None:
        """Record the machine as a program begins to run."""
        self._put("UPDATE programs SET origin=? WHERE program=?", (msgspec.msgpack.encode(origin), program))

    def program_closed(self, program: str) -> None:
        """Record that a program's text is whole: its client gives no more lines."""
        self._know_text(program, KnownText.WHOLE)

    def lines(
        self,
        program: str,
        first: int,
        lines: Sequence[str],
        on_committed: OnCommitted | None = None,
    ) -> None:
        """Record lines ``first``, ``first + 1``, …"""
        text = msgspec.msgpack.encode(lines)
        last = first + len(lines) - 1
        self._append("chunks", on_committed, program=program, first=first, last=last, lines=text)

    def rejected(self, program: str, line: int) -> None:
        """Record that lines from ``line`` on do not count."""
        self._know_text(program, KnownText.PART)
        self._put("DELETE FROM chunks WHERE program=? AND first>=?", (program, line))
        shorten = "UPDATE chunks SET last=? WHERE program=? AND last>=?"
        self._put(shorten, (line - 1, program, line))
        self._put("UPDATE programs SET accepted=min(accepted,?) WHERE program=?", (line - 1, program))

    def progress(
        self,
        program: str,
        started: int,
        done: int,
        on_committed: OnCommitted | None = None,
    ) -> None:
        """Record how far a program has come."""
        self._put(
            "UPDATE programs SET started=max(started,?), done=max(done,?) WHERE program=?",
            (started, done, program),
            on_committed,
        )

    def fault(self, fault: Fault, at: float) -> None:
        blob = msgspec.msgpack.encode(fault)
        self._append("faults", at=at, program=fault.program, line=fault.line, blob=blob)

    def command(self, at: float, client: str, method: str, program: str | None, detail: str) -> None:
        """Record who ordered what; ``program`` is None where the whole machine was meant.

        Behind a disk that is very slow it is left out, so that what waits is bounded.
        """
        if self._inbox.qsize() >= MOST_WAITING:
            return
        self._append("commands", at=at, client=client, method=method, program=program, detail=detail)

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

    @property
    def commit_s(self) -> float:
        """For how long the commit under way has been tried [s]; 0: there is none."""
        since = self._committing_since
        return 0.0 if since is None else time.monotonic() - since

    @property
    def sync_s(self) -> float:
        """For how long the sync or checkpoint under way has lasted [s]; 0: there is none."""
        return 0.0 if self._sync is None else self._sync.lasts_s

    def after(self, on_committed: OnCommitted) -> None:
        """Call back behind all that was written before."""
        self._inbox.put(Entry(None, on_committed))

    def beside(self, write: Callable[[], None]) -> None:
        """Write a file where this may wait for the disk, and before anything put later is committed.

        Args:
            write: raises `OSError` where it cannot. Then the transaction is tried again; it is called again,
                too, where that fails by itself.
        """
        self._inbox.put(Entry(None, None, write))

    def close(self, timeout_s: float = 5.0) -> None:
        """Write what is left, sync and close. Safe to call twice."""
        self._stopping.set()
        if self._thread is None or self._sync is None:
            self._connection.close()
        else:
            self._inbox.put(None)
            self._thread.join(timeout_s)
            self._sync.close(timeout_s)
        self._record.close()

    def write_pending(self) -> None:
        """Try once to commit what has gathered, without a thread."""
        batch = self._failed
        if not batch:
            while not self._inbox.empty() and (entry := self._inbox.get()) is not None:
                batch.append(entry)
        failure = self._commit(batch) if batch else ""
        if failure:
            self._failed = batch
            self._on_failure(failure)
        elif batch:
            self._failed = []
            self._on_failure("")
            _settle(batch)

    def _know_text(self, program: str, known: KnownText) -> None:
        sql = "UPDATE programs SET whole=? WHERE program=? AND whole<>?"
        self._put(sql, (known, program, KnownText.NONE))

    def _append(self, table: str, on_committed: OnCommitted | None = None, **values: object) -> None:
        self._inbox.put(Entry(insertion(table, **values), on_committed))

    def _put(self, sql: str, parameters: tuple[object, ...], on_committed: OnCommitted | None = None) -> None:
        self._inbox.put(Entry((sql, parameters), on_committed))

    def _run(self) -> None:
        assert self._sync is not None
        last_prune = time.monotonic()
        closing = False
        try:
            while not closing:
                batch, closing = self._gather(PRUNE_PERIOD_S)
                if batch:
                    self._committing_since = time.monotonic()
                    if not self._write(batch):
                        break
                    self._committing_since = None
                    self._call_soon(partial(_settle, batch))
                    self._sync.committed()
                now = time.monotonic()
                if now - last_prune >= PRUNE_PERIOD_S:
                    last_prune = now
                    self._write([Entry(statement) for statement in prune(JournalBounds())])
        finally:
            self._connection.close()

    def _gather(self, timeout_s: float) -> tuple[list[Entry], bool]:
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

    def _write(self, batch: list[Entry]) -> bool:
        """Commit one transaction; try until it can. False: given up, because the journal is being
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
                    if entry.write is not None:
                        entry.write()
                    if entry.statement is not None:
                        self._connection.execute(*entry.statement)
                self._connection.execute(COUNT_COMMIT)
        except (sqlite3.Error, OSError) as error:
            return str(error)
        self._commits += 1
        self._record.committed(self._commits)
        return ""

    def _synced(self) -> Callable[[], None]:
        """In the thread that syncs, before it does: what it calls once that is done."""
        number = self._commits
        return partial(self._record.synced, number)


def _settle(batch: list[Entry]) -> None:
    for entry in batch:
        if entry.on_committed is not None:
            entry.on_committed()
