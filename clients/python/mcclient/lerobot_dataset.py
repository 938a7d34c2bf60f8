"""Recordings as a data set that LeRobot learns from: its format v3.0, Parquet files and what describes them.

An episode is a recording, looked at ``fps`` times a second. Its state is where the axes were; its action is
where they were to be one frame later, which a policy has to send as positions for them to be there by then.
"""

from __future__ import annotations

import importlib.util
import json
import os
import tempfile
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcclient.errors import RequestRefused
from mcclient.sql_text import quoted

Array = NDArray[np.float64]

VERSION = "v3.0"
FILES_A_CHUNK = 1000
STATE, ACTION = "observation.state", "action"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
COUNTERS = ("frame_index", "episode_index", "index", "task_index")
# What reading a file raises that is no recording.
UNREADABLE = (
    AttributeError,
    EOFError,
    KeyError,
    OSError,
    TypeError,
    ValueError,
    zipfile.BadZipFile,
    zlib.error,
)
# Longest gap between two cycles of a recording that is looked across [s].
LONGEST_GAP_S = 0.1


def feature_of(axis: int) -> str:
    """Return the name that LeRobot knows an axis's position by."""
    return f"axis_{axis}.pos"


class Frames(NamedTuple):
    """A recording at the frames of an episode.

    Attributes:
        axes: their numbers. state, action: shape (n, K) [mm or deg].
    """

    axes: tuple[int, ...]
    state: Array
    action: Array


def read_frames(path: Path, fps: int) -> Frames:
    """Read a recording of ``mcctl record`` or ``mcctl run --record``, .npz or .parquet.

    Raises:
        RequestRefused: MC511 it is none, is shorter than two frames, or has a gap.
    """
    try:
        axes, time_s, setpoint, position = (_npz if path.suffix == ".npz" else _parquet)(path)
    except UNREADABLE as error:
        raise _refused(path, f"is no recording ({error})", "give .npz or .parquet of mcctl record") from error
    count = int((time_s[-1] - time_s[0]) * fps + 1e-6) if len(time_s) else 0
    if count < 2:
        raise _refused(path, f"has no two frames at {fps} a second", "record longer")
    steps = np.diff(time_s)
    if not (steps > 0.0).all() or steps.max() > LONGEST_GAP_S:
        at = float(time_s[int(np.argmax(steps))] - time_s[0])
        raise _refused(path, f"has a gap of {steps.max():.3f} s at {at:.3f} s", "record it again")
    if not (np.isfinite(setpoint).all() and np.isfinite(position).all()):
        raise _refused(path, "has numbers that are not finite", "record it again")
    frames = time_s[0] + np.arange(count + 1) / fps
    columns = range(len(axes))
    state = np.column_stack([np.interp(frames, time_s, position[:, each]) for each in columns])
    wanted = np.column_stack([np.interp(frames, time_s, setpoint[:, each]) for each in columns])
    return Frames(axes, state[:-1], wanted[1:])


