"""The cycle follows the clock of a bus whose slaves have one."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from mcserver.executor.process import clock_correction_ns

PERIOD_NS = 1_000_000


@dataclass
class Clocked:
    """A bus on which the latest cycle was so late."""

    clock_error_ns: int | None = 0


@pytest.mark.parametrize("drift_ppm", [-200, -50, 0, 50, 200])
@pytest.mark.parametrize("start_ns", [-450_000, 0, 450_000])
def test_a_clock_that_drifts_is_followed_within_microseconds(drift_ppm: int, start_ns: int) -> None:
    bus, late = Clocked(), float(start_ns)
    for _ in range(500):
        bus.clock_error_ns = round(late)
        late += clock_correction_ns(bus, PERIOD_NS) + drift_ppm * 1e-6 * PERIOD_NS
    assert abs(late) < 5000.0


def test_a_bus_without_a_clock_corrects_nothing() -> None:
    assert clock_correction_ns(Clocked(None), PERIOD_NS) == 0
