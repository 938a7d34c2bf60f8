"""The page's scope: cycles of one axis from telemetry, around a trigger or the newest ones."""

from __future__ import annotations

import numpy as np
import pytest
from mcclient.telemetry import Samples

from mcserver.canopen.scope import Trigger
from mcserver.web.sample_scope import FOLLOWING_ERROR, MOST_ROWS, QUANTITIES, SampleScope, drawn_rows

CYCLE_S = 0.001
ERROR = QUANTITIES.index(FOLLOWING_ERROR)


def block(first: int, error: list[float], setpoint: float = 1.0) -> Samples:
    """Cycles of axes 0 and 3; the following error of axis 3 is as given."""
    count = len(error)
    columns = {
        "setpoint": np.full((count, 2), setpoint),
        "position": np.stack([np.zeros(count), setpoint - np.array(error)], axis=1),
        "velocity": np.zeros((count, 2)),
        "torque": np.full((count, 2), 0.5),
    }
    return Samples(first, (first + np.arange(count)) * CYCLE_S, (0, 3), columns)


def scope(cycles: int = 10, before: int = 3, trigger: Trigger | None = None) -> SampleScope:
    return SampleScope(3, "mm", CYCLE_S, cycles, before, trigger)


def test_without_a_trigger_the_newest_cycles_are_kept_and_time_ends_at_zero() -> None:
    made = scope(cycles=4)
    made.take(block(0, [0.0, 1.0, 2.0]))
    made.take(block(3, [3.0, 4.0, 5.0]))
    trace = made.trace()
    assert trace.values[:, ERROR] == pytest.approx([2.0, 3.0, 4.0, 5.0])
    assert trace.time_s == pytest.approx([-0.003, -0.002, -0.001, 0.0])
    assert (made.is_done, made.zero_s) == (False, pytest.approx(0.005))


@pytest.mark.parametrize("split", [1, 4, 5, 6, 12])
def test_a_trigger_keeps_what_was_before_it_wherever_messages_are_cut(split: int) -> None:
    errors = [0.0, 0.0, 0.1, 0.2, 0.0, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1]
    made = scope(cycles=6, before=2, trigger=Trigger(ERROR, 0.5, above=True))
    for first in range(0, len(errors), split):
        made.take(block(first, errors[first : first + split]))
    assert made.is_done
    trace = made.trace()
    assert trace.values[:, ERROR] == pytest.approx([0.2, 0.0, 0.9, 0.8, 0.7, 0.6])
    assert trace.time_s == pytest.approx([-0.002, -0.001, 0.0, 0.001, 0.002, 0.003])
    assert made.zero_s == pytest.approx(0.005)


def test_cycles_that_are_lost_are_gaps_and_counted_and_fill_no_memory() -> None:
    made = scope(cycles=8)
    made.take(block(0, [1.0, 2.0]))
    made.take(block(4, [5.0]))
    assert made.lost == 2
    assert np.isnan(made.trace().values[:, ERROR]).tolist() == [False, False, True, True, False]
    made.take(block(10**9, [6.0]))
    assert len(made.trace().values) == 8


def test_a_trigger_is_found_behind_lost_cycles() -> None:
    made = scope(before=1, trigger=Trigger(ERROR, 0.5, above=True))
    made.take(block(0, [0.0, 0.1]))
    made.take(block(5, [0.9, 0.8]))
    assert made.triggered
    assert made.trace().values[1:, ERROR] == pytest.approx([0.9, 0.8])


def test_a_server_that_begins_anew_begins_the_trace_anew() -> None:
    made = scope()
    made.take(block(100, [1.0, 1.0]))
    made.take(block(0, [2.0]))
    assert made.trace().values[:, ERROR] == pytest.approx([2.0])
    assert made.lost == 0


def test_a_scope_that_is_done_takes_no_more() -> None:
    made = scope(cycles=2, before=0, trigger=Trigger(ERROR, 0.5, above=True))
    made.take(block(0, [0.0, 0.9, 0.8, 0.7]))
    made.take(block(4, [0.0]))
    assert made.trace().values[:, ERROR] == pytest.approx([0.9, 0.8])


def test_an_axis_that_telemetry_has_not_gives_nothing() -> None:
    made = SampleScope(7, "deg", CYCLE_S, 10)
    made.take(block(0, [1.0]))
    assert len(made.trace().values) == 0


def test_a_long_trace_is_drawn_with_its_peaks_and_its_gaps() -> None:
    errors = np.zeros(20_000)
    errors[12_345], errors[777] = 3.0, -2.0
    errors[5000:9000] = np.nan
    made = scope(cycles=len(errors))
    made.take(block(0, errors.tolist()))
    rows = drawn_rows(made.trace(), [ERROR])
    values = [value for _, value in rows]
    assert len(rows) <= MOST_ROWS + 2
    assert {3.0, -2.0, None} <= set(values)
    assert [at for at, _ in rows] == sorted(at for at, _ in rows)
