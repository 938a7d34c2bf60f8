"""A damaged journal is noticed at the start; nothing of its history goes silently."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
from collections.abc import Callable
from functools import partial
from pathlib import Path
from queue import SimpleQueue

import pytest

from mcserver.errors import ServiceError
from mcserver.service.journal import Journal
from mcserver.service.journal_check import JournalLock, database_damage, repair_journal, wal_damage
from mcserver.service.journal_file import PAGE_BYTES, open_journal
from mcserver.service.journal_reader import read_lines_before, read_programs
from tests.service.conftest import Bench
from tests.service.fakes import open_program

LIMIT_S = 5.0
FRAME = 24 + PAGE_BYTES


def crashed_journal(path: Path, programs: int = 8) -> None:
    """Files as a killed server leaves them: commits in the write-ahead log, nothing checkpointed."""
    calls: SimpleQueue[Callable[[], None]] = SimpleQueue()
    live = path.with_name("live.db")
    journal = Journal(live, call_soon=calls.put, on_failure=print)
    for number in range(programs):
        name = f"p{number}"
        open_program(journal, name, instance="one")
        journal.lines(name, 1, ["G01 X1", "G01 X2"])
        settled: list[bool] = []
        journal.after(partial(settled.append, True))
        while not settled:
            calls.get(timeout=LIMIT_S)()
    for suffix in ("", "-wal", "-shm"):
        shutil.copy2(f"{live}{suffix}", f"{path}{suffix}")
    journal.close()


def flip(path: Path, at: int) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 0x10
    path.write_bytes(content)


def test_a_journal_of_a_killed_server_is_sound(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    crashed_journal(path)
    assert wal_damage(path) == ""
    assert repair_journal(path) is None
    assert len(read_programs(path, limit=20)) == 8


def test_a_flipped_byte_anywhere_in_the_log_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    crashed_journal(path)
    wal = Path(f"{path}-wal")
    sound, size = wal.read_bytes(), wal.stat().st_size
    for at in [0, 5, 9, 20, *range(32, size, 997), size - 1]:
        flip(wal, at)
        assert wal_damage(path), f"byte {at} of {size}"
        wal.write_bytes(sound)
    assert wal_damage(path) == ""


def test_a_write_that_was_cut_short_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    crashed_journal(path)
    wal = Path(f"{path}-wal")
    sound = wal.read_bytes()
    wal.write_bytes(sound + sound[32 : 32 + FRAME // 2])
    assert wal_damage(path) == ""
    assert len(read_programs(path, limit=20)) == 8


def test_a_log_that_lost_its_end_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    crashed_journal(path)
    wal = Path(f"{path}-wal")
    wal.write_bytes(wal.read_bytes()[:-FRAME])
    assert "last 1 pages" in wal_damage(path)


def test_what_came_before_the_damage_of_the_log_is_kept_and_the_rest_is_put_aside(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    crashed_journal(path)
    wal = Path(f"{path}-wal")
    flip(wal, 3 * wal.stat().st_size // 4)
    before = wal.read_bytes()
    damage = repair_journal(path)
    assert damage is not None
    assert Path(f"{damage.kept}-wal").read_bytes() == before
    open_journal(path).close()
    assert 0 < len(read_programs(path, limit=20)) < 8


def checkpointed(path: Path) -> None:
    crashed_journal(path)
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA wal_checkpoint(TRUNCATE)")


def test_a_flipped_byte_of_a_record_is_noticed_and_the_journal_begins_anew(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    checkpointed(path)
    assert database_damage(path) == ""
    flip(path, path.read_bytes().index(b"G01 X2") + 5)
    damage = repair_journal(path)
    assert damage is not None
    assert "chunks" in damage.message
    assert not path.exists()
    open_journal(path).close()
    assert read_programs(path, limit=20) == []
    assert b"G01 X" in damage.kept.read_bytes()


def test_a_damaged_structure_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    checkpointed(path)
    content = bytearray(path.read_bytes())
    content[4096 : 4096 + 64] = b"\xff" * 64
    path.write_bytes(content)
    damage = repair_journal(path)
    assert damage is not None
    assert "damaged" in damage.message


def test_a_journal_of_the_first_version_is_read_on(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    checkpointed(path)
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for table in ("programs", "chunks", "reports", "faults"):
            connection.execute(f"ALTER TABLE {table} DROP COLUMN crc")
        connection.execute("PRAGMA user_version=1")
    assert repair_journal(path) is None
    open_journal(path).close()
    assert read_lines_before(path, "p3", 3) == ["G01 X1", "G01 X2"]


def test_a_second_server_on_the_same_journal_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    held = JournalLock(path)
    with pytest.raises(ServiceError) as refused:
        JournalLock(path)
    assert refused.value.code == "MC526"
    held.release()
    JournalLock(path).release()


async def test_a_second_service_leaves_the_programs_of_the_first_one_alone(tmp_path: Path) -> None:
    first = Bench(tmp_path / "journal.db")
    first.service.start()
    program = await first.service.open("hmi")
    with pytest.raises(ServiceError) as refused:
        Bench(tmp_path / "journal.db", "two")
    assert refused.value.code == "MC526"
    (known,) = await first.service.known(program_id=program.program, ended=True, limit=5)
    assert known.state == "running"
    await first.service.stop()
    later = Bench(tmp_path / "journal.db", "two")
    later.service.start()
    await later.service.stop()


async def test_the_start_on_a_damaged_journal_says_so(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "journal.db"
    crashed_journal(path)
    flip(Path(f"{path}-wal"), 5000)
    bench = Bench(path)
    bench.service.start()
    warnings = [event for event in bench.events if event.reason == "MC527"]
    assert len(warnings) == 1
    assert "damaged-" in warnings[0].message
    assert "MC527" in caplog.text
    await bench.service.stop()
