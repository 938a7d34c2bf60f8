"""Messages of targets: which of them count, and the curve that they ask for."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from mcserver.executor.shm.target_box import POINTS, Targets
from mcserver.service.target_stream import Now, TargetMessage, TargetStream
from tests.executor.rig import machine

Array = NDArray[np.float64]
PERIOD = 0.01
# the sender's clock is elsewhere
CLOCK = 1234.5


class Sender:
    """Sends to a stream of two axes that go 1 m/s within ±1 m."""

    def __init__(self) -> None:
        self.stream = TargetStream(machine().axes, 1e-3)
        self.seq = 0

    def send(
        self,
        positions: list[list[float]] | None = None,
        velocities: list[list[float]] | None = None,
        *,
        sent: float,
        arrives: float | None = None,
        seq: int | None = None,
        times: list[float] | None = None,
        counts_s: float = 0.1,
    ) -> Targets | None:
        self.seq = self.seq + 1 if seq is None else seq
        rows = [None if each is None else np.array(each) for each in (positions, velocities)]
        at = None if times is None else np.array(times)
        message = TargetMessage(self.seq, CLOCK + sent, counts_s, rows[0], rows[1], at)
        return self.stream.take(message, Now(sent if arrives is None else arrives))

    def ramp(self, count: int) -> Targets | None:
        """Positions at 0.1 m/s, a message each period."""
        last = None
        for number in range(count):
            place = 0.1 * number * PERIOD
            last = self.send([[place, 0.0]], sent=number * PERIOD)
        return last


def counted(sender: Sender) -> dict[str, float]:
    """What was counted but those that count."""
    status = sender.stream.status
    names = ("lost", "late", "doubled", "reordered", "jumped", "refused", "clipped")
    return {name: getattr(status, name) for name in names if getattr(status, name)}


def knots_of(targets: Targets | None) -> Array:
    assert targets is not None
    return targets.knots


def test_a_stream_of_which_nothing_has_come_has_counted_nothing() -> None:
    assert set(msgspec.structs.astuple(Sender().stream.status)) == {0}


def test_positions_lead_through_the_middles_and_come_to_rest_on_the_last() -> None:
    sender = Sender()
    knots = knots_of(sender.ramp(11))
    now = 0.1
    assert knots[:, 0] == pytest.approx([now + PERIOD, now + 2 * PERIOD])
    assert knots[:, 1] == pytest.approx([0.0095, 0.01])
    assert knots[:, 3] == pytest.approx([0.1, 0.0])
    assert sender.stream.status.taken == 11
    assert counted(sender) == {}


def test_a_position_with_its_velocity_is_reached_when_the_next_one_is_to_come() -> None:
    sender = Sender()
    sender.send([[0.0, 0.0]], [[0.1, 0.0]], sent=0.0)
    targets = sender.send([[0.001, 0.0]], [[0.1, 0.0]], sent=PERIOD)
    assert knots_of(targets).tolist()[0] == pytest.approx([2 * PERIOD, 0.001, 0.0, 0.1, 0.0])
    assert targets is not None
    assert targets.until == pytest.approx(PERIOD + 0.1)


def test_one_that_comes_late_is_led_to_where_it_would_be_by_then() -> None:
    sender = Sender()
    sender.send([[0.0, 0.0]], [[0.1, 0.0]], sent=0.0)
    targets = sender.send([[0.001, 0.0]], [[0.1, 0.0]], sent=PERIOD, arrives=PERIOD + 0.02)
    (knot,) = knots_of(targets)
    assert knot[1] - 0.001 == pytest.approx(0.1 * (knot[0] - 2 * PERIOD), abs=1e-5)
    assert knot[0] == pytest.approx(PERIOD + 0.025, abs=1e-4)
    assert sender.stream.status.age_s == pytest.approx(0.02, abs=1e-4)


def test_one_that_comes_later_than_it_counts_for_does_not_count() -> None:
    sender = Sender()
    sender.ramp(3)
    assert sender.send([[0.0, 0.0]], sent=0.03, arrives=0.2) is None
    assert counted(sender) == {"late": 1}


def test_a_chunk_counts_as_long_as_its_last_point_does_however_late_it_comes() -> None:
    sender = Sender()
    sender.ramp(3)
    chunk = [[0.002, 0.0], [0.003, 0.0]]
    came = sender.send(chunk, sent=0.03, times=[0.1, 0.5], arrives=0.6)
    assert knots_of(came)[:, 0] == pytest.approx([0.13, 0.53], abs=1e-3)
    assert came is not None
    assert came.until == pytest.approx(0.63, abs=1e-3)
    assert sender.send(chunk, sent=0.04, times=[0.1, 0.5], arrives=0.7) is None
    assert counted(sender) == {"late": 1}


def test_after_hours_of_a_stream_one_that_comes_later_than_it_counts_for_does_not_count() -> None:
    sender = Sender()
    hours = 3 * 3600.0
    for number in range(20):
        sender.send([[0.0, 0.0]], sent=hours + 0.1 * number)
    sender.send([[0.0, 0.0]], sent=hours + 2.0, arrives=hours + 2.2)
    assert counted(sender) == {"late": 1}


def test_a_clock_that_stands_makes_all_that_follows_late() -> None:
    sender = Sender()
    sender.ramp(3)
    for number in range(3, 30):
        sender.send([[0.002, 0.0]], sent=0.02, arrives=number * PERIOD)
    assert sender.stream.status.late > 10


def test_clocks_that_drift_apart_do_not_make_a_stream_late() -> None:
    sender = Sender()
    for number in range(5000):
        sender.send([[0.0, 0.0]], sent=0.1 * number * 0.9995, arrives=0.1 * number)
    assert counted(sender) == {}


@pytest.mark.parametrize(("seq", "what"), [(3, "doubled"), (2, "reordered"), (1, "reordered")])
def test_a_number_that_was_there_does_not_count(seq: int, what: str) -> None:
    sender = Sender()
    sender.ramp(3)
    assert sender.send([[0.0, 0.0]], sent=0.03, seq=seq) is None
    assert counted(sender) == {what: 1}


def test_numbers_that_are_missing_count_as_lost_and_the_interval_stays() -> None:
    sender = Sender()
    sender.ramp(3)
    assert sender.send([[0.003, 0.0]], sent=0.06, seq=7) is not None
    assert counted(sender) == {"lost": 3}
    assert sender.stream.status.interval_s == pytest.approx(PERIOD)


def test_a_point_out_of_reach_counts_once_the_next_one_is_there_too() -> None:
    sender = Sender()
    sender.ramp(3)
    assert sender.send([[0.5, 0.0]], sent=0.03) is None
    assert sender.send([[0.003, 0.0]], sent=0.04) is not None
    assert sender.send([[0.5, 0.0]], sent=0.05) is None
    targets = sender.send([[0.5, 0.0]], sent=0.06)
    assert knots_of(targets)[-1, 1:].tolist() == [0.5, 0.0, 0.0, 0.0]
    assert counted(sender) == {"jumped": 2}


@pytest.mark.parametrize(
    ("positions", "velocities", "times"),
    [
        ([[math.nan, 0.0]], None, None),
        ([[0.0, math.inf]], None, None),
        ([[0.0, 0.0]], [[0.0, math.nan]], None),
        ([[0.0]], None, None),
        ([[0.0, 0.0, 0.0]], None, None),
        ([[0.0, 0.0]] * 2, None, None),
        (None, None, None),
        ([[0.0, 0.0]] * 2, None, [0.1, 0.1]),
        ([[0.0, 0.0]] * 2, None, [0.2, 0.1]),
        ([[0.0, 0.0]] * 2, None, [-0.1, 0.1]),
        ([[0.0, 0.0]] * 2, None, [0.1, math.nan]),
        ([[0.0, 0.0]] * 2, None, [0.1, 1e6]),
        ([[0.0, 0.0]] * (POINTS + 1), None, [0.01 * each for each in range(POINTS + 1)]),
    ],
)
def test_what_does_not_fit_is_refused_and_the_number_stays_free(
    positions: list[list[float]] | None, velocities: list[list[float]] | None, times: list[float] | None
) -> None:
    sender = Sender()
    assert sender.send(positions, velocities, sent=0.0, times=times) is None
    assert counted(sender) == {"refused": 1}
    assert sender.send([[0.0, 0.0]], sent=0.01, seq=1) is not None


def test_targets_beyond_travel_and_speed_are_clipped() -> None:
    sender = Sender()
    knots = knots_of(sender.send([[5.0, -5.0]], [[9.0, -9.0]], sent=0.0))
    assert knots[0, 1:].tolist() == [1.0, -1.0, 1.0, -1.0]
    assert counted(sender) == {"clipped": 1}


def test_a_chunk_keeps_its_times_and_its_own_slopes_and_ends_at_rest() -> None:
    sender = Sender()
    times = [0.1 * each for each in range(1, 11)]
    targets = sender.send([[0.01 * each, 0.0] for each in range(1, 11)], sent=0.0, times=times)
    knots = knots_of(targets)
    assert knots[:, 0] == pytest.approx(times)
    assert knots[:-1, 3] == pytest.approx([0.1] * 9)
    assert knots[-1, 3] == 0.0
    assert targets is not None
    assert targets.until == pytest.approx(1.1)


@pytest.mark.parametrize(("longest", "counts"), [(60.0, True), (60.001, False)])
def test_a_chunk_lasts_a_minute_at_the_most(longest: float, counts: bool) -> None:
    targets = Sender().send([[0.0, 0.0], [0.1, 0.0]], sent=0.0, times=[0.1, longest])
    assert (targets is not None) == counts


def test_velocities_alone_are_followed_as_such() -> None:
    targets = Sender().send(None, [[0.1, 0.2]], sent=0.0)
    assert targets is not None
    assert targets.by_velocity
    assert targets.knots[0, 3:].tolist() == [0.1, 0.2]


def test_what_is_refused_has_come_and_is_not_lost() -> None:
    sender = Sender()
    sender.send([[0.0, 0.0]], sent=0.0)
    sender.send([[0.0]], sent=0.01)
    sender.send([[0.0, 0.0]], sent=0.03, seq=4)
    assert counted(sender) == {"refused": 1, "lost": 1}


def test_a_chunk_whose_curve_is_no_numbers_is_refused_and_not_said_to_be_taken() -> None:
    sender = Sender()
    assert sender.send([[0.0, 0.0], [0.1, 0.0], [0.2, 0.0]], sent=0.0, times=[0.0, 5e-324, 2e-323]) is None
    assert (counted(sender), sender.stream.status.taken) == ({"refused": 1}, 0)
