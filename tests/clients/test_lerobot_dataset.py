"""Recordings as a data set of LeRobot: what is in its files, and what is refused."""

from __future__ import annotations

import json
from pathlib import Path

import duckdb
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcclient.cli.app import run_command_line
from mcclient.errors import RequestRefused
from mcclient.lerobot_dataset import read_frames

TIME_S = np.arange(0.0, 2.0, 0.001)


def recording(path: Path, speed: float = 1.0, axes: tuple[int, ...] = (0, 4)) -> Path:
    """Axes that go at constant speeds, 1 behind where they are to be."""
    setpoint = np.outer(TIME_S, speed * (1.0 + np.arange(len(axes))))
    np.savez(path, time_s=TIME_S, axes=np.array(axes, float), setpoint=setpoint, actual=setpoint - 1.0)
    return path


def made(folder: Path, *files: Path, task: str = "wave it's arm", fps: int = 20) -> int:
    return run_command_line(
        ["record", "dataset", str(folder), *map(str, files), "--task", task, "--fps", str(fps)]
    )


def test_an_episode_has_where_axes_are_and_where_they_are_to_be_a_frame_later(tmp_path: Path) -> None:
    frames = read_frames(recording(tmp_path / "one.npz", 3.0), 20)
    assert frames.axes == (0, 4)
    assert len(frames.state) == 39
    assert frames.state[10].tolist() == pytest.approx([3.0 * 0.5 - 1.0, 6.0 * 0.5 - 1.0])
    assert frames.action[10].tolist() == pytest.approx([3.0 * 0.55, 6.0 * 0.55])


def test_parquet_of_the_recorder_gives_the_same_frames(tmp_path: Path) -> None:
    npz = read_frames(recording(tmp_path / "one.npz"), 30)
    path = tmp_path / "one.parquet"
    duckdb.execute(
        f"COPY (SELECT i * 0.001 AS time_s, time_s AS setpoint_0, 2 * time_s AS setpoint_4, "
        f"time_s - 1 AS position_0, 2 * time_s - 1 AS position_4 FROM range(2000) t(i)) TO '{path}'"
    )
    parquet = read_frames(path, 30)
    assert parquet.axes == npz.axes
    assert np.allclose(parquet.state, npz.state)
    assert np.allclose(parquet.action, npz.action)


def test_a_data_set_has_the_files_of_its_format(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    assert made(folder, recording(tmp_path / "a.npz"), recording(tmp_path / "b.npz", -5.0)) == 0
    info = json.loads((folder / "meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"]) == ("v3.0", 20, 2)
    assert (info["total_frames"], info["total_tasks"], info["splits"]) == (78, 1, {"train": "0:2"})
    action = {"dtype": "float32", "shape": [2], "names": ["axis_0.pos", "axis_4.pos"]}
    assert info["features"]["action"] == action
    rows = duckdb.sql(f"SELECT * FROM '{folder}/data/*/*.parquet' ORDER BY index")
    kinds = dict(zip(rows.columns, map(str, rows.types), strict=True))
    assert kinds == {
        name: "FLOAT[]"
        if feature["shape"] == [2]
        else {"float32": "FLOAT", "int64": "BIGINT"}[feature["dtype"]]
        for name, feature in info["features"].items()
    }
    found = rows.fetchnumpy()
    assert found["index"].tolist() == list(range(78))
    assert found["episode_index"].tolist() == [0] * 39 + [1] * 39
    assert found["timestamp"][[0, 1, 39]].tolist() == pytest.approx([0.0, 0.05, 0.0])
    episodes = duckdb.sql(f"SELECT * FROM '{folder}/meta/episodes/*/*.parquet'").fetchall()
    assert [row[:7] for row in episodes] == [
        (0, ["wave it's arm"], 39, 0, 0, 0, 39),
        (1, ["wave it's arm"], 39, 0, 1, 39, 78),
    ]
    actions = np.array(found["action"].tolist(), np.float64)
    said = json.loads((folder / "meta/stats.json").read_text())["action"]
    for name, wanted in (("mean", actions.mean(axis=0)), ("std", actions.std(axis=0))):
        assert said[name] == pytest.approx(wanted.tolist())
    assert (said["min"], said["count"]) == (actions.min(axis=0).tolist(), [78])


def test_the_words_of_a_task_are_the_index_that_pandas_reads(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    made(folder, recording(tmp_path / "a.npz"))
    place = folder / "meta/tasks.parquet"
    assert duckdb.sql(f"SELECT task_index, task FROM '{place}'").fetchall() == [(0, "wave it's arm")]
    ((kept,),) = duckdb.sql(
        f"SELECT value FROM parquet_kv_metadata('{place}') WHERE key = 'pandas'"
    ).fetchall()
    assert json.loads(kept)["index_columns"] == ["task"]


def test_a_machine_of_one_axis_has_numbers_without_lists(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    assert made(folder, recording(tmp_path / "a.npz", axes=(3,))) == 0
    assert duckdb.sql(f"SELECT action FROM '{folder}/data/*/*.parquet'").types == ["FLOAT"]


def test_what_is_no_data_set_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, good = tmp_path / "set", recording(tmp_path / "a.npz")
    other = recording(tmp_path / "b.npz", axes=(0, 1))
    before = sorted(tmp_path.iterdir())
    for said, file in (("other axes", other), ("no recording", tmp_path / "none.npz")):
        assert made(folder, good, file) != 0
        assert said in capsys.readouterr().err
    assert made(folder, good, fps=1000) == 0
    assert made(folder, good) != 0
    assert "is there already" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == [*before, folder]


def test_gaps_and_numbers_that_are_none_are_refused(tmp_path: Path) -> None:
    times = np.concatenate((TIME_S, TIME_S + 2.3))
    zeros = np.zeros((len(times), 1))
    for said, time_s, actual in (
        ("gap of 0.301 s at 1.999 s", times, zeros),
        ("not finite", np.arange(len(times)) * 1e-3, zeros + np.nan),
        ("no two frames", times[:20], zeros[:20]),
        ("do not fit", times[:-1], zeros),
    ):
        np.savez(
            tmp_path / "x.npz", time_s=time_s, axes=np.zeros(1), setpoint=zeros[: len(actual)], actual=actual
        )
        with pytest.raises(RequestRefused, match=said):
            read_frames(tmp_path / "x.npz", 30)


@settings(max_examples=12, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200), st.sampled_from([".npz", ".parquet"]), st.integers(0, 150))
def test_no_file_that_is_none_gets_through(tmp_path: Path, noise: bytes, suffix: str, cut: int) -> None:
    path = tmp_path / f"noise{suffix}"
    made_before = tmp_path / "whole.npz"
    whole = (made_before if made_before.exists() else recording(made_before)).read_bytes()
    for content in (noise, whole[:cut] + noise):
        path.write_bytes(content)
        with pytest.raises(RequestRefused, match="MC511"):
            read_frames(path, 30)
