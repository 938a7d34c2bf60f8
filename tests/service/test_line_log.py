"""The log of lines: what somebody was waiting for outlives a kill, and comes into the database once."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.service.journal import Journal
from mcserver.service.journal_check import repair_journal
from mcserver.service.journal_file import taken_records
from mcserver.service.journal_reader import read_lines_before, read_programs
from mcserver.service.line_log import LineLog, LoggedLines, line_log_path, read_line_log
from tests.service.fakes import open_program

SIZE = 4096


def message(first: int, *lines: str, program: str = "p") -> LoggedLines:
    return LoggedLines(program, first, first + len(lines) - 1, msgspec.msgpack.encode(lines))


def numbers(path: Path) -> list[int]:
    kept = read_line_log(path)
    assert not kept.damaged
    return [number for number, _ in kept.records]


class Kept:
    """A journal without a thread, on a file; dropping it is what a kill does."""

    def __init__(self, path: Path, **options: int) -> None:
        self.path = path
        self.failures: list[str] = []
        self.journal = Journal(
            path, call_soon=lambda call: call(), on_failure=self.failures.append, threaded=False, **options
        )

    def open(self, program: str = "p") -> None:
        open_program(self.journal, program)
        self.journal.write_pending()

    def line(self, number: int) -> bool:
        """Whether the line was kept before the call returned."""
        kept: list[bool] = []
        self.journal.lines("p", number, [f"line {number}"], lambda: kept.append(True), urgent=True)
        return bool(kept)

    def killed(self) -> None:
        self.journal.close()

    @property
    def lines(self) -> list[str]:
        (program,) = read_programs(self.path, limit=2)
        return read_lines_before(self.path, "p", program.accepted + 1)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "journal.db"


def test_records_come_back_in_order(tmp_path: Path) -> None:
    log = LineLog(tmp_path / "log", 7, size=SIZE)
    sent = [message(1, "G90", "größer ✓"), message(3, "\x00"), message(4, *["x"] * 40)]
    assert [log.append(each) for each in sent] == [8, 9, 10]
    log.close()
    assert read_line_log(tmp_path / "log").records == list(zip([8, 9, 10], sent, strict=True))


def test_a_cleared_log_begins_at_its_start_and_hides_what_was_there(tmp_path: Path) -> None:
    log = LineLog(tmp_path / "log", 0, size=SIZE)
    for line in range(1, 6):
        log.append(message(line, "x"))
    log.clear()
    # as long as those before, so that the next one begins where an old one did
    log.append(message(6, "x"))
    log.close()
    assert numbers(tmp_path / "log") == [6]


def test_a_full_log_takes_no_more_and_keeps_what_it_has(tmp_path: Path) -> None:
    log = LineLog(tmp_path / "log", 0, size=SIZE)
    taken = 0
    while log.append(message(taken + 1, "x" * 50)):
        taken += 1
    assert log.number == taken > 10
    log.close()
    assert len(numbers(tmp_path / "log")) == taken
    assert (tmp_path / "log").stat().st_size == SIZE


def test_a_record_that_cannot_be_written_was_never_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = LineLog(tmp_path / "log", 0, size=SIZE)
    assert log.append(message(1, "one")) == 1
    write = os.pwrite

    def fails(*_: object) -> int:
        raise OSError(errno.EIO, "input/output error")

    monkeypatch.setattr(os, "pwrite", fails)
    assert log.append(message(2, "two")) == 0
    # cut short
    monkeypatch.setattr(os, "pwrite", lambda file, data, at: write(file, data[: len(data) // 2], at))
    assert log.append(message(2, "two")) == 0
    monkeypatch.setattr(os, "pwrite", write)
    assert log.append(message(2, "again")) == 2
    log.close()
    assert numbers(tmp_path / "log") == [1, 2]


def test_a_flipped_byte_anywhere_is_noticed_and_what_came_before_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "log"
    log = LineLog(path, 0, size=SIZE)
    ends = [0]
    for line in range(1, 6):
        log.append(message(line, "G01 X1"))
        ends.append(read_line_log(path).end)
    log.close()
    sound = path.read_bytes()
    for at in range(ends[-1]):
        damaged = bytearray(sound)
        damaged[at] ^= 0x20
        path.write_bytes(damaged)
        kept = read_line_log(path)
        assert kept.damaged, f"byte {at}"
        assert len(kept.records) == sum(at >= end for end in ends[1:])


@given(st.binary(max_size=200))
def test_no_file_makes_the_start_fail(tmp_path_factory: pytest.TempPathFactory, content: bytes) -> None:
    path = tmp_path_factory.mktemp("garbage") / "log"
    path.write_bytes(content)
    read_line_log(path)


def test_lines_of_a_killed_server_come_into_the_database_once(path: Path) -> None:
    first = Kept(path)
    first.open()
    assert all(first.line(number) for number in (1, 2, 3))
    first.killed()
    for _ in range(3):
        again = Kept(path)
        again.journal.write_pending()
        assert again.lines == ["line 1", "line 2", "line 3"]
        again.killed()


def test_a_server_that_is_killed_again_and_again_loses_nothing(path: Path) -> None:
    kept = Kept(path)
    kept.open()
    for number in range(1, 41):
        assert kept.line(number)
        if number % 3 == 0:
            kept.killed()
            kept = Kept(path)
        if number % 5 == 0:
            kept.journal.write_pending()
    kept.journal.write_pending()
    assert kept.lines == [f"line {number}" for number in range(1, 41)]
    kept.killed()


def test_what_was_rejected_does_not_come_back(path: Path) -> None:
    kept = Kept(path)
    kept.open()
    assert kept.line(1)
    assert kept.line(2)
    kept.journal.rejected("p", 2)
    # it waits behind the rejection
    assert not kept.line(2)
    kept.journal.write_pending()
    assert kept.line(3)
    kept.killed()
    again = Kept(path)
    again.journal.write_pending()
    assert again.lines == ["line 1", "line 2", "line 3"]
    again.killed()


def test_a_full_log_sends_lines_through_the_thread_until_the_database_has_them(path: Path) -> None:
    kept = Kept(path, log_bytes=256)
    kept.open()
    number = 1
    while kept.line(number):
        number += 1
    assert number > 2
    assert not kept.line(number + 1)
    kept.journal.write_pending()
    assert kept.line(number + 2)
    kept.journal.write_pending()
    assert kept.lines == [f"line {each}" for each in range(1, number + 3)]
    kept.killed()


def test_a_disk_without_room_for_the_log_is_only_slower(
    path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "no space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    kept = Kept(path)
    kept.open()
    assert not kept.line(1)
    kept.journal.write_pending()
    assert kept.lines == ["line 1"]
    assert "no space left" in caplog.text
    kept.killed()


def test_a_log_beside_an_older_database_adds_no_lines_with_a_gap(path: Path) -> None:
    kept = Kept(path)
    kept.open()
    kept.line(1)
    kept.journal.write_pending()
    backup = path.with_name("backup.db")
    kept.killed()
    shutil.copy2(path, backup)
    kept = Kept(path)
    kept.line(2)
    kept.journal.write_pending()
    kept.line(3)
    kept.killed()
    for suffix in ("-wal", "-shm"):
        Path(f"{path}{suffix}").unlink(missing_ok=True)
    backup.replace(path)
    restored = Kept(path)
    restored.journal.write_pending()
    assert restored.lines == ["line 1"]
    assert taken_records(path) == 3
    restored.killed()


def test_the_start_on_a_damaged_log_keeps_it_aside_and_says_so(path: Path) -> None:
    kept = Kept(path)
    kept.open()
    for number in range(1, 5):
        kept.line(number)
    kept.killed()
    lines = line_log_path(path)
    content = bytearray(lines.read_bytes())
    content[content.index(b"line 3")] ^= 0x01
    lines.write_bytes(content)
    damage = repair_journal(path)
    assert damage is not None
    assert "log of lines" in damage.message
    assert line_log_path(damage.kept).read_bytes() == content
    again = Kept(path)
    again.journal.write_pending()
    assert again.lines == ["line 1", "line 2"]
    again.killed()
    # once is enough
    assert repair_journal(path) is None


def test_lines_wait_for_what_their_program_has_before_them_and_for_nothing_else(path: Path) -> None:
    journal = Journal(path, call_soon=lambda call: call(), on_failure=print, threaded=False)
    order: list[str] = []

    def line(program: str, number: int, name: str, *, urgent: bool = True) -> None:
        journal.lines(program, number, [name], lambda: order.append(name), urgent=urgent)

    line("p", 1, "by the thread", urgent=False)
    line("p", 2, "behind it")
    journal.progress("q", 1, 1)
    journal.after(lambda: order.append("after all"))
    line("q", 1, "at once")
    assert order == ["at once"]
    journal.write_pending()
    assert order == ["at once", "by the thread", "behind it", "after all"]
    line("p", 3, "at once again")
    assert order[-1] == "at once again"
    journal.close()


def test_lines_are_acknowledged_while_the_disk_keeps_the_thread(path: Path) -> None:
    kept = Kept(path)
    kept.open()
    # nothing of it is written for as long as the disk takes
    kept.journal.progress("p", 0, 0)
    assert all(kept.line(number) for number in range(1, 6))
    kept.journal.progress("p", 3, 2)
    kept.journal.rejected("q", 1)
    assert kept.line(6)
    kept.killed()
    again = Kept(path)
    again.journal.write_pending()
    assert again.lines == [f"line {number}" for number in range(1, 7)]
    again.killed()


def test_records_come_into_the_database_in_their_order(path: Path) -> None:
    kept = Kept(path)
    kept.open()
    assert kept.line(1)
    # takes line 1 with it
    kept.journal.progress("p", 0, 0)
    assert kept.line(2)
    # a thread that has just found nothing to do comes too late for line 1, and so for line 2
    assert kept.journal._take_later() == []
    kept.journal.write_pending()
    assert kept.lines == ["line 1", "line 2"]
    assert taken_records(path) == 2
    kept.killed()
