"""Samples of telemetry into a file, as they come: Parquet, CSV or NPZ, by the file's suffix."""

from __future__ import annotations

import importlib.util
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from mcclient.errors import RequestRefused
from mcclient.sql_text import quoted
from mcclient.telemetry import Samples
from mcclient.types import Info

# A row group of a Parquet file, and what is kept in memory of other formats [rows].
ROWS_AT_ONCE = 60_000
COLUMNS = ("setpoint", "position", "velocity", "torque")


class SampleFile(Protocol):
    """A file that samples go into."""

    def append(self, samples: Samples) -> None: ...
    def finish(self) -> None:
        """Write what is still to be written. Raises OSError."""


def open_sample_file(path: Path, info: Info) -> SampleFile:
    """Return a file for samples, by its suffix; the path has the file once it is finished.

    Raises:
        RequestRefused: MC511 the suffix is not one of these, or what writes it is not installed.
    """
    kinds: dict[str, Callable[[Path, Info], SampleFile]] = {
        ".parquet": ParquetSamples,
        ".csv": CsvSamples,
        ".npz": NpzSamples,
    }
    if path.suffix not in kinds:
        raise RequestRefused(
            "MC511", f"no recording is written as {path.suffix or path.name!r}", "use " + ", ".join(kinds)
        )
    if path.suffix == ".parquet" and importlib.util.find_spec("duckdb") is None:
        raise RequestRefused("MC511", f"{path.suffix} needs duckdb", "pip install 'mcclient[record]'")
    return kinds[path.suffix](path, info)


class ColumnSamples:
    """Rows of numbers kept as columns; what is done with a full block is the format's business."""

    def __init__(self, path: Path, info: Info) -> None:
        self._path = path
        self._axes = info.telemetry.axes
        self._epoch = info.epoch
        self._blocks: list[Samples] = []
        self._rows = 0

    def gather(self, samples: Samples) -> dict[str, Any] | None:
        """Keep samples; the columns of a block once it is full."""
        self._blocks.append(samples)
        self._rows += len(samples.time_s)
        return self.columns() if self._rows >= ROWS_AT_ONCE else None

    def columns(self) -> dict[str, Any] | None:
        """Return the columns of what was kept, which is forgotten."""
        blocks, self._blocks, self._rows = self._blocks, [], 0
        if not blocks:
            return None
        time_s = np.concatenate([block.time_s for block in blocks])
        found: dict[str, Any] = {
            "time_s": time_s,
            "unix_s": time_s + self._epoch,
            "cycle": np.concatenate([block.seq + np.arange(len(block.time_s)) for block in blocks]),
        }
        for name in COLUMNS:
            values = np.concatenate([block.fields[name] for block in blocks])
            for column, axis in enumerate(self._axes):
                found[f"{name}_{axis}"] = np.ascontiguousarray(values[:, column])
        return found


class ParquetSamples:
    """A column for each quantity of each axis: ``setpoint_0``, ``position_0``, …"""

    def __init__(self, path: Path, info: Info) -> None:
        import duckdb

        self._columns = ColumnSamples(path, info)
        self._path = path
        # rows wait on the disk beside the file, not in memory
        self._folder = tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}.")
        self._connection = duckdb.connect(str(Path(self._folder.name) / "rows.db"))
        self._any = False

    def append(self, samples: Samples) -> None:
        self._store(self._columns.gather(samples))

    def finish(self) -> None:
        self._store(self._columns.columns())
        partial = _partial(self._path)
        if not self._any:
            self._connection.execute("CREATE TABLE samples (time_s DOUBLE, unix_s DOUBLE, cycle BIGINT)")
        self._connection.execute(f"COPY samples TO {quoted(partial)} (FORMAT parquet, COMPRESSION zstd)")
        self._connection.close()
        self._folder.cleanup()
        os.replace(partial, self._path)

    def _store(self, columns: dict[str, Any] | None) -> None:
        if columns is None:
            return
        self._connection.register("block", columns)
        into = "INSERT INTO samples" if self._any else "CREATE TABLE samples AS"
        self._connection.execute(f"{into} SELECT * FROM block")
        self._connection.unregister("block")
        self._any = True


class CsvSamples:
    """A row a cycle, with the columns of `ParquetSamples`."""

    def __init__(self, path: Path, info: Info) -> None:
        self._columns = ColumnSamples(path, info)
        self._path = path
        self._partial = _partial(path)
        self._stream = self._partial.open("w", encoding="utf-8")
        self._headed = False

    def append(self, samples: Samples) -> None:
        self._columns.gather(samples)
        self._store(self._columns.columns())

    def finish(self) -> None:
        self._stream.close()
        os.replace(self._partial, self._path)

    def _store(self, columns: dict[str, Any] | None) -> None:
        if columns is None:
            return
        if not self._headed:
            self._stream.write(",".join(columns) + "\n")
            self._headed = True
        for row in zip(*(column.tolist() for column in columns.values()), strict=True):
            self._stream.write(",".join(map(repr, row)) + "\n")


class NpzSamples:
    """Arrays ``time_s``, ``line``, ``axes``, ``setpoint``, ``actual``, …; all in memory until the end."""

    def __init__(self, path: Path, info: Info) -> None:
        self._path = path
        self._axes = info.telemetry.axes
        self._blocks: list[Samples] = []

    def append(self, samples: Samples) -> None:
        self._blocks.append(samples)

    def finish(self) -> None:
        blocks = self._blocks
        empty = np.zeros((0, len(self._axes)))
        fields = {"setpoint": "setpoint", "actual": "position", "velocity": "velocity", "torque": "torque"}
        arrays: dict[str, Any] = {
            name: np.concatenate([empty, *(block.fields[field] for block in blocks)])
            for name, field in fields.items()
        }
        time_s = np.concatenate([np.zeros(0), *(block.time_s for block in blocks)])
        arrays["time_s"] = time_s - (time_s[0] if len(time_s) else 0.0)
        arrays["line"] = np.zeros(len(time_s))
        arrays["axes"] = np.array(self._axes, dtype=np.float64)
        partial = _partial(self._path)
        with partial.open("wb") as stream:
            np.savez(stream, **arrays)
        os.replace(partial, self._path)


def _partial(path: Path) -> Path:
    return path.with_name(f".{path.name}.{os.getpid()}.part")
