"""The history of a fleet as Parquet, and questions to it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import duckdb
import fsspec
import pytest
from mcclient import Event
from mcclient.cli.history import QUESTIONS, SPANS, ask, days_of, sql_of
from mcclient.errors import RequestRefused
from mcclient.types import AxesStatus, Fault, LineReport, MachineStatus

from mcserver.errors import ConfigurationError, ServiceError
from mcserver.web.history import SPOOL, HistoryFolder, event_rows, state_row
from mcserver.web.history_store import HistoryStore
from mcserver.web.panels.past import recordings_of, table_html
from mcserver.web.past import Past
from tests.clock import Clock
from tests.wire_values import wire_value

DAY_S = 86_400.0
NOON = 1_773_489_600.0  # 2026-03-14 12:00 UTC
FAULT = Event(
    seq=4,
    t=2.5,
    wall=NOON + 2.5,
    instance="i",
    kind="fault",
    fault=Fault(code="MC407", message="err", axis=2, line=9),
)
ENDED = Event(seq=5, t=3.0, wall=NOON + 3.0, instance="i", kind="program.ended", program="p", state="faulted")
LINES = Event(
    seq=6,
    t=3.5,
    wall=NOON + 3.5,
    instance="i",
    kind="lines.ended",
    program="p",
    lines=[LineReport(1, 1.0, 2.0, 0.5, 2.0, "axis 0 jerk"), LineReport(2, 2.0, 2.1)],
)


def status(t: float) -> MachineStatus:
    axes = wire_value(AxesStatus, [0, 3], [t, 2.0], [t, 2.0], [0.0, 0.0], [0.1, 0.2], ["moving", "off"])
    return wire_value(MachineStatus, t, NOON + t, "i", "ready", axes, [], [])


def folder_of(path: Path, clock: Callable[[], float] | None = None) -> HistoryFolder:
    return HistoryFolder(path, clock or Clock(NOON), 300.0)


def filled(path: Path) -> None:
    kept = folder_of(path)
    for event in (FAULT, ENDED, LINES):
        kept.append(event_rows("cell-1", event))
    kept.append([state_row("cell-1", status(0.1 * number)) for number in range(20)])
    kept.close()


def test_files_lie_by_day_and_any_engine_reads_them(tmp_path: Path) -> None:
    filled(tmp_path)
    files = {str(path.relative_to(tmp_path).parent) for path in tmp_path.rglob("*.parquet")}
    assert files == {f"{table}/day=2026-03-14" for table in ("events", "lines", "states")}
    (row,) = duckdb.sql(
        f"SELECT count(*), max(position[1]), any_value(axes) FROM '{tmp_path}/states/*/*.parquet'"
    ).fetchall()
    assert row == (20, pytest.approx(1.9), [0, 3])


def test_a_day_s_end_begins_another_folder(tmp_path: Path) -> None:
    kept = folder_of(tmp_path)
    for day in (0.0, DAY_S):
        kept.append(event_rows("m", dataclasses.replace(FAULT, wall=FAULT.wall + day)))
    kept.close()
    assert len(list(tmp_path.glob("events/day=*"))) == 2


def test_an_emergency_stop_among_the_faults_says_what_it_is_and_whose(tmp_path: Path) -> None:
    kept = folder_of(tmp_path)
    stop = Event(seq=7, t=4.0, wall=NOON + 4.0, instance="i", kind="estop", reason="by ada on the page")
    kept.append(event_rows("cell-1", stop))
    kept.close()
    names, (row,) = ask("faults", tmp_path)
    found = dict(zip(names, row, strict=True))
    assert (found["code"], found["message"]) == ("estop", "by ada on the page")


def test_faults_are_found_with_code_axis_and_line(tmp_path: Path) -> None:
    filled(tmp_path)
    names, rows = ask("faults", tmp_path)
    (row,) = [dict(zip(names, row, strict=True)) for row in rows]
    assert (row["machine"], row["code"], row["axis"], row["line"]) == ("cell-1", "MC407", 2, 9)
    assert str(row["time"]).startswith("2026-03-14 12:00:02.5")


@pytest.mark.parametrize("question", sorted(QUESTIONS))
@pytest.mark.parametrize("span", sorted(SPANS))
def test_every_ready_question_is_sound(tmp_path: Path, question: str, span: str) -> None:
    filled(tmp_path)
    names, _ = ask(f"{question} {span}".strip(), tmp_path)
    assert names


def test_a_run_has_its_name_and_its_time_and_a_fault_its_black_box(tmp_path: Path) -> None:
    kept = folder_of(tmp_path)
    kinds = (("program.opened", "part.nc"), ("program.started", ""), ("recording", "blackbox-1"))
    for number, (kind, message) in enumerate(kinds):
        event = Event(
            seq=number, t=2.0, wall=NOON + number, instance="i", kind=kind, program="p", message=message
        )
        for machine in ("cell-1", "cell-2"):
            kept.append(event_rows(machine, event))
    kept.append(event_rows("cell-1", dataclasses.replace(FAULT, wall=NOON + 1.0)))
    kept.append(event_rows("cell-1", ENDED))
    kept.close()
    names, (row,) = ask("programs", tmp_path)
    assert (row[names.index("name")], row[names.index("took_s")]) == ("part.nc", 2.0)
    found = ask("faults", tmp_path, machine="cell-1", threads=1)
    assert recordings_of(found) == ["blackbox-1"]
    assert "<th scope=col>recording</th>" in table_html(found)
    assert "cell-1" not in table_html(found)
    assert '<meter max=100 value="12.5" aria-hidden=true></meter> 12.5<' in table_html(
        (["day", "running_percent"], [("2026-05-05", 12.5)])
    )
    names, (row,) = ask("runs by program", tmp_path)
    assert (row[names.index("name")], *row[2:5]) == ("part.nc", 0, 1, 2.0)
    assert ask("faults", tmp_path, machine="cell-2' OR '1'='1")[1] == []


def test_runs_are_counted_by_program_and_day_without_moves_by_hand_and_drawn_as_bars(tmp_path: Path) -> None:
    kept = folder_of(tmp_path)
    runs = (
        *(("part.nc", "finished", 0), ("part.nc", "finished", 0), ("part.nc", "aborted", 1)),
        *(("jog axis 0", "finished", 0), ("manual input by ada", "finished", 1), ("", "finished", 1)),
    )
    for seq, (name, state, day) in enumerate(runs):
        program = f"p{seq}"
        opened = Event(
            seq=2 * seq, t=0.0, wall=NOON, instance="i", kind="program.opened", program=program, message=name
        )
        ended = dataclasses.replace(
            ENDED, seq=2 * seq + 1, wall=NOON + day * DAY_S, program=program, state=state
        )
        for event in (opened, ended):
            kept.append(event_rows("cell-1", event))
    kept.close()
    _, rows = ask("runs by program", tmp_path)
    assert [row[1:4] for row in rows] == [("part.nc", 2, 1), ("", 1, 0)]
    by_day = ask("runs by day", tmp_path)
    assert [(str(day), *counts) for _, day, *counts in by_day[1]] == [
        ("2026-03-14", 2, 0),
        ("2026-03-15", 1, 1),
    ]
    assert '<meter max=2 value="1.0" aria-hidden=true></meter> 1<' in table_html(by_day)


def test_an_interrupted_run_is_broken_off_and_its_time_until_the_next_start_is_none(tmp_path: Path) -> None:
    kept = folder_of(tmp_path)
    for seq, (program, state, wall) in enumerate((("p1", "finished", 4.0), ("p2", "interrupted", 3600.0))):
        begun = Event(
            seq=3 * seq,
            t=0.0,
            wall=NOON,
            instance="i",
            kind="program.opened",
            program=program,
            message="a.nc",
        )
        kept.append(event_rows("cell-1", begun))
        began = dataclasses.replace(begun, seq=3 * seq + 1, kind="program.started", message="")
        kept.append(event_rows("cell-1", began))
        ended = dataclasses.replace(ENDED, seq=3 * seq + 2, wall=NOON + wall, program=program, state=state)
        kept.append(event_rows("cell-1", ended))
    kept.close()
    names, rows = ask("programs", tmp_path)
    assert [row[names.index("took_s")] for row in rows] == [None, 4.0]
    names, (row,) = ask("runs by program", tmp_path)
    assert row[1:5] == ("a.nc", 1, 1, 4.0)


def test_the_running_time_of_an_hour_is_of_all_days(tmp_path: Path) -> None:
    kept = folder_of(tmp_path)
    for wall, running in ((0.0, True), (DAY_S, False), (3600.0, True)):
        name, row = state_row("cell-1", status(wall))
        kept.append([(name, row | {"program_state": "running" if running else None})])
    kept.close()
    assert ask("running time by hour", tmp_path)[1] == [("cell-1", 12, 50.0, 2), ("cell-1", 13, 100.0, 1)]


async def test_the_page_asks_ready_questions_alone(tmp_path: Path) -> None:
    filled(tmp_path)
    past = Past(tmp_path)
    assert len((await past.ask("faults", ""))[1]) == 1
    with pytest.raises(RequestRefused, match="MC511"):
        await past.ask("SELECT * FROM read_text('/etc/passwd')", "")
    assert await past.running_today() == {}
    assert await Past(tmp_path / "none").running_today() == {}


def test_slow_lines_are_those_that_took_longer_than_asked(tmp_path: Path) -> None:
    filled(tmp_path)
    names, rows = ask("Slow  Lines", tmp_path)
    assert [row[names.index("line")] for row in rows] == [1]


def test_what_is_read_twice_counts_once(tmp_path: Path) -> None:
    filled(tmp_path)
    filled(tmp_path)
    assert ask("SELECT count(*) FROM events", tmp_path)[1] == [(2,)]
    assert ask("SELECT count(*) FROM lines", tmp_path)[1] == [(2,)]


def test_what_a_kill_left_behind_is_written_at_the_next_start(tmp_path: Path) -> None:
    kept = folder_of(tmp_path)
    kept.append(event_rows("m", FAULT))
    (spool,) = (tmp_path / SPOOL).glob("*.ndjson")
    # a kill takes the lock and the open files with it
    kept._spools["events"].close()
    kept._lock.close()
    with spool.open("ab") as stream:
        stream.write(b'{"time": "2026-03-14 12:00:03", "machine": "m", "ki')
    folder_of(tmp_path).close()
    assert ask("SELECT count(*) FROM events", tmp_path)[1] == [(1,)]
    assert list((tmp_path / SPOOL).glob("*.ndjson")) == []


def test_two_cannot_write_into_one_folder(tmp_path: Path) -> None:
    kept = folder_of(tmp_path)
    with pytest.raises(ServiceError, match="another mcserver history"):
        folder_of(tmp_path)
    kept.close()


def test_rows_become_parquet_after_a_while_by_themselves(tmp_path: Path) -> None:
    clock = Clock(NOON)
    kept = folder_of(tmp_path, clock)
    kept.append(event_rows("m", FAULT))
    assert list(tmp_path.rglob("*.parquet")) == []
    clock.now += 301.0
    kept.append(event_rows("m", ENDED))
    assert len(list(tmp_path.rglob("*.parquet"))) == 1
    kept.close()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ServiceError, match="MC069"):
        folder_of(tmp_path / "file" / "x")


def test_a_question_that_is_neither_is_refused_with_those_that_there_are(tmp_path: Path) -> None:
    filled(tmp_path)
    with pytest.raises(RequestRefused, match="faults"):
        ask("what broke", tmp_path)


@pytest.mark.parametrize("question", ["", ";", "-- faults"])
def test_a_question_of_no_statement_is_refused(tmp_path: Path, question: str) -> None:
    filled(tmp_path)
    with pytest.raises(RequestRefused, match="this is no question"):
        ask(question, tmp_path)


def test_a_folder_without_a_history_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RequestRefused, match="no history"):
        ask("faults", tmp_path)


def test_sql_stays_as_it_is() -> None:
    assert sql_of("SELECT 1") == "SELECT 1"


def test_files_move_to_a_store_one_that_fails_stays_and_questions_are_answered_there(tmp_path: Path) -> None:
    filled(tmp_path)
    store = HistoryStore("memory://site/history")
    files: Any = store._files
    files.store.clear()
    (tmp_path / "blocked").touch()
    HistoryStore(f"file://{tmp_path}/blocked").move(tmp_path)
    assert len(list(tmp_path.rglob("*.parquet"))) == 3
    store.move(tmp_path)
    assert not list(tmp_path.rglob("*.parquet"))
    _, rows = ask("SELECT count(*) FROM states WHERE day = '2026-03-14'", "memory://site/history")
    assert rows == [(20,)]
    with pytest.raises(RequestRefused, match="no history"):
        ask("faults", "memory://site/other")


class Closed(fsspec.AbstractFileSystem):  # type: ignore[misc]
    """A store without keys to it."""

    protocol = "closed"

    def glob(self, *_words: object, **_named: object) -> list[str]:
        raise PermissionError("unable to locate credentials")


def test_a_history_that_cannot_be_read_is_refused_with_the_reason(tmp_path: Path) -> None:
    fsspec.register_implementation("closed", Closed, clobber=True)
    with pytest.raises(RequestRefused, match=r"closed://site cannot be read: .*credentials") as refused:
        ask("faults", "closed://site")
    assert (refused.value.code, "\n" in refused.value.message) == ("MC511", False)
    filled(tmp_path)
    (damaged, *_) = tmp_path.glob("events/*/*.parquet")
    damaged.write_bytes(b"no Parquet, but long enough for its magic")
    with pytest.raises(RequestRefused, match="cannot be read"):
        ask("faults", tmp_path)


def test_a_store_that_cannot_be_meant_is_refused() -> None:
    with pytest.raises(ConfigurationError) as refused:
        HistoryStore("nowhere://bucket")
    assert refused.value.code == "MC086"
    with pytest.raises(RequestRefused, match="nowhere"):
        ask("faults", "nowhere://bucket")


@pytest.mark.parametrize(
    ("question", "chosen", "count"),
    [
        ("faults today", None, 1),
        ("faults last  week", None, 8),
        ("faults", None, None),
        ("SELECT 'last week'", None, None),
        ("SELECT 1", "2026-03-14", 1),
        ("faults last month", "2026-03-10..2026-03-14", 5),
    ],
)
def test_a_question_looks_at_the_files_of_its_days_alone(
    question: str, chosen: str | None, count: int | None
) -> None:
    found = days_of(question, chosen, date(2026, 3, 14))
    assert (found and len(found)) == count


@pytest.mark.parametrize("chosen", ["yesterday", "2026-03-14..2026-03-13", "1..2"])
def test_what_is_no_day_is_refused(chosen: str) -> None:
    with pytest.raises(RequestRefused, match="no day"):
        days_of("faults", chosen, date(2026, 3, 14))
