"""The path really taken, as a file: every cycle's setpoints and encoder readings, and the line that set them.

The rows are kept in a file beside the output while the program runs, so that memory does not grow with its
length.
"""

from __future__ import annotations

import asyncio
import os
import tempfile
import zipfile
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from mcclient.errors import MotionError
from mcclient.feed import Feed
from mcclient.machine import Machine
from mcclient.program import Program
from mcclient.reports import Report
from mcclient.telemetry import Samples

Array = NDArray[np.float64]

FIRST_SAMPLES_S = 3.0
LAST_SAMPLES_S = 2.0
REST_S = 0.05
ROWS_AT_ONCE = 8192
HANDOVER_CYCLES = 2


class Spool:
    """Rows of setpoints and readings, one a cycle, in a file.

    Attributes:
        rows: how many there are.
        filled: how many of them were lost on the way, and are interpolated.
    """

    def __init__(self, stream: IO[bytes], axes: tuple[int, ...]) -> None:
        self.axes = axes
        self.rows = 0
        self.filled = 0
        self._stream = stream
        self._next_seq: int | None = None
        self._last: NDArray[np.float32] | None = None

    def append(self, samples: Samples) -> None:
        """Adds a message's rows; cycles that are missing before it lie on a straight line."""
        rows = np.concatenate([samples.setpoint, samples.actual], axis=1).astype("<f4")
        if self._next_seq is not None and self._last is not None:
            missing = samples.seq - self._next_seq
            if missing < 0:
                # repeated on the way, or the server has begun anew
                return
            if missing:
                share = (np.arange(1, missing + 1) / (missing + 1))[:, np.newaxis]
                self._write((self._last + share * (rows[0] - self._last)).astype("<f4"))
                self.filled += missing
        self._write(rows)
        self._next_seq = samples.seq + len(rows)
        self._last = rows[-1]

    def blocks(self) -> Iterator[NDArray[np.float32]]:
        """All rows again, some at a time: shape (n, 2K), setpoints first."""
        width = 2 * len(self.axes)
        self._stream.flush()
        self._stream.seek(0)
        while chunk := self._stream.read(ROWS_AT_ONCE * width * 4):
            yield np.frombuffer(chunk, dtype="<f4").reshape(-1, width)

    def _write(self, rows: NDArray[np.float32]) -> None:
        self._stream.write(rows.tobytes())
        self.rows += len(rows)


class LineTimes:
    """When each line began and ended, in order of their ends [s]."""

    def __init__(self) -> None:
        self._lines = array("q")
        self._starts = array("d")
        self._ends = array("d")

    def append(self, line: int, start_s: float, end_s: float) -> None:
        self._lines.append(line)
        self._starts.append(start_s)
        self._ends.append(end_s)

    def lines_at(self, time_s: Array, *, slack_s: float = 0.0) -> Array:
        """Return the line under way at each time, 0 where none is; shape as ``time_s``.

        ``slack_s``: a line that starts so soon counts as under way: the cycle in which one line is handed
        to the next belongs to the next.
        """
        if not self._lines:
            return np.zeros(len(time_s))
        ends = np.array(self._ends)
        order = np.argsort(ends, kind="stable")
        index = np.minimum(np.searchsorted(ends[order], time_s, side="left"), len(ends) - 1)
        chosen = order[index]
        within = (time_s <= ends[chosen]) & (time_s >= np.array(self._starts)[chosen] - slack_s)
        lines: Array = np.where(within, np.array(self._lines)[chosen], 0).astype(np.float64)
        return lines


