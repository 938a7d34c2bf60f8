"""Telemetry into files."""

from __future__ import annotations

from pathlib import Path

import duckdb
import numpy as np
import pytest
from mcclient.errors import RequestRefused
from mcclient.sample_file import open_sample_file
from mcclient.telemetry import Samples
from mcclient.types import AxisInfo, Info, LimitsInfo, TelemetryInfo

from mcserver.recorder.reading import read_recording
from tests.wire_values import wire_value


def info() -> Info:
    axes = [wire_value(AxisInfo, index, "linear", "mm", 1.0, 1.0, "ideal") for index in (0, 2)]
    return wire_value(
        Info,
        machine="cell",
        server="0",
        protocol=[1],
        instance="i",
        epoch=1000.0,
        cycle_s=0.001,
        axes=axes,
        tools=[],
        telemetry=wire_value(TelemetryInfo, [0, 2], ["setpoint", "position", "velocity", "torque"], 10, 20.0),
        limits=wire_value(LimitsInfo, 1, 1, 1, 1, 1, 1, 1.0),
        methods=[],
    )


def samples(seq: int) -> Samples:
    time_s = 0.001 * (seq + np.arange(10))
    fields = {
        name: np.stack([time_s, -time_s], axis=1) * 2.0**number
        for number, name in enumerate(("setpoint", "position", "velocity", "torque"))
    }
    return Samples(seq, time_s, (0, 2), fields)


def written(path: Path) -> Path:
    file = open_sample_file(path, info())
    for message in range(30):
        file.append(samples(100 + 10 * message))
    file.finish()
    assert [each.name for each in path.parent.iterdir()] == [path.name], "nothing else is left"
    return path


def test_what_was_recorded_here_is_read_by_the_server_s_tools(tmp_path: Path) -> None:
    run = read_recording(written(tmp_path / "x.npz"))
    assert run.cycles.axes.tolist() == [0.0, 2.0]
    np.testing.assert_allclose(run.cycles.setpoint[:, 0], 0.001 * np.arange(100, 400))
    np.testing.assert_allclose(run.cycles.actual[:, 1], -0.002 * np.arange(100, 400))


def test_parquet_has_a_column_for_each_quantity_of_each_axis(tmp_path: Path) -> None:
    path = written(tmp_path / "it's.parquet")
    quoted = str(path).replace("'", "''")
    (row,) = duckdb.sql(
        f"SELECT count(*), min(cycle), max(torque_0), min(position_2), min(unix_s) FROM '{quoted}'"
    ).fetchall()
    assert row[:2] == (300, 100)
    assert row[2:] == (pytest.approx(3.192), pytest.approx(-0.798), pytest.approx(1000.1))


def test_csv_reads_back_exactly(tmp_path: Path) -> None:
    lines = written(tmp_path / "x.csv").read_text().splitlines()
    assert lines[0].startswith("time_s,unix_s,cycle,setpoint_0,setpoint_2,position_0")
    assert float(lines[1].split(",")[0]) == samples(100).time_s[0]
    assert len(lines) == 301


def test_a_recording_without_a_cycle_is_a_file_all_the_same(tmp_path: Path) -> None:
    for suffix in (".parquet", ".csv", ".npz"):
        path = tmp_path / f"x{suffix}"
        open_sample_file(path, info()).finish()
        assert path.exists()


def test_another_suffix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RequestRefused, match="MC511"):
        open_sample_file(tmp_path / "x.xlsx", info())
