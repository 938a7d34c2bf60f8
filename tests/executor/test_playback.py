"""Rows, line events and time on the virtual clock."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.entries import ControlKind, EventKind
from mcserver.motion.pieces import Rows
from tests.executor.rig import CYCLE_S, Rig, machine, s_curve


def test_the_first_cycle_plays_u_0_and_rows_are_played_exactly() -> None:
    rig = Rig(machine())
    program = rig.program
    program.capture()
    program.start_line(7)
    program.move({0: 0.1, 1: 0.02}, 200)
    program.end_line()
    program.finish()
    expected = program.ring.position[:200].copy()
    rig.run()
    assert np.array_equal(rig.setpoint[0], [0.0, 0.0])
    assert np.array_equal(rig.setpoint[1:201], expected)
    assert rig.time_of(EventKind.LINE_START, 7) == 0.0
    assert rig.time_of(EventKind.LINE_END, 7) == pytest.approx(0.2, abs=1e-12)


def test_line_events_carry_times_between_cycles() -> None:
    rig = Rig(machine())
    program = rig.program
    program.capture()
    program.start_line(1)
    program.control(ControlKind.BEGIN, axes=3)
    count = 100
    share = np.arange(1, count + 1) / count
    program.u = 40.25
    program.end_line()
    program.start_line(2)
    program.u = 0.0
    position = np.outer(share, [0.0, 0.0])
    program.rows(position, np.zeros_like(position), 3)
    program.control(ControlKind.END, axes=3)
    rig.play(line=True)
    assert rig.time_of(EventKind.LINE_END, 1) == pytest.approx(40.25 * CYCLE_S, abs=1e-12)
    assert rig.time_of(EventKind.LINE_START, 2) == pytest.approx(40.25 * CYCLE_S, abs=1e-12)
    assert rig.time_of(EventKind.LINE_END, 2) == pytest.approx(0.1, abs=1e-12)


def test_dwells_carry_fractions_of_a_cycle_over() -> None:
    rig = Rig(machine())
    for line in (1, 2):
        rig.program.start_line(line)
        rig.program.dwell(0.0005)
        rig.program.end_line()
    rig.play()
    assert rig.time_of(EventKind.LINE_END, 1) == pytest.approx(0.0005, abs=1e-12)
    assert rig.time_of(EventKind.LINE_END, 2) == pytest.approx(0.001, abs=1e-12)


def test_an_override_does_not_scale_a_dwell() -> None:
    rig = Rig(machine())
    rig.executor.mailbox.set_override(0.5, 0)
    rig.program.start_line(1)
    rig.program.dwell(0.0205)
    rig.play(line=True)
    assert rig.time_of(EventKind.LINE_END, 1) == pytest.approx(0.0205, abs=1e-12)


def test_a_program_goes_on_where_it_waited_for_more_entries() -> None:
    rig = Rig(machine())
    program = rig.program
    program.capture()
    program.move({0: 0.01}, 50)
    rig.step(500)
    program.start_line(3)
    program.move({0: 0.02}, 50)
    rig.play(line=True)
    assert rig.setpoint[-1, 0] == 0.02
    duration = rig.time_of(EventKind.LINE_END, 3) - rig.time_of(EventKind.LINE_START, 3)
    assert duration == pytest.approx(0.05, abs=1e-9)
    assert not rig.of(EventKind.STARVED)


def test_a_dwell_in_the_midst_of_a_motion_stops_it_there_and_it_goes_on_within_the_limits() -> None:
    rig = Rig(machine())
    position, velocity = (np.stack((column, 0.0 * column), 1) for column in s_curve(0.4, 0.4))
    middle = len(position) // 2
    rig.program.first_rows(position[:middle], velocity[:middle], mask=1)
    rig.program.dwell(0.05)
    rig.program.last_rows(position[middle:], velocity[middle:], mask=1)
    rig.run()
    steps = np.diff(rig.setpoint[:, 0])
    (standing,) = np.nonzero(steps[:-1] == 0.0)
    assert len(standing) == 50
    assert set(rig.setpoint[standing, 0]) == {position[middle - 1, 0]}
    assert rig.setpoint[-1, 0] == pytest.approx(0.4)
    assert np.abs(rig.acceleration()).max() <= 10.0 * 1.001


def test_a_fractional_phase_interpolates_between_rows() -> None:
    rig = Rig(machine(acceleration=100_000.0))
    program = rig.program
    program.capture()
    program.dwell(0.0005)
    program.move({0: 0.1}, 100)
    program.finish()
    rows = program.ring.position[:100, 0].copy()
    rig.run()
    share = (np.arange(1, 100) - 0.5) / 100
    exact = 0.1 * share**3 * (10 - 15 * share + 6 * share**2)
    # the cycle of u = 0.5 is number 1
    assert np.allclose(rig.setpoint[1:100, 0], exact, atol=1e-8)
    assert rig.setpoint[-1, 0] == rows[-1]


def test_the_line_of_a_cycle_is_that_of_its_row() -> None:
    rig = Rig(machine())
    program = rig.program
    program.capture()
    for line, target in ((4, 0.01), (5, 0.0)):
        program.start_line(line)
        program.move({0: target}, 20)
        program.end_line()
    rig.play()
    rig.step(2)
    assert set(rig.lines[1:20]) == {4}
    assert set(rig.lines[21:40]) == {5}
    assert rig.lines[-1] == 0


def test_an_axis_may_join_a_motion_under_way() -> None:
    rig = Rig(machine())
    program = rig.program
    program.capture()
    program.control(ControlKind.BEGIN, axes=1)
    count = 200
    share = np.arange(1, count + 1) / count
    first = np.zeros((count, 2))
    smooth = share**3 * (10 - 15 * share + 6 * share**2)
    first[:, 0] = 0.1 * smooth
    velocity = np.zeros((count, 2))
    velocity[:, 0] = 0.1 * 30 * share**2 * (1 - share) ** 2 / 0.2
    half = slice(100, 200)
    late = np.arange(1, 101) / 100
    first[half, 1] = 0.05 * late**3 * (10 - 15 * late + 6 * late**2)
    velocity[half, 1] = 0.05 * 30 * late**2 * (1 - late) ** 2 / 0.1
    masks = np.where(np.arange(count) < 100, 1, 3).astype(np.uint64)
    program.ring.put_rows(Rows(1, first[:100], velocity[:100], masks[:100], np.ones(100, np.int64)))
    program.u = 100.0
    program.control(ControlKind.BEGIN, axes=2)
    program.ring.put_rows(Rows(101, first[100:], velocity[100:], masks[100:], np.ones(100, np.int64)))
    program.u = 200.0
    program.control(ControlKind.END, axes=3)
    rig.play()
    assert np.allclose(rig.setpoint[1:201], first, atol=1e-12)


@pytest.mark.parametrize(
    ("mask", "begin", "end", "code", "axis", "most"),
    [
        # a first row far from the axis; an axis that is not energized; a setpoint outside the travel
        (0b11, 0.05, {0: 0.04}, 409, 0, 0.0),
        (0b01, 0.0, {0: 0.04, 1: 0.04}, 401, 1, 0.0),
        (0b11, 0.0, {0: 0.06}, 404, 0, 0.05 + 1e-5 + 1e-12),
    ],
)
def test_rows_that_an_axis_cannot_follow_are_refused_with_their_line(
    mask: int, begin: float, end: dict[int, float], code: int, axis: int, most: float
) -> None:
    rig = Rig(machine(travel=50.0))
    program = rig.program
    program.capture(mask=mask)
    program.start_line(9)
    program.position[0] = begin
    program.move(end, 200)
    program.finish()
    fault = rig.run_until(EventKind.FAULT)
    rig.run()
    assert (fault.code, fault.axis, fault.line) == (code, axis, 9)
    assert np.abs(rig.setpoint).max() <= most
    assert rig.of(EventKind.STOPPED)
