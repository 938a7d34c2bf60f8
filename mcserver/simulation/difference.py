"""How the motion of one program differs from that of another one, by axis and by tip."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Unpack

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.errors import Refused
from mcserver.machine.machine_file import Machine
from mcserver.simulation.tool_poses import ToolPoses
from mcserver.units import MM

if TYPE_CHECKING:
    from mcserver.simulation.run import Conditions

Array = NDArray[np.float64]

# Setpoints that are kept of a run, for half an hour of it [cycles].
MOST_CYCLES = 2_000_000
# Points of a tip's path that are compared, evenly along it.
TIP_POINTS = 2000
_ROWS_AT_ONCE = 256
# An axis that differs by no more is not reported [mm or deg].
ROUNDING = 1e-9


class AxisDifference(msgspec.Struct, frozen=True):
    """How an axis moves otherwise; the other program's minus this one's [mm or deg].

    Attributes:
        most: greatest difference of two setpoints of the same cycle; the shorter run rests at its end.
        time_s, line, other_line: when, and the lines that run then.
        min, max, end: differences of the least, greatest and last setpoint.
    """

    axis: int
    unit: str
    most: float
    time_s: float
    line: int
    other_line: int
    min: float
    max: float
    end: float


class TipDifference(msgspec.Struct, frozen=True):
    """How far apart two paths of a tip are, whatever their times.

    Attributes:
        tool: None: the axes 0, 1 and 2 themselves.
        apart_mm: the greatest distance of a point of one path from the other one.
        time_s, line: where that is. other: they are of the other program, whose path goes astray there.
    """

    tool: int | None
    apart_mm: float
    time_s: float
    line: int
    other: bool


class Difference(msgspec.Struct, frozen=True):
    """How another program moves.

    Attributes:
        same: every setpoint is the same to the bit.
        duration_s: the other one's minus this one's. axes: those whose setpoints differ. tips: all.
    """

    same: bool
    duration_s: float
    axes: list[AxisDifference]
    tips: list[TipDifference]


class CycleKeeper:
    """Keeps every cycle's setpoints of a run.

    Raises:
        Refused: MC332 the run is too long to be kept.
    """

    def __init__(self) -> None:
        self._blocks: list[tuple[Array, NDArray[np.int64], Array]] = []
        self._cycles = 0

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:
        """Look at cycles in order: times [s] and lines (n,), setpoints (n, K) [SI]."""
        self._cycles += len(times)
        if self._cycles > MOST_CYCLES:
            raise Refused(
                "MC332", f"a run of more than {MOST_CYCLES} cycles is not compared", "compare parts of it"
            )
        self._blocks.append((times.copy(), lines.copy(), setpoint.copy()))

    def cycles(self) -> tuple[Array, NDArray[np.int64], Array]:
        """Return times (n,) [s], lines (n,) and setpoints (n, K) [SI]."""
        times, lines, setpoints = zip(*self._blocks, strict=True)
        return np.concatenate(times), np.concatenate(lines), np.concatenate(setpoints)


def difference_from(
    text: str, this: CycleKeeper, duration_s: float, machine: Machine, **given: Unpack[Conditions]
) -> dict[str, Any]:
    """Simulate another program as this one was, and return how it moves otherwise, as plain values.

    Args:
        this: cycles of the run to compare with. duration_s: of it.

    Raises:
        Refused: MC332 the other program has a fault, or one of the runs is too long.
    """
    from mcserver.simulation.run import solver_of
    from mcserver.simulation.simulation import simulate

    kept = CycleKeeper()
    given["takers"] = (kept,)
    report = simulate(text, machine, **given).report
    if not report["ok"]:
        fault = next(each for each in report["diagnostics"] if each["severity"] == "error")
        raise Refused(
            "MC332",
            f"the program to compare with fails in its line {fault['line']}: {fault['message']}",
            f"correct that first ({fault['code']})",
        )
    mine, theirs = this.cycles(), kept.cycles()
    same = len(mine[2]) == len(theirs[2]) and bool(np.array_equal(mine[2], theirs[2]))
    poses = ToolPoses(machine, solver_of(given))
    tools = poses.numbers or (None,)
    tips = [_tip(tool, mine, theirs, machine, poses) for tool in tools]
    found = Difference(
        same,
        report["duration_s"] - duration_s,
        [] if same else _axes(mine, theirs, machine),
        [tip for tip in tips if tip is not None],
    )
    return dict(msgspec.to_builtins(found))


_Cycles = tuple[Array, NDArray[np.int64], Array]


def _axes(this: _Cycles, other: _Cycles, machine: Machine) -> list[AxisDifference]:
    longest = max(len(this[0]), len(other[0]))
    mine, theirs = (_held(each[2], longest) for each in (this, other))
    lines, other_lines = (_held(each[1], longest) for each in (this, other))
    times = this[0] if len(this[0]) == longest else other[0]
    found = []
    for column, axis in enumerate(machine.axes):
        apart = (theirs[:, column] - mine[:, column]) / axis.type.si_per_unit
        at = int(np.abs(apart).argmax())
        if abs(apart[at]) <= ROUNDING:
            continue
        ends = [
            float(of(theirs[:, column]) - of(mine[:, column])) / axis.type.si_per_unit
            for of in (np.min, np.max, _last)
        ]
        found.append(
            AxisDifference(
                axis.index,
                axis.type.unit,
                float(apart[at]),
                float(times[at]),
                int(lines[at]),
                int(other_lines[at]),
                *ends,
            )
        )
    return found


def _held(rows: NDArray[np.generic], count: int) -> Array:
    """Return rows with the last one held on to so many."""
    return np.concatenate([rows, np.repeat(rows[-1:], count - len(rows), axis=0)])


def _last(values: Array) -> float:
    return float(values[-1])


def _tip(
    tool: int | None, this: _Cycles, other: _Cycles, machine: Machine, poses: ToolPoses
) -> TipDifference | None:
    """Return the Hausdorff distance of two paths of a tip, each thinned to points evenly along it."""
    axes = [each.index for each in machine.axes]
    if tool is None and not {0, 1, 2} & {each.index for each in machine.axes if each.type.unit == "mm"}:
        return None
    paths = []
    for _, _, setpoint in (this, other):
        if tool is not None:
            tip = poses.of(tool, setpoint)[:, :3]
        else:
            columns = [axes.index(axis) for axis in (0, 1, 2) if axis in axes]
            tip = setpoint[:, columns] / MM
        paths.append((tip, _evenly(tip)))
    found: TipDifference | None = None
    for (tip, chosen), (onto, marks), cycles, strays in (
        (paths[0], paths[1], this, False),
        (paths[1], paths[0], other, True),
    ):
        apart = _apart(tip[chosen], onto[marks])
        at = int(apart.argmax())
        if found is None or apart[at] > found.apart_mm:
            cycle = int(chosen[at])
            found = TipDifference(
                tool, float(apart[at]), float(cycles[0][cycle]), int(cycles[1][cycle]), strays
            )
    return found


def _evenly(path: Array) -> NDArray[np.int64]:
    """Return the rows of a path that are evenly along it, first and last among them."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    wanted = np.searchsorted(way, np.linspace(0.0, way[-1], TIP_POINTS))
    return np.unique(np.concatenate([[0], wanted, [len(path) - 1]]))


def _apart(points: Array, path: Array) -> Array:
    """Return the distance of each point from a path of straight parts, shape (n,) [mm]."""
    start, step = path[:-1], np.diff(path, axis=0)
    if not len(step):
        return np.asarray(np.linalg.norm(points - path[0], axis=1))
    square = np.einsum("ij,ij->i", step, step)
    square[square == 0.0] = 1.0
    found = np.empty(len(points))
    for first in range(0, len(points), _ROWS_AT_ONCE):
        off = points[first : first + _ROWS_AT_ONCE, None] - start[None]
        share = np.clip(np.einsum("nij,ij->ni", off, step) / square, 0.0, 1.0)
        rest = off - share[..., None] * step[None]
        found[first : first + _ROWS_AT_ONCE] = np.sqrt(np.einsum("nij,nij->ni", rest, rest).min(axis=1))
    return found
