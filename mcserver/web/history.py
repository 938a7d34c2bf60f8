"""The history of a fleet as Parquet: events, line reports and states, by day.

Rows gather in files of JSON lines, which outlive this process; from time to time each becomes Parquet files
that any engine reads. What a kill leaves behind is written at the next start.
"""

from __future__ import annotations

import fcntl
import os
import secrets
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, BinaryIO

import duckdb
import msgspec
from mcclient import Event, MachineStatus
from mcclient.sql_text import quoted

from mcserver.errors import ServiceError

SPOOL = ".spool"
# Bytes of one table that gather before they become Parquet, whatever the time.
MAX_SPOOL = 64 << 20

TABLES: Mapping[str, Mapping[str, str]] = {
    "events": {
        "time": "TIMESTAMP",
        "machine": "VARCHAR",
        "instance": "VARCHAR",
        "seq": "BIGINT",
        "t": "DOUBLE",
        "kind": "VARCHAR",
        "program": "VARCHAR",
        "client": "VARCHAR",
        "state": "VARCHAR",
        "line": "BIGINT",
        "axis": "INTEGER",
        "code": "VARCHAR",
        "reason": "VARCHAR",
        "message": "VARCHAR",
    },
    "lines": {
        "time": "TIMESTAMP",
        "machine": "VARCHAR",
        "instance": "VARCHAR",
        "program": "VARCHAR",
        "line": "BIGINT",
        "start_s": "DOUBLE",
        "end_s": "DOUBLE",
        "requested_s": "DOUBLE",
        "stretched_by": "DOUBLE",
        "bound_by": "VARCHAR",
    },
    "states": {
        "time": "TIMESTAMP",
        "machine": "VARCHAR",
        "instance": "VARCHAR",
        "t": "DOUBLE",
        "state": "VARCHAR",
        "override": "DOUBLE",
        "late_cycles": "BIGINT",
        "faults": "VARCHAR[]",
        "program": "VARCHAR",
        "program_state": "VARCHAR",
        "line": "BIGINT",
        "progress": "DOUBLE",
        "axes": "INTEGER[]",
        "position": "DOUBLE[]",
        "setpoint": "DOUBLE[]",
        "velocity": "DOUBLE[]",
        "torque": "DOUBLE[]",
    },
}

Row = dict[str, Any]


def event_rows(machine: str, event: Event) -> Iterable[tuple[str, Row]]:
    """Table and row of an event, or of each line that it reports."""
    if event.kind == "lines.started":
        return
    if event.kind == "lines.ended":
        for line in event.lines:
            yield (
                "lines",
                {
                    "time": _time(event.wall - event.t + line.end_s),
                    "machine": machine,
                    "instance": event.instance,
                    "program": event.program,
                    "line": line.line,
                    "start_s": line.start_s,
                    "end_s": line.end_s,
                    "requested_s": line.requested_s,
                    "stretched_by": line.stretched_by,
                    "bound_by": line.bound_by,
                },
            )
        return
    fault = event.fault
    yield (
        "events",
        {
            "time": _time(event.wall),
            "machine": machine,
            "instance": event.instance,
            "seq": event.seq,
            "t": event.t,
            "kind": event.kind,
            "program": event.program,
            "client": event.client,
            "state": event.state,
            "line": (fault.line if fault is not None else event.line) or None,
            "axis": fault.axis if fault is not None else event.axis,
            "code": fault.code if fault is not None else (event.reason if event.kind == "warning" else None),
            "reason": event.reason,
            "message": fault.message if fault is not None else event.message,
        },
    )


def state_row(machine: str, status: MachineStatus) -> tuple[str, Row]:
    """Table and row of a machine's state."""
    program = next((each for each in status.programs if each.state in ("running", "held", "paused")), None)
    return "states", {
        "time": _time(status.wall),
        "machine": machine,
        "instance": status.instance,
        "t": status.t,
        "state": status.state,
        "override": status.override,
        "late_cycles": status.late_cycles,
        "faults": [fault.code for fault in status.faults],
        "program": None if program is None else program.program,
        "program_state": None if program is None else program.state,
        "line": None if program is None else program.line,
        "progress": None if program is None else program.progress,
        "axes": status.axes.index,
        "position": status.axes.position,
        "setpoint": status.axes.setpoint,
        "velocity": status.axes.velocity,
        "torque": status.axes.torque,
    }


