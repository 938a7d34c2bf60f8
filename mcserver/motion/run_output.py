"""Output of planned runs: setpoint rows, with edges of lines and activations of columns between them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mcserver.motion.geometry.path_columns import PathColumns
from mcserver.motion.lookahead.companion_motions import CompanionMotions
from mcserver.motion.lookahead.planned_run import PlannedRun
from mcserver.motion.lookahead.setpoint_sampling import CYCLE_ROUNDING, first_row, sample
from mcserver.motion.lookahead.torque_of_rows import TorqueOfRows
from mcserver.motion.pieces import PIECE, Activation, LineBound, LineEdges, Piece

T = TypeVar("T", bound=np.generic)
_ALL = (1 << 64) - 1


class RunOutput:
    """Output of one program's runs, one after the other.

    Args:
        cycle: between rows [s]. companions: motions parallel to the runs. torques: adds torques to rows;
            None: no joint's torque is limited.

    Attributes:
        announced: mask of the columns whose `Activation` has been output.
    """

    def __init__(self, cycle: float, companions: CompanionMotions, torques: TorqueOfRows | None) -> None:
        self._cycle = cycle
        self._companions = companions
        self._torques = torques
        self.announced = 0

    def pieces(self, plan: PlannedRun, origin: float, last: int, until: float) -> Iterator[Piece]:
        """Yield rows first_row(origin) … ``last``, and edges, bounds and activations before ``until`` [s].

        All that lies before a piece's last row comes before that piece; edges are in order of u. Where the
        run closes (``until`` infinite), no edge lies after its last row, whatever the rounding.
        """
        self._companions.begin(plan, origin, until, last)
        latest = float(last) if math.isinf(until) else math.inf
        times = plan.times
        # one more: the segment that begins where the rows end
        count = min(int(np.searchsorted(times[:-1], until)) + 1, len(times) - 1)
        path = plan.segments.columns(0, count)
        happenings = _Happenings.of(plan, path, origin, until, latest, self._cycle, self.announced)
        low = first_row(origin)
        while low <= last:
            high = min(low + PIECE - 1, last)
            starting: list[Activation] = []
            for piece in happenings.before(high):
                if isinstance(piece, Activation):
                    self.announced |= piece.mask
                    starting.append(piece)
                yield piece
            rows = sample(plan, origin, low, high, self._cycle, path)
            self._companions.put_on(rows)
            np.bitwise_and(rows.axes, np.uint64(self.announced), out=rows.axes)
            for activation in starting:
                # no row drives a column before its activation, which rounding may put just after a row
                early = max(math.floor(activation.u + CYCLE_ROUNDING) - low + 1, 0)
                rows.axes[:early] &= np.uint64(~activation.mask & _ALL)
            yield rows if self._torques is None else self._torques.on_plan(rows, plan, origin)
            low = high + 1
        for piece in happenings.before(None):
            if isinstance(piece, Activation):
                self.announced |= piece.mask
            yield piece


@dataclass
class _Happenings:
    """Edges, activations and bounds along a run, each kind in order.

    Attributes:
        edges: of lines. rows: the last row before each edge, shape (n,).
        activations: each with the last row before it, and the number of edges before it.
        bounds: each with the last row before it.
    """

    edges: LineEdges
    rows: NDArray[np.int64]
    activations: list[tuple[int, int, Activation]]
    bounds: list[tuple[int, LineBound]]
    _edges_passed: int = 0
    _activations_passed: int = 0
    _bounds_passed: int = 0

    @classmethod
    def of(
        cls,
        plan: PlannedRun,
        path: PathColumns,
        origin: float,
        until: float,
        latest: float,
        cycle: float,
        announced: int,
    ) -> _Happenings:
        """Return those of a run before a time.

        Args:
            path: columns of its first segments, at least of those that begin before ``until``.
            origin: u of the run's start [cycles]. until: along the run [s].
            latest: edges and activations after it are put there [cycles].
            announced: mask of the columns that are already activated.
        """
        times = plan.times
        count = int(np.searchsorted(times[:-1], until))
        # rounding may disorder the times
        at = np.maximum.accumulate(origin + times[: count + 1] / cycle)
        before = np.floor(at + CYCLE_ROUNDING).astype(np.int64)
        places = np.minimum(at, latest)
        ended = times[1 : count + 1] <= until
        # two edges a line: where it begins, and where it ends
        which = np.column_stack((path.opens[:count], path.closes[:count] & ended)).ravel()
        lines = np.repeat(path.line[:count], 2)[which]
        ends = np.tile(np.array([False, True]), count)[which]
        edges = LineEdges(_beside(places)[which], lines, ends)
        passed = np.concatenate(([0], np.cumsum(which)))
        activations = []
        for index, mask in _joining(path.active[:count], announced):
            activation = Activation(float(places[index]), int(path.line[index]), mask)
            activations.append((int(before[index]), int(passed[2 * index]), activation))
        bounds = [
            (int(before[index + 1]), LineBound(int(path.line[index]), bound))
            for index, bound in enumerate(plan.bound_by[:count])
            if bound is not None and ended[index]
        ]
        return cls(edges, _beside(before)[which], activations, bounds)

    def before(self, row: int | None) -> Iterator[Piece]:
        """Yield what has not been yielded and lies before ``row``; None: all of it."""
        bounds, activations = self.bounds, self.activations
        while self._bounds_passed < len(bounds) and (row is None or bounds[self._bounds_passed][0] < row):
            yield bounds[self._bounds_passed][1]
            self._bounds_passed += 1
        while self._activations_passed < len(activations):
            own_row, edges_before, activation = activations[self._activations_passed]
            if row is not None and own_row >= row:
                break
            yield from self._edges_to(edges_before)
            yield activation
            self._activations_passed += 1
        yield from self._edges_to(len(self.rows) if row is None else int(np.searchsorted(self.rows, row)))

    def _edges_to(self, index: int) -> Iterator[LineEdges]:
        if index > self._edges_passed:
            part = slice(self._edges_passed, index)
            self._edges_passed = index
            yield self.edges.part(part)


def _beside(values: NDArray[T]) -> NDArray[T]:
    """Return start and end value of each segment, interleaved: shape (n+1,) to (2n,)."""
    beside: NDArray[T] = np.column_stack((values[:-1], values[1:])).ravel()
    return beside


def _joining(active: NDArray[np.uint64], announced: int) -> list[tuple[int, int]]:
    """Return the segments at which columns join the motion, each with the mask of these columns."""
    found: list[tuple[int, int]] = []
    (changes,) = np.nonzero(active[1:] != active[:-1])
    for index in [0, *(changes + 1).tolist()] if len(active) else []:
        mask = int(active[index])
        if mask & ~announced:
            found.append((index, mask & ~announced))
            announced |= mask
    return found
