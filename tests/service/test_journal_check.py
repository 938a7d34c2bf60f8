"""A damaged journal is noticed at the start: nothing of it is wrong, and nothing goes without a name."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from mcserver.errors import ServiceError
from mcserver.service import commit_record
from mcserver.service.commit_record import commit_record_path, read_commit_record
from mcserver.service.journal_file import NAMES, open_journal, row_checksum
from mcserver.service.journal_reader import read_lines_before, read_programs
from mcserver.service.journal_repair import Damage, JournalLock, prepare_journal
from tests.bench.journal_damage import SUFFIXES, Writer, make_journals, run
from tests.service.conftest import Bench
from tests.service.fakes import open_program

# One start after each damage: 20 ms.
DAMAGES = 100


def ended_and_running(path: Path) -> Writer:
    """Programs ``ended`` and ``running`` with two lines each, in a journal that is open."""
    writer = Writer(path)
    for name in ("ended", "running"):
        open_program(writer.journal, name, instance="one")
        writer.journal.lines(name, 1, ["G01 X1", "G01 X2"])
        writer.journal.progress(name, 2, 1)
    writer.journal.program_ended("ended", "finished", 2, None, 9.0)
    writer.settle()
    return writer


def stopped(path: Path) -> None:
    ended_and_running(path).journal.close()


def change(path: Path, statement: str) -> None:
    """Change a row as damage does: no checksum follows."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        assert connection.execute(statement).rowcount > 0


def prepared(path: Path) -> Damage:
    damage = prepare_journal(path)
    assert damage is not None
    Writer(path).journal.close()
    return damage


def programs_of(path: Path) -> list[str]:
    return [each.program for each in read_programs(path, limit=50)]


def test_random_damage_is_repaired_set_aside_by_name_or_refused() -> None:
    wrong: list[str] = []
    verdicts = run(DAMAGES, 1_000_000, report=wrong.append)
    assert wrong == []
    assert {"harmless", "set aside", "refused"} <= set(verdicts)


def test_journals_of_killed_and_stopped_servers_are_sound(tmp_path: Path) -> None:
    for path in make_journals(tmp_path, 1):
        assert prepare_journal(path) is None
        open_journal(path).close()
        assert len(programs_of(path)) == 20


@pytest.mark.parametrize(
    "column",
    ["done=98", "accepted=1", "started=1", "state='aborted'", "ended_at=1.0", "fault=x'00'", "name='x'"],
)
def test_a_program_with_any_wrong_column_is_set_aside_by_name(tmp_path: Path, column: str) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    change(path, f"UPDATE programs SET {column} WHERE program='ended'")
    damage = prepared(path)
    assert damage.lost == ("ended", "running")
    assert "ended" in damage.message
    assert Path(damage.kept).exists()


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE chunks SET last=1 WHERE program='running'",
        "UPDATE chunks SET program='ended' WHERE program='running'",
        "DELETE FROM chunks WHERE program='running'",
    ],
)
def test_a_program_whose_lines_are_wrong_or_gone_is_set_aside(tmp_path: Path, statement: str) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    change(path, statement)
    assert "running" in prepared(path).lost
    assert "running" not in programs_of(path)


@pytest.mark.parametrize(
    "statement",
    # of a program and of the counts themselves
    ["DELETE FROM programs WHERE program='running'", "UPDATE sums SET rows=7 WHERE of='programs'"],
)
def test_a_program_that_is_gone_is_named_by_what_is_left_of_it(tmp_path: Path, statement: str) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    change(path, statement)
    assert prepared(path).lost == ("running",)
    assert programs_of(path) == ["ended"]


def test_where_nothing_names_the_programs_that_are_gone_the_start_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    for table in ("programs", "chunks"):
        with closing(sqlite3.connect(path, isolation_level=None)) as connection:
            connection.execute(f"DELETE FROM {table}")
    with pytest.raises(ServiceError, match="which programs"):
        prepare_journal(path)