def _time(unix_s: float) -> str:
    """As DuckDB reads it, in UTC to the microsecond."""
    return datetime.fromtimestamp(unix_s, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")


class HistoryFolder:
    """Writes rows; Parquet files of all machines appear whole, under ``TABLE/day=D/``.

    Args:
        folder: made if missing. clock: Unix time [s]. period_s: between two writings of Parquet.

    Raises:
        ServiceError: MC069 the folder cannot be written, or another one writes there.
    """

    def __init__(self, folder: Path, clock: Callable[[], float], period_s: float) -> None:
        self._folder = folder
        self._clock = clock
        self._period_s = period_s
        self._encode = msgspec.json.Encoder().encode
        self._spools: dict[str, BinaryIO] = {}
        try:
            (folder / SPOOL).mkdir(parents=True, exist_ok=True)
            # what another one is writing is not left behind
            self._lock = (folder / SPOOL / "lock").open("wb")
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for left in sorted((folder / SPOOL).glob("*.ndjson")):
                self._convert(left.name.partition(".")[0], left)
        except BlockingIOError as error:
            self._lock.close()
            raise ServiceError(
                "MC069", f"another mcserver history writes into {folder}", "give another folder"
            ) from error
        except OSError as error:
            raise self._refusal(error) from error
        self._written_at = clock()

    def append(self, rows: Iterable[tuple[str, Row]]) -> None:
        """Keep rows. Raises ServiceError MC069."""
        try:
            for table, row in rows:
                spool = self._spools.get(table)
                if spool is None:
                    name = f"{table}.{os.getpid()}-{secrets.token_hex(4)}.ndjson"
                    spool = self._spools[table] = (self._folder / SPOOL / name).open("wb")
                spool.write(self._encode(row) + b"\n")
            full = any(spool.tell() > MAX_SPOOL for spool in self._spools.values())
            if full or self._clock() - self._written_at >= self._period_s:
                self.write()
        except OSError as error:
            raise self._refusal(error) from error

    def close(self) -> None:
        """Write what has gathered, and let another one write. Raises ServiceError MC069."""
        try:
            self.write()
        finally:
            self._lock.close()

    def write(self) -> None:
        """Make Parquet of all rows. Raises ServiceError MC069."""
        self._written_at = self._clock()
        spools, self._spools = self._spools, {}
        try:
            for table, spool in spools.items():
                spool.close()
                self._convert(table, Path(spool.name))
        except OSError as error:
            raise self._refusal(error) from error

    def _convert(self, table: str, spool: Path) -> None:
        columns = TABLES.get(table)
        if columns is None or spool.stat().st_size == 0:
            spool.unlink()
            return
        with duckdb.connect() as connection:
            described = "{" + ", ".join(f"'{name}': '{kind}'" for name, kind in columns.items()) + "}"
            # the last line may have been cut off by a kill
            connection.execute(
                f"CREATE TABLE rows AS SELECT *, CAST(time AS DATE) AS day FROM read_json({quoted(spool)},"
                f" format='newline_delimited', ignore_errors=true, columns={described})"
                " WHERE time IS NOT NULL AND machine IS NOT NULL"
            )
            for (day,) in connection.execute("SELECT DISTINCT day FROM rows").fetchall():
                folder = self._folder / table / f"day={day}"
                folder.mkdir(parents=True, exist_ok=True)
                target = folder / f"{spool.name.removesuffix('.ndjson')}.parquet"
                partial = target.with_suffix(".part")
                # by machine: an engine skips the row groups of others
                connection.execute(
                    f"COPY (SELECT * EXCLUDE (day) FROM rows WHERE day = ? ORDER BY machine, time)"
                    f" TO {quoted(partial)} (FORMAT parquet, COMPRESSION zstd)",
                    [day],
                )
                os.replace(partial, target)
        spool.unlink()

    def _refusal(self, error: OSError) -> ServiceError:
        return ServiceError(
            "MC069", f"the history cannot be written: {error}", "make room, or give another folder"
        )