class DatasetWriter:
    """A data set in a folder that is not there yet; it is one once it is finished.

    Args:
        names: of the axes, which are those of every episode. robot: its type, for people.

    Raises:
        RequestRefused: MC511 the folder is there already, or DuckDB is not installed. OSError.
    """

    def __init__(self, folder: Path, *, fps: int, names: Sequence[str], robot: str = "") -> None:
        if importlib.util.find_spec("duckdb") is None:
            raise RequestRefused("MC511", "a data set needs duckdb", "pip install 'mcclient[record]'")
        if folder.exists():
            raise _refused(folder, "is there already", "name a folder that is not there")
        # it is moved to its place as a whole
        self._made = tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.")
        self._target = folder
        self._folder = Path(self._made.name) / "dataset"
        self._fps = fps
        self._names = list(names)
        self._robot = robot
        self._tasks: dict[str, int] = {}
        self._episodes: list[dict[str, Any]] = []
        self._frames = 0

    def append(self, frames: Frames, task: str) -> None:
        """Write an episode; ``task``: what is done in it, in words. Raises OSError."""
        count, number = len(frames.state), len(self._episodes)
        if frames.state.shape[1] != len(self._names):
            raise RequestRefused("MC511", f"an episode has other axes than {', '.join(self._names)}")
        chunk, file = divmod(number, FILES_A_CHUNK)
        columns: dict[str, NDArray[Any]] = {
            STATE: frames.state.astype(np.float32),
            ACTION: frames.action.astype(np.float32),
            "timestamp": (np.arange(count) / self._fps).astype(np.float32),
            "frame_index": np.arange(count),
            "episode_index": np.full(count, number),
            "index": self._frames + np.arange(count),
            "task_index": np.full(count, self._tasks.setdefault(task, len(self._tasks))),
        }
        self._write_columns(DATA.format(chunk_index=chunk, file_index=file), columns)
        statistics = {
            f"stats/{name}/{key}": value
            for name, column in columns.items()
            for key, value in _statistics(column).items()
        }
        self._episodes.append(
            {
                "episode_index": number,
                "tasks": [task],
                "length": count,
                "data/chunk_index": chunk,
                "data/file_index": file,
                "dataset_from_index": self._frames,
                "dataset_to_index": self._frames + count,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **statistics,
            }
        )
        self._frames += count

    def finish(self) -> None:
        """Write what describes the episodes, of which there is one at least. Raises OSError."""
        self._write_rows(EPISODES, self._episodes)
        rows = [{"task_index": index, "task": task} for task, index in self._tasks.items()]
        # pandas has to be told that the words are the index of the table
        kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
        described = [
            {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy, "metadata": None}
            for name, (kind, numpy) in kinds.items()
        ]
        pandas = json.dumps({"index_columns": ["task"], "column_indexes": [], "columns": described})
        self._write_rows("meta/tasks.parquet", rows, f", KV_METADATA {{pandas: {quoted(pandas)}}}")
        self._write_json("meta/stats.json", self._all_statistics())
        self._write_json("meta/info.json", self._info())
        os.replace(self._folder, self._target)
        self.close()

    def close(self) -> None:
        """Leave nothing of a data set that is not finished."""
        self._made.cleanup()

    def _info(self) -> dict[str, Any]:
        one: dict[str, Any] = {"shape": [1], "names": None}
        axes = {"dtype": "float32", "shape": [len(self._names)], "names": self._names}
        return {
            "codebase_version": VERSION,
            "robot_type": self._robot or None,
            "total_episodes": len(self._episodes),
            "total_frames": self._frames,
            "total_tasks": len(self._tasks),
            "chunks_size": FILES_A_CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": self._fps,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": DATA,
            "video_path": None,
            "features": {
                STATE: axes,
                ACTION: axes,
                "timestamp": {"dtype": "float32", **one},
                **{name: {"dtype": "int64", **one} for name in COUNTERS},
            },
        }

    def _all_statistics(self) -> dict[str, dict[str, list[float]]]:
        """Return those of all episodes, by those of each."""
        found = {}
        for name in (STATE, ACTION, "timestamp", *COUNTERS):
            each = {
                key: np.array([episode[f"stats/{name}/{key}"] for episode in self._episodes], np.float64)
                for key in ("min", "max", "mean", "std", "count")
            }
            share = each["count"] / each["count"].sum()
            mean = (share * each["mean"]).sum(axis=0)
            variance = (share * (each["std"] ** 2 + (each["mean"] - mean) ** 2)).sum(axis=0)
            found[name] = {
                "min": each["min"].min(axis=0).tolist(),
                "max": each["max"].max(axis=0).tolist(),
                "mean": mean.tolist(),
                "std": np.sqrt(variance).tolist(),
                "count": [int(each["count"].sum())],
            }
        return found

    def _write_columns(self, place: str, columns: Mapping[str, NDArray[Any]]) -> None:
        """Write a Parquet file; columns of shape (n, K > 1) have a list in each row."""
        import duckdb

        flat: dict[str, NDArray[Any]] = {}
        chosen = []
        for number, (name, values) in enumerate(columns.items()):
            parts = values.reshape(len(values), -1).T
            flat |= {f"c{number}_{part}": np.ascontiguousarray(each) for part, each in enumerate(parts)}
            listed = ", ".join(f"c{number}_{part}" for part in range(len(parts)))
            chosen.append(f'{listed if len(parts) == 1 else f"[{listed}]"} AS "{name}"')
        with duckdb.connect() as connection:
            connection.register("block", flat)
            self._copy(connection, place, f"SELECT {', '.join(chosen)} FROM block")

    def _write_rows(self, place: str, rows: Sequence[Mapping[str, Any]], options: str = "") -> None:
        """Write a Parquet file of rows with the same keys."""
        import duckdb

        kinds = {name: _sql_kind(value) for name, value in rows[0].items()}
        text = Path(self._made.name) / "rows.json"
        text.write_text("\n".join(json.dumps(row) for row in rows), encoding="utf-8")
        declared = ", ".join(f"{quoted(name)}: {quoted(kind)}" for name, kind in kinds.items())
        with duckdb.connect() as connection:
            found = f"read_json({quoted(text)}, format = 'newline_delimited', columns = {{{declared}}})"
            self._copy(connection, place, f"SELECT * FROM {found}", options)

    def _copy(self, connection: Any, place: str, query: str, options: str = "") -> None:
        connection.execute(f"COPY ({query}) TO {quoted(self._path(place))} (FORMAT parquet{options})")

    def _write_json(self, place: str, content: Mapping[str, Any]) -> None:
        text = json.dumps(content, indent=4, ensure_ascii=False)
        self._path(place).write_text(f"{text}\n", encoding="utf-8")

    def _path(self, place: str) -> Path:
        path = self._folder / place
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def _sql_kind(value: Any) -> str:
    """Return DuckDB's type of a value as JSON has it."""
    if isinstance(value, list):
        return f"{_sql_kind(value[0])}[]"
    return {int: "BIGINT", float: "DOUBLE", str: "VARCHAR"}[type(value)]


