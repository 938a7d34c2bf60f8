"""How programs ran last is kept over a restart of the page, within a bound, and stops nothing."""

from __future__ import annotations

from pathlib import Path

from mcserver.web.last_runs import MOST, LastRun, LastRuns

RUN = LastRun("finished", 1000.0, 12.5, "ada")


def test_a_last_run_is_there_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "folder" / ".runs.json"
    LastRuns(path).note("part.nc", RUN)
    assert LastRuns(path).runs == {"part.nc": RUN}


def test_the_oldest_are_forgotten(tmp_path: Path) -> None:
    kept = LastRuns(tmp_path / ".runs.json")
    for number in range(MOST):
        kept.note(f"{number}", RUN)
    kept.note("0", RUN)
    kept.note("new", RUN)
    assert len(kept.runs) == MOST
    assert "1" not in kept.runs
    assert "0" in kept.runs


def test_a_file_that_cannot_be_read_or_written_stops_nothing(tmp_path: Path) -> None:
    path = tmp_path / ".runs.json"
    path.write_text('{"part.nc": 3}', "utf-8")
    assert LastRuns(path).runs == {}
    (tmp_path / "file").write_text("", "utf-8")
    kept = LastRuns(tmp_path / "file" / ".runs.json")
    kept.note("part.nc", RUN)
    assert kept.runs == {"part.nc": RUN}