def test_a_broken_index_costs_nothing(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        (page,) = connection.execute(
            "SELECT rootpage FROM sqlite_master WHERE name='chunks_by_program'"
        ).fetchone()
        (size,) = connection.execute("PRAGMA page_size").fetchone()
    content = bytearray(path.read_bytes())
    content[page * size - 20 : page * size] = bytes(20)
    path.write_bytes(content)
    assert prepared(path).lost == ()
    assert programs_of(path) == ["running", "ended"]
    assert read_lines_before(path, "ended", 3) == ["G01 X1", "G01 X2"]


@pytest.mark.parametrize("gone", [("-wal",), ("-wal", "-shm"), ("",)])
def test_a_log_that_is_gone_is_noticed_and_its_programs_are_named(
    tmp_path: Path, gone: tuple[str, ...]
) -> None:
    path, live = tmp_path / "journal.db", tmp_path / "live.db"
    writer = ended_and_running(live)
    for suffix in set(SUFFIXES) - set(gone):
        Path(f"{path}{suffix}").write_bytes(Path(f"{live}{suffix}").read_bytes())
    writer.journal.close()
    damage = prepared(path)
    assert damage.lost == ("ended", "running")
    assert programs_of(path) == []
    assert prepare_journal(path) is None


def test_programs_that_were_set_aside_once_are_not_named_again(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    for name in ("first", "second"):
        writer = Writer(path)
        open_program(writer.journal, name, instance="one")
        writer.settle()
        writer.journal.close()
        change(path, f"UPDATE programs SET done=98 WHERE program='{name}'")
        assert prepared(path).lost == (name,)
    path.unlink()
    assert prepared(path).lost == ()


def test_after_a_power_cut_only_what_the_disk_had_is_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "journal.db"
    writer = ended_and_running(path)
    record = read_commit_record(path)
    writer.journal.close()
    assert record is not None
    assert record.same_boot
    assert record.least == record.committed > 0
    monkeypatch.setattr(commit_record, "_boot_id", lambda: b"another boot id!")
    later = read_commit_record(path)
    assert later is not None
    assert not later.same_boot
    assert later.least == later.synced


@pytest.mark.parametrize("damaged", [False, True])
def test_without_the_count_beside_it_programs_that_had_not_ended_are_set_aside(
    tmp_path: Path, damaged: bool
) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    if damaged:
        commit_record_path(path).write_bytes(b"\xff" * 64)
    else:
        commit_record_path(path).unlink()
    damage = prepared(path)
    assert damage.lost == ("running",)
    assert "-commits" in damage.message
    assert programs_of(path) == ["ended"]
    assert prepare_journal(path) is None


def test_where_database_and_count_are_gone_nobody_says_that_nothing_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    writer = ended_and_running(path)
    writer.journal.write_pending()
    for name in (path.name, commit_record_path(path).name):
        (tmp_path / name).unlink()
    damage = prepare_journal(path)
    writer.journal.close()
    if damage is not None:
        assert "no program is lost" not in damage.message


@pytest.mark.parametrize("version", [2, 99])
def test_a_journal_of_another_version_is_refused_and_left_alone(tmp_path: Path, version: int) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute(f"PRAGMA user_version={version}")
    with pytest.raises(ServiceError, match=f"MC520: .* it is of version {version}"):
        prepare_journal(path)
    assert programs_of(path) == ["running", "ended"]


def as_of_version_3(path: Path) -> None:
    """Make of a stopped journal what version 3 would have written: with times of lines, which nobody read."""
    checked = [*NAMES["programs"], "report_rows", "report_sum"]
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.create_function("row_checksum", -1, row_checksum)
        for column in checked[-2:]:
            connection.execute(f"ALTER TABLE programs ADD COLUMN {column} INTEGER NOT NULL DEFAULT 0")
        connection.execute("CREATE TABLE reports(id INTEGER PRIMARY KEY, program, first, last, blob, crc)")
        connection.execute("INSERT INTO reports VALUES (1, 'ended', 1, 2, x'90', 7)")
        connection.execute("UPDATE programs SET report_rows=1, report_sum=7 WHERE program='ended'")
        connection.execute(f"UPDATE programs SET crc=row_checksum({', '.join(checked)})")
        connection.execute("UPDATE sums SET total=(SELECT sum(crc) FROM programs) WHERE of='programs'")
        connection.execute("UPDATE sums SET crc=row_checksum(of, rows, total)")
        connection.execute("PRAGMA user_version=3")


def test_a_journal_of_version_3_keeps_everything_but_the_times_of_its_lines(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    before = read_programs(path, limit=5)
    committed = read_commit_record(path)
    as_of_version_3(path)
    assert prepare_journal(path) is None
    open_journal(path).close()
    assert read_programs(path, limit=5) == before
    assert read_lines_before(path, "running", 3) == ["G01 X1", "G01 X2"]
    assert read_commit_record(path) == committed


def test_damage_of_a_journal_of_version_3_is_named_by_its_program(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    stopped(path)
    as_of_version_3(path)
    change(path, "DELETE FROM chunks WHERE program='ended' AND first=1")
    assert prepared(path).lost == ("ended",)
    assert programs_of(path) == ["running"]


@pytest.mark.parametrize("content", [b"something else" * 100, b"SQLite format 3\0" + bytes(2000), b"x"])
def test_a_file_that_is_no_journal_is_refused_and_left_alone(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "journal.db"
    path.write_bytes(content)
    with pytest.raises(ServiceError, match="MC520: "):
        prepare_journal(path)
    assert path.read_bytes() == content


def test_a_database_of_others_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("CREATE TABLE letters(text)")
    with pytest.raises(ServiceError, match="MC520"):
        prepare_journal(path)


@pytest.mark.parametrize("suffix", ["", "-wal", "-commits"])
def test_a_folder_in_the_place_of_a_file_is_refused_by_mc520(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / "journal.db"
    if suffix:
        stopped(path)
        Path(f"{path}{suffix}").unlink(missing_ok=True)
    Path(f"{path}{suffix}").mkdir()

    def start() -> None:
        prepare_journal(path)
        Writer(path).journal.close()

    with pytest.raises(ServiceError, match=r"MC520.*(folder|directory|unable)"):
        start()


def test_a_second_server_on_the_same_journal_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "journal.db"
    held = JournalLock(path)
    with pytest.raises(ServiceError, match="MC526: "):
        JournalLock(path)
    held.release()
    JournalLock(path).release()


async def test_a_second_service_leaves_the_programs_of_the_first_one_alone(tmp_path: Path) -> None:
    first = Bench(tmp_path / "journal.db")
    first.service.start()
    program = await first.service.open("hmi")
    with pytest.raises(ServiceError, match="MC526: "):
        Bench(tmp_path / "journal.db", "two")
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
    stopped(path)
    change(path, "UPDATE programs SET done=98 WHERE program='ended'")
    bench = Bench(path)
    bench.service.start()
    warnings = [event for event in bench.events if event.reason == "MC527"]
    assert len(warnings) == 1
    assert "ended" in warnings[0].message
    assert "damaged-" in warnings[0].message
    assert "MC527" in caplog.text
    await bench.service.stop()
