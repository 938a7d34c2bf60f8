"""The journal: what was committed survives, whatever happens to the process."""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import sqlite3
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest

from mcserver.errors import ServiceError
from mcserver.service.journal import Journal
from mcserver.service.journal_file import JournalBounds, insertion, open_journal, prune, transaction
from mcserver.service.journal_reader import read_lines_before, read_programs
from mcserver.service.reports import Fault
from tests.service.fakes import open_program

LIMIT_S = 5.0

CRASHING = """
import queue, sys
from functools import partial
from pathlib import Path
from mcserver.service.journal import Journal

calls = queue.SimpleQueue()
journal = Journal(Path(sys.argv[1]), call_soon=calls.put, on_failure=print)
journal.server_started("crashed", 1.0)
journal.program_opened("p-1", instance="crashed", client="hmi", name="demo", axes=[0, 1], start_line=1,
                       on_disconnect="stop", resume_of=None, at=2.0)
line = 0
while True:
    line += 1
    committed = partial(print, f"line{line}", flush=True)
    journal.lines("p-1", line, [f"G01 X{line}"], committed)
    if line % 7 == 0:
        journal.progress("p-1", line - 2, line - 3)
    if line % 50 == 0:
        written = []
        journal.after(partial(written.append, True))
        while not written:
            calls.get()()
"""


class Kept:
    """A journal, owned by the test's thread, and the names of what it has committed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.committed: list[str] = []
        self.failures: list[str] = []
        self._calls: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.journal = Journal(path, call_soon=self._calls.put, on_failure=self.failures.append)

    def named(self, name: str) -> Callable[[], None]:
        """A callback that notes the name."""
        return partial(self.committed.append, name)

    def turn(self) -> None:
        """Waits for one call of the writer's thread and makes it."""
        self._calls.get(timeout=LIMIT_S)()

    def settle(self) -> None:
        """Waits until everything written so far is committed."""
        settled: list[bool] = []
        self.journal.after(partial(settled.append, True))
        while not settled:
            self.turn()

    def open(self, program: str, *, start_line: int = 1, before: list[str] | None = None) -> None:
        open_program(self.journal, program, axes=[0, 2], start_line=start_line, before=before or [])


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Callable[[], Kept]]:
    made: list[Kept] = []

    def build() -> Kept:
        made.append(Kept(tmp_path / "journal.db"))
        return made[-1]

    yield build
    for kept in made:
        kept.journal.close()