def _statistics(column: NDArray[Any]) -> dict[str, list[float] | list[int]]:
    """Return what LeRobot normalizes by, of an episode's column."""
    values = column.reshape(len(column), -1).astype(np.float64)
    named = {"min": values.min(axis=0), "max": values.max(axis=0), "mean": values.mean(axis=0)}
    found = {key: each.tolist() for key, each in (named | {"std": values.std(axis=0)}).items()}
    return {**found, "count": [len(values)]}


def _npz(path: Path) -> tuple[tuple[int, ...], Array, Array, Array]:
    with path.open("rb") as stream, np.load(stream) as archive:
        axes = tuple(int(axis) for axis in archive["axes"])
        time_s, setpoint, actual = (
            archive[name].astype(np.float64) for name in ("time_s", "setpoint", "actual")
        )
    if setpoint.shape != (len(time_s), len(axes)) or actual.shape != setpoint.shape:
        raise ValueError("its arrays do not fit each other")
    return axes, time_s, setpoint, actual


def _parquet(path: Path) -> tuple[tuple[int, ...], Array, Array, Array]:
    import duckdb

    try:
        with duckdb.connect() as connection:
            columns = connection.execute(
                f"SELECT * FROM read_parquet({quoted(path)}) ORDER BY time_s"
            ).fetchnumpy()
    except duckdb.Error as error:
        raise ValueError(str(error)) from error
    axes = tuple(int(name.removeprefix("position_")) for name in columns if name.startswith("position_"))
    setpoint, position = (
        np.column_stack([np.ma.filled(np.ma.asarray(columns[f"{name}_{axis}"]), np.nan) for axis in axes])
        for name in ("setpoint", "position")
    )
    return axes, np.asarray(columns["time_s"], np.float64), setpoint, position


def _refused(path: Path, what: str, hint: str) -> RequestRefused:
    return RequestRefused("MC511", f"{path} {what}", hint)