class Recorder:
    """Records a program from before its first motion to its rest.

    ``start``, then ``follow`` the opened program before any line is sent, then ``save`` once it has ended.
    """

    def __init__(self, machine: Machine, path: Path) -> None:
        self._machine = machine
        self._path = path
        self._file = tempfile.TemporaryFile(dir=path.parent)  # noqa: SIM115 closed by `close`
        self._spool = Spool(self._file, machine.info.telemetry.axes)
        self._feed = machine.samples()
        self._times = LineTimes()
        self._start_s = 0.0
        self._now_s = 0.0
        self._arrived = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []
        self._ended_s: float | None = None

    @property
    def filled(self) -> int:
        """Cycles that were lost on the way and are interpolated."""
        return self._spool.filled

    @property
    def rows(self) -> int:
        return self._spool.rows

    async def start(self) -> None:
        """Returns once samples come.

        Raises:
            MotionError: MC532 none come.
        """
        self._tasks.append(asyncio.create_task(self._take_samples()))
        if not await self._until(lambda: self._spool.rows > 0, FIRST_SAMPLES_S):
            raise MotionError(
                "MC532", "the machine sends no samples to record", "may this client read mc/@v1/…/tele/batch?"
            )

    def follow(self, program: Program) -> None:
        """Notes when each of the program's lines runs."""
        self._tasks.append(asyncio.create_task(self._take_reports(program.reports)))

    async def save(self) -> None:
        """Waits for the last samples and writes the file, whole or not at all.

        Raises:
            OSError: it cannot be written.
        """
        await self._until(lambda: self._ended_s is not None, LAST_SAMPLES_S)
        end_s = self._ended_s if self._ended_s is not None else self._now_s
        await self._until(lambda: self._now_s >= end_s + REST_S, LAST_SAMPLES_S)
        await self._stop()
        await asyncio.to_thread(self._write)

    async def close(self) -> None:
        await self._stop()
        self._file.close()

    async def _stop(self) -> None:
        self._feed.close()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _take_samples(self) -> None:
        async for samples in self._feed:
            if len(samples.time_s) == 0:
                continue
            if self._spool.rows == 0:
                self._start_s = float(samples.time_s[0])
            self._spool.append(samples)
            self._now_s = float(samples.time_s[-1])
            self._arrived.set()

    async def _take_reports(self, reports: Feed[Report]) -> None:
        last_s = None
        async for report in reports:
            if report.timing is not None:
                self._times.append(report.line, report.timing.start_s, report.timing.end_s)
            elif report.kind == "program":
                last_s = report.t
        # the feed ends with the program
        self._ended_s = last_s
        self._arrived.set()

    async def _until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        try:
            async with asyncio.timeout(timeout_s):
                while not condition():
                    self._arrived.clear()
                    await self._arrived.wait()
        except TimeoutError:
            return False
        return True

    def _write(self) -> None:
        temporary = self._path.with_name(f"{self._path.name}.{os.getpid()}.part")
        try:
            with zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:
                self._write_arrays(archive)
            os.replace(temporary, self._path)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise

    def _write_arrays(self, archive: zipfile.ZipFile) -> None:
        rows, axes = self._spool.rows, len(self._spool.axes)
        cycle_s = self._machine.info.cycle_s
        time_s = cycle_s * np.arange(rows, dtype=np.float64)
        lines = self._times.lines_at(time_s + self._start_s, slack_s=HANDOVER_CYCLES * cycle_s)
        _write_array(archive, "time_s", (rows,), [time_s])
        _write_array(archive, "line", (rows,), [lines])
        _write_array(archive, "axes", (axes,), [np.array(self._spool.axes, dtype=np.float64)])
        for name, columns in (("setpoint", slice(0, axes)), ("actual", slice(axes, 2 * axes))):
            blocks = (block[:, columns].astype(np.float64) for block in self._spool.blocks())
            _write_array(archive, name, (rows, axes), blocks)


def _write_array(
    archive: zipfile.ZipFile, name: str, shape: tuple[int, ...], blocks: Iterator[Array] | list[Array]
) -> None:
    """One array of an NPZ file, block by block (NumPy's format 1.0)."""
    header = {"descr": "<f8", "fortran_order": False, "shape": shape}
    with archive.open(f"{name}.npy", "w", force_zip64=True) as stream:
        np.lib.format.write_array_header_1_0(stream, header)
        for block in blocks:
            stream.write(np.ascontiguousarray(block).tobytes())
