"""The reference's gait and arcs on real buses, compared with the same run on ideal drives."""

from __future__ import annotations

import asyncio
import re
from dataclasses import dataclass

import numpy as np
from mcclient import Machine
from numpy.typing import NDArray

from mcserver.machine.machine_file import parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.simulation import simulate
from tests.e2e.observing import ended_lines, listening, recorded
from tests.e2e.servers import ROOT
from tests.e2e_can.machines import Raw, ideal, toml

Array = NDArray[np.float64]
# the arcs take 40 s of motion
RUN_LIMIT_S = 240.0
ROWS_AT_ONCE = 64
WINDOW = 256
# in_position of the machines is 0.01 or 0.05 [mm, deg]
END = 0.06
# Share of cycles that telemetry brought, with readings that were there in time; others may be late [cycles].
IN_TIME = 0.9
LATE_CYCLES = 3.0


@dataclass(frozen=True)
class Walked:
    """Where axes have been, shape (N, K) [mm, deg], from the first motion's start to the last one's end.

    Attributes:
        actual: by the encoders. end: where they are at the end, shape (K,).
        late: cycles that the executor came too late for.
    """

    setpoint: Array
    actual: Array
    end: Array
    late: int = 0


def gait() -> str:
    """The example, with a rest before its drives are released: they are two cycles behind."""
    return example("robot-dog").replace("G1050", "G04 P0.5\nG1050")


def arcs(scale: float = 1.0) -> str:
    """The listing of the reference at its size, which takes 40 s, or with all lengths by a factor."""

    def scaled(word: re.Match[str]) -> str:
        return f"{word[1]}{float(word[2]) * scale:g}"

    return "\n".join(
        re.sub(r"\b([XYUVRIJ])(-?\d+)", scaled, line.partition(";")[0])
        for line in example("arcs").splitlines()
    )


def example(name: str) -> str:
    return (ROOT / "examples" / f"{name}.gcode").read_text("utf-8")


def on_ideal_drives(text: str, raw: Raw) -> Walked:
    """By `mcserver simulate`."""
    machine = parse_machine(toml(ideal(raw)))
    ran = simulate(text, machine, kinematics=build_kinematics(machine), record=True)
    assert ran.exit_code == 0, ran.report["diagnostics"]
    assert ran.recording is not None
    lines = ran.report["lines"]
    begin, end = lines[0]["start_s"], max(line["end_s"] for line in lines)
    time_s = ran.recording.time_s
    moved = ran.recording.setpoint[(time_s >= begin - 1e-9) & (time_s <= end + 1e-9)]
    return Walked(moved, moved, moved[-1])


async def on_the_bus(machine: Machine, text: str) -> Walked:
    """By a server, over the network."""
    late = (await machine.status()).late_cycles
    async with recorded(machine) as recording, asyncio.timeout(RUN_LIMIT_S):
        async with machine.program() as program:
            reports = await listening(machine, program)
            await program.send_lines(text.splitlines())
            await program.finish()
        lines = [line for line in await ended_lines(reports) if line.end_s > line.start_s]
        status = await machine.status()
    begin, end = min(line.start_s for line in lines), max(line.end_s for line in lines)
    time_s = recording.time_s
    rows = (time_s >= begin - 1e-9) & (time_s <= end + 1e-9)
    return Walked(
        recording.setpoint[rows],
        recording.actual[rows],
        np.array(status.axes.position),
        status.late_cycles - late,
    )


def distance(points: Array, path: Array) -> Array:
    """Distance of points, shape (N, K), from the polyline through others, shape (M, K); shape (N,).

    Both go the same way: each point is looked for near where the one before was found.
    """
    start, along = path[:-1], np.diff(path, axis=0)
    length = np.maximum(np.einsum("ij,ij->i", along, along), 1e-30)
    distances, found = [], 0
    for begin in range(0, len(points), ROWS_AT_ONCE):
        near = slice(max(0, found - WINDOW), found + ROWS_AT_ONCE + WINDOW)
        offset = points[begin : begin + ROWS_AT_ONCE, None, :] - start[near]
        share = np.clip(np.einsum("nij,ij->ni", offset, along[near]) / length[near], 0.0, 1.0)
        away = np.linalg.norm(offset - share[:, :, None] * along[near], axis=2)
        distances.append(away.min(axis=1))
        found = (near.start or 0) + int(away[-1].argmin())
    return np.concatenate(distances)


def moving(rows: Array) -> Array:
    """Without those that stand where the one before stood: waits differ from drive to drive."""
    return rows[np.r_[True, np.abs(np.diff(rows, axis=0)).max(axis=1) > 1e-6]]


def assert_as_ideal(real: Walked, perfect: Walked, *, within: float, lag: float) -> None:
    """The same path and the same end.

    Args:
        within: of the path, for setpoints: those of a slowed cycle lie between rows [mm, deg].
        lag: of the path, for encoders [mm, deg].
    """
    commanded, wanted = moving(real.setpoint), moving(perfect.setpoint)
    assert distance(commanded, wanted).max() <= within, "setpoints leave the ideal path"
    # a busy computer loses telemetry, and chords bridge what is lost
    covered = np.quantile(distance(wanted, commanded), IN_TIME)
    assert covered <= within, "setpoints leave out some of the ideal path"
    # a reading that comes too late for its cycle is shown a cycle later than those of the other axes
    away = distance(moving(real.actual), wanted)
    step = np.linalg.norm(np.diff(perfect.setpoint, axis=0), axis=1).max()
    assert np.quantile(away, IN_TIME) <= lag, "the drives leave the ideal path"
    assert away.max() <= LATE_CYCLES * step, "a drive leaves the ideal path"
    assert np.abs(real.setpoint[-1] - perfect.end).max() <= END, "another end of the path"
    assert np.abs(real.end - perfect.end).max() <= END, "the drives do not end there"
