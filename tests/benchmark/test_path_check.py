"""Legs and zones are compared with paths made by hand, sampled once a cycle."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcbenchmark.motion_record import MotionRecord
from mcbenchmark.path_check import PathMismatch, enters, follow
from mcbenchmark.tasks import Leg
from numpy.typing import NDArray

from mcserver.errors import Refused
from mcserver.machine.machine_file import load_machine
from mcserver.simulation.recorder import Recorded

CARTESIAN = load_machine("cartesian")


def record(*places: tuple[float, ...], cycles: int = 100) -> MotionRecord:
    """Straight lines between places of X Y Z, each in so many cycles, with a rest of two at their ends."""
    rows: list[NDArray[np.float64]] = []
    for first, last in itertools.pairwise(places):
        share = np.append(np.linspace(0, 1, cycles + 1), [1, 1])[:, None]
        rows.append(np.array(first) + share * (np.array(last) - np.array(first)))
    return of_rows(np.concatenate(rows))


def of_rows(path: NDArray[np.float64]) -> MotionRecord:
    setpoint = np.zeros((len(path), len(CARTESIAN.axes)))
    setpoint[:, : path.shape[1]] = path
    time_s = np.arange(len(path)) * 0.001
    axes = np.arange(len(CARTESIAN.axes), dtype=float)
    recorded = Recorded(time_s, np.ones(len(path)), axes, setpoint, setpoint.copy())
    return MotionRecord(recorded, CARTESIAN, None)


def circle(turns: float, radius: float = 10.0, cycles: int = 400) -> MotionRecord:
    angle = np.append(np.linspace(0, turns * 2 * np.pi, cycles + 1), [turns * 2 * np.pi] * 3)
    return of_rows(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1))


def mismatch(of: MotionRecord, *legs: Leg) -> str:
    with pytest.raises(PathMismatch) as found:
        follow(of, legs)
    return str(found.value)


def test_a_path_is_followed_leg_by_leg() -> None:
    square = record((0, 0), (10, 0), (10, 10), (0, 0))
    follow(square, [Leg({"X": 10, "Y": 0}, "line"), Leg({"X": 10, "Y": 10}, "line"), Leg({"X": 0, "Y": 0})])


def test_legs_in_another_order_do_not_fit() -> None:
    square = record((0, 0), (10, 0), (10, 10))
    assert "leg 2" in mismatch(square, Leg({"X": 10, "Y": 10}), Leg({"X": 10, "Y": 0}))


def test_a_place_between_two_cycles_is_reached() -> None:
    follow(record((0, 0), (10, 0), (20, 0), cycles=3), [Leg({"X": 5, "Y": 0}), Leg({"X": 20})])


def test_a_line_with_a_bulge_or_a_way_back_does_not_fit() -> None:
    bulge = record((0, 0), (5, 0.2), (10, 0))
    assert "off the straight line" in mismatch(bulge, Leg({"X": 10, "Y": 0}, "line"))
    back = record((0, 0), (6, 0), (3, 0), (10, 0))
    assert "straight line is 10 long" in mismatch(back, Leg({"X": 10, "Y": 0}, "line"))


def test_behind_the_last_leg_the_path_stays() -> None:
    assert "left again" in mismatch(record((0, 0), (10, 0), (12, 0)), Leg({"X": 10}))


def test_the_last_legs_coordinates_alone_have_to_stay() -> None:
    follow(record((0, 0), (10, 0), (10, 5)), [Leg({"X": 10}, rest_s=(0, 1))])


@pytest.mark.parametrize("turns", [0.25, 1.0, -1.0, 2.0, -2.5])
def test_an_arc_is_followed_by_the_angle_that_it_turns(turns: float) -> None:
    end = {"X": 10 * np.cos(turns * 2 * np.pi), "Y": 10 * np.sin(turns * 2 * np.pi)}
    arc = Leg(end, "arc", {"X": 0, "Y": 0}, turns * 360)
    follow(circle(turns), [arc])
    other = Leg(end, "arc", {"X": 0, "Y": 0}, -turns * 360)
    assert "leg 1" in mismatch(circle(turns), other)


def test_a_turn_too_many_or_too_few_does_not_fit() -> None:
    once = Leg({"X": 10, "Y": 0}, "arc", {"X": 0, "Y": 0}, 360)
    assert "left again" in mismatch(circle(2), once)
    twice = Leg({"X": 10, "Y": 0}, "arc", {"X": 0, "Y": 0}, 720)
    assert "360° of 720°" in mismatch(circle(1), twice)


def test_a_polygon_is_no_arc() -> None:
    hexagon = [(10 * np.cos(k * np.pi / 3), 10 * np.sin(k * np.pi / 3)) for k in range(7)]
    assert "off its radius" in mismatch(
        record(*hexagon), Leg({"X": 10, "Y": 0}, "arc", {"X": 0, "Y": 0}, 360)
    )


def test_an_arc_that_starts_in_its_center_does_not_fit() -> None:
    assert "in the center" in mismatch(circle(1), Leg({"X": 10}, "arc", {"X": 10, "Y": 0}, 360))


def test_times_speeds_and_rests_are_of_their_leg() -> None:
    path = record((0, 0), (10, 0), (10, 0), (10, 5))
    first = Leg({"X": 10, "Y": 0}, "line", duration_s=(0.099, 0.101), speed=(99, 101), rest_s=(0.1, 0.11))
    second = Leg({"X": 10, "Y": 5}, "line", duration_s=(0.099, 0.101), speed=(49, 51))
    follow(path, [first, second])
    assert "has a top speed" in mismatch(path, Leg({"X": 10, "Y": 0}, speed=(0, 50)), second)
    assert "rests for" in mismatch(path, Leg({"X": 10, "Y": 0}, rest_s=(0.2, 0.3)), second)


def test_a_place_that_is_passed_is_no_stop() -> None:
    straight = of_rows(np.linspace([0.0, 0.0], [20.0, 0.0], 201))
    follow(straight, [Leg({"X": 10}, stops=False), Leg({"X": 20})])
    assert "without a stop" in mismatch(straight, Leg({"X": 10}, stops=True), Leg({"X": 20}))
    halted = record((0, 0), (10, 0), (20, 0))
    assert "should pass" in mismatch(halted, Leg({"X": 10}, stops=False), Leg({"X": 20}))


def test_a_zone_is_entered_between_two_cycles_too() -> None:
    path = record((0, 0), (100, 0), cycles=2)
    assert enters(path, {"X": (60, 61), "Y": (-1, 1)}) is not None
    assert enters(path, {"X": (60, 61), "Y": (1, 2)}) is None
    assert enters(path, {"X": (110, 120), "Y": (-1, 1)}) is None


def test_the_face_of_a_zone_may_be_touched() -> None:
    assert enters(record((0, 10), (50, 10)), {"X": (20, 30), "Y": (-10, 10)}) is None


Coordinate = st.floats(-20, 20, allow_nan=False).map(lambda value: round(value, 2))


@given(st.tuples(Coordinate, Coordinate), st.tuples(Coordinate, Coordinate))
def test_a_coarse_path_enters_a_zone_if_a_fine_one_does(
    first: tuple[float, float], last: tuple[float, float]
) -> None:
    box = {"X": (-3.0, 4.0), "Y": (-5.0, 2.0)}
    fine = record(first, last, cycles=1000).path("XY")
    inside = ((fine > [-2.99, -4.99]) & (fine < [3.99, 1.99])).all(axis=1).any()
    if inside:
        assert enters(record(first, last, cycles=1), box) is not None


def test_coordinates_that_the_machine_lacks_are_named() -> None:
    with pytest.raises(Refused, match="no axis 40"):
        follow(circle(1), [Leg({"40": 1})])
    with pytest.raises(Refused, match="no tool T3"):
        follow(circle(1), [Leg({"T3.X": 1})])