def test_lines_come_back_in_order_across_messages(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.open("p")
    kept.journal.lines("p", 1, ["G90", "G01 X1"])
    kept.journal.lines("p", 3, ["G01 X2"])
    kept.settle()
    assert read_lines_before(kept.path, "p", 4) == ["G90", "G01 X1", "G01 X2"]
    assert read_lines_before(kept.path, "p", 2) == ["G90"]


def test_lines_behind_a_rejected_one_do_not_count(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.open("p")
    kept.journal.lines("p", 1, ["one", "two", "bad", "four"])
    kept.journal.lines("p", 5, ["five"])
    kept.journal.rejected("p", 3)
    kept.journal.lines("p", 3, ["three"])
    kept.settle()
    assert read_lines_before(kept.path, "p", 4) == ["one", "two", "three"]
    (program,) = read_programs(kept.path, limit=5)
    assert program.accepted == 3


def test_a_transaction_that_fails_leaves_nothing_and_the_next_one_is_whole(tmp_path: Path) -> None:
    with contextlib.closing(open_journal(tmp_path / "journal.db")) as connection:

        def start(instance: str) -> None:
            connection.execute(*insertion("starts", instance=instance, started_at=0.0))

        def twice(instance: str) -> None:
            with transaction(connection):
                start(instance)
                start(instance)

        with pytest.raises(sqlite3.IntegrityError):
            twice("a")
        assert connection.execute("SELECT count(*) FROM starts").fetchone() == (0,)
        with transaction(connection):
            start("a")
            start("b")
        assert not connection.in_transaction
        assert connection.execute("SELECT count(*) FROM starts").fetchone() == (2,)


def test_lines_are_committed_while_the_disk_takes_its_time_to_sync(
    make: Callable[[], Kept], monkeypatch: pytest.MonkeyPatch
) -> None:
    syncing, synced = threading.Event(), threading.Event()

    def slow(_descriptor: int) -> None:
        syncing.set()
        synced.wait(LIMIT_S)

    monkeypatch.setattr(os, "fdatasync", slow)
    kept = make()
    kept.open("p")
    assert syncing.wait(LIMIT_S)
    kept.journal.lines("p", 1, ["one"], kept.named("one"))
    kept.settle()
    assert not synced.is_set()
    assert kept.committed == ["one"]
    synced.set()


def test_what_was_committed_last_is_synced_before_the_journal_is_closed(
    make: Callable[[], Kept], monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = make()
    kept.open("p")
    kept.settle()
    synced: list[int] = []
    monkeypatch.setattr(os, "fdatasync", synced.append)
    kept.journal.lines("p", 1, ["one"])
    kept.journal.close()
    assert synced


def test_lines_with_any_character_come_back_as_they_were(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.open("p")
    kept.journal.lines("p", 1, ["(a\nb)", "\x00", "; größer ✓"])
    kept.settle()
    assert read_lines_before(kept.path, "p", 4) == ["(a\nb)", "\x00", "; größer ✓"]


def test_lines_that_are_not_all_there_are_refused(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.open("p", start_line=10)
    kept.journal.lines("p", 10, ["ten"])
    kept.settle()
    with pytest.raises(ServiceError, match="MC514: "):
        read_lines_before(kept.path, "p", 11)


def test_a_resumed_program_can_be_resumed_again(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.open("p", start_line=3, before=["one", "two"])
    kept.journal.lines("p", 3, ["three"])
    kept.settle()
    assert read_lines_before(kept.path, "p", 4) == ["one", "two", "three"]


def test_an_unknown_program_is_refused(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.settle()
    with pytest.raises(ServiceError, match="MC503: "):
        read_lines_before(kept.path, "nobody", 2)


def test_faults_and_ends_are_kept(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.open("p")
    fault = Fault(code="MC407", message="too far", axis=2, line=2)
    kept.journal.progress("p", 2, 1)
    kept.journal.fault(fault, 5.0)
    kept.journal.program_ended("p", "faulted", 1, fault, 6.0)
    kept.settle()
    (program,) = read_programs(kept.path, limit=5)
    assert (program.state, program.done, program.line, program.fault) == ("faulted", 1, 2, fault)


def test_a_new_start_finds_open_programs_interrupted(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.journal.server_started("now", 0.5)
    kept.open("p")
    kept.journal.progress("p", 1, 1)
    kept.settle()
    kept.journal.server_started("later", 9.0)
    kept.settle()
    (program,) = read_programs(kept.path, limit=5)
    assert (program.state, program.done, program.ended_at) == ("interrupted", 1, 9.0)


def test_a_killed_process_loses_nothing_that_was_committed(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    with subprocess.Popen(
        [sys.executable, "-c", CRASHING, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        seen = 0
        for text in process.stdout:
            seen = max(seen, int(text.strip().removeprefix("line")))
            if seen > 2000:
                break
        process.send_signal(signal.SIGKILL)
        for text in process.stdout:
            seen = max(seen, int(text.strip().removeprefix("line")))
    again = Kept(path)
    again.settle()
    again.journal.close()
    (program,) = read_programs(path, limit=5)
    assert program.state == "interrupted"
    assert program.accepted >= seen
    assert program.done <= program.accepted
    assert read_lines_before(path, "p-1", seen + 1) == [f"G01 X{line}" for line in range(1, seen + 1)]


def test_a_journal_that_cannot_be_written_commits_once_it_can(make: Callable[[], Kept]) -> None:
    kept = make()
    kept.open("p")
    kept.settle()
    blocker = sqlite3.connect(kept.path, isolation_level=None)
    blocker.execute("PRAGMA busy_timeout=0")
    blocker.execute("BEGIN EXCLUSIVE")
    kept.journal.lines("p", 1, ["one"], kept.named("first"))
    kept.turn()
    assert "locked" in kept.failures[0]
    assert not kept.committed
    blocker.execute("ROLLBACK")
    blocker.close()
    while not kept.committed:
        kept.turn()
    assert kept.failures[-1] == ""


def test_a_file_that_is_no_journal_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    path.write_text("something else" * 100)
    with pytest.raises(ServiceError, match="MC520: "):
        open_journal(path)


def test_pruning_keeps_the_newest_programs_and_text(make: Callable[[], Kept]) -> None:
    kept = make()
    for number in range(6):
        kept.open(f"p{number}")
        kept.journal.lines(f"p{number}", 1, ["x" * 100])
        if number < 5:
            kept.journal.program_ended(f"p{number}", "finished", 1, None, 2.0)
    kept.settle()
    connection = open_journal(kept.path)
    with connection:
        for sql, parameters in prune(JournalBounds(ended_programs=2, text_bytes=250)):
            connection.execute(sql, parameters)
    programs = [row[0] for row in connection.execute("SELECT program FROM programs ORDER BY id")]
    chunks = [row[0] for row in connection.execute("SELECT program FROM chunks ORDER BY id")]
    connection.close()
    assert programs == ["p3", "p4", "p5"]
    assert chunks == ["p4", "p5"]
