"""One measured figure beside its floor, and how medians are taken."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Figure:
    """One row of the table.

    Attributes:
        what: what was measured.
        measured: in ``unit``.
        floor: what the same computer does at best, measured in the same run, or computed from physics; None
            where there is nothing to hold it against.
        against: what the floor is.
        goal: the aim, in words.
    """

    what: str
    measured: float
    unit: str
    floor: float | None = None
    against: str = ""
    goal: str = ""

    @property
    def ratio(self) -> float | None:
        """measured / floor."""
        return None if self.floor is None or self.floor == 0.0 else self.measured / self.floor


class NotAvailable(Exception):
    """This computer lacks what the section needs; says what."""


def seconds(work: Callable[[], object], runs: int = 5) -> float:
    """Median wall time of several runs [s]; machines here are shared, single runs lie."""
    taken = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return statistics.median(taken)


def processor_seconds(work: Callable[[], object], runs: int = 5) -> float:
    """Median processor time of several runs of computing alone [s]: others' load counts less."""
    taken = []
    for _ in range(runs):
        start = time.process_time()
        work()
        taken.append(time.process_time() - start)
    return statistics.median(taken)


def rate(work: Callable[[], object], items: int, runs: int = 5) -> float:
    """Items a second, by the median of several runs."""
    return items / seconds(work, runs)


def percentile(values: list[float], share: float) -> float:
    """The value that ``share`` (0 … 1) of the values do not pass."""
    ordered = sorted(values)
    return ordered[min(int(share * len(ordered)), len(ordered) - 1)]


def percentiles(
    what: str,
    taken: list[float],
    floor: list[float] | None = None,
    against: str = "",
    goals: Mapping[float, str] = MappingProxyType({}),
    *,
    shares: Sequence[float] = (0.5, 0.99),
    unit: str = "µs",
) -> list[Figure]:
    """One row for each share of the values (1: the longest), beside the same share of the floor's."""
    return [
        Figure(
            f"{what}, {'longest' if share == 1.0 else f'p{100 * share:g}'}",
            percentile(taken, share),
            unit,
            None if floor is None else percentile(floor, share),
            against,
            goals.get(share, ""),
        )
        for share in shares
    ]
