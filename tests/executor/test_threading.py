"""G33 from the text to the cycle: axes that follow a simulated spindle under load (D-89)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import SlotState
from mcserver.machine.machine_file import parse_machine
from mcserver.simulation.simulation import simulate
from mcserver.units import MM
from tests.executor.threading_rig import SPINDLE, Turned, assert_keeps_limits, lathe, lathe_text

PASS = "G21 G18 G90\nS1000 M3\nG0 X10 Z3\nG33 Z-20 K1.5\nG0 X12\nM2"
LATHE = lathe()


def loads(cell: Turned, *loads_at: tuple[int, float, int]) -> Callable[[int], None]:
    """Return a script of loads: each from a cycle on, as strong, for so many cycles."""

    def script(cycle: int) -> None:
        for begin, deceleration, cycles in loads_at:
            if cycle in (begin, begin + cycles):
                cell.bus.load(SPINDLE, deceleration if cycle == begin else 0.0)

    return script


def test_the_lead_is_that_of_the_pitch_while_a_load_slows_the_spindle() -> None:
    cell = Turned(LATHE, PASS)
    cell.run(loads(cell, (700, 1500.0, 150), (1000, 1000.0, 100)))
    assert cell.faults == []
    speeds = np.diff(cell.turns[cell.path(4)]) * 60e3
    assert speeds.min() < 930.0
    assert speeds.max() > 1050.0
    # at changes of 240 turns/s² at once; the step of the encoder alone is 0.4 µm
    assert np.abs(cell.helix(4, 1.5, 3.0)).max() < 10e-3
    assert cell.rows[cell.path(4).stop][2] / MM == pytest.approx(-20.0, abs=1e-9)
    assert_keeps_limits(cell, 4)


@settings(max_examples=6, suppress_health_check=list(HealthCheck))
@given(
    st.lists(st.tuples(st.integers(230, 1100), st.floats(-3000.0, 3000.0), st.integers(5, 300)), max_size=4),
    st.sampled_from(["G33 Z-20 K1.5", "G33 X14 Z-20 K1.5", "G33 Z-20 K0.2"]),
)
def test_whatever_the_load_does_the_axes_keep_their_limits(
    loads_at: list[tuple[int, float, int]], move: str
) -> None:
    cell = Turned(LATHE, PASS.replace("G33 Z-20 K1.5", move))
    cell.run(loads(cell, *loads_at), limit=12000)
    assert_keeps_limits(cell, 4)
    assert set(cell.faults) <= {FaultCode.THREAD_ERROR, FaultCode.SPINDLE_SPEED}


def test_passes_at_other_speeds_and_after_a_taper_fall_into_the_same_thread() -> None:
    lines = [
        "G33 Z-20 K1.5",
        "G0 Z3",
        "S620",
        "G4 P0.3",
        "G33 Z-20 K1.5",
        "G0 Z4.5",
        "S300",
        "G33 X12 Z-20 K1.5",
    ]
    cell = Turned(LATHE, PASS.replace("G33 Z-20 K1.5", "\n".join(lines)))
    cell.run()
    assert cell.faults == []
    for line in (4, 8):
        assert np.abs(cell.helix(line, 1.5, 3.0)).max() < 1.5e-3
    # K is the way along the line, of which Z is a part
    length = np.hypot(2.0, 24.5)
    assert np.abs(cell.helix(11, 1.5 * 24.5 / length, 4.5)).max() < 1.5e-3


def test_a_coarse_encoder_at_a_low_speed_does() -> None:
    # 0.6 of its steps a cycle
    coarse = parse_machine(lathe_text(resolution=1.0))
    cell = Turned(coarse, "G21 G18 G90\nS100 M3\nG0 X10 Z3\nG33 Z-4 K1.5\nM2")
    cell.run()
    assert cell.faults == []
    assert_keeps_limits(cell, 4)
    # half a step is 2 µm
    assert np.abs(cell.helix(4, 1.5, 3.0)).max() < 6e-3


def test_a_left_hand_thread_follows_m4() -> None:
    cell = Turned(LATHE, PASS.replace("M3", "M4"))
    cell.run()
    assert cell.faults == []
    cell.actuals = [row * np.array([1.0, 1.0, 1.0, -1.0]) for row in cell.actuals]
    assert np.abs(cell.helix(4, 1.5, 3.0)).max() < 1.5e-3


def test_a_hold_takes_effect_at_the_end_of_the_pass_and_an_override_not_at_all() -> None:
    free, cell = Turned(LATHE, PASS), Turned(LATHE, PASS)
    free.run()
    mailbox = cell.executor.mailbox
    for cycle in range(2500):
        if cycle == 600:
            mailbox.set_override(0.3, 0)
            mailbox.set_hold(True, 0)
        cell.step()
    along = free.path(4)
    assert np.array_equal(np.array(cell.rows)[along, 2], np.array(free.rows)[along, 2])
    # X has not gone out
    assert cell.rows[-1][0] / MM == pytest.approx(10.0)
    assert cell.executor.feedback.slots[0].state == SlotState.HELD
    mailbox.set_hold(False, 0)
    mailbox.resume(0)
    cell.run()
    assert cell.rows[-1][0] / MM == pytest.approx(12.0)


def test_a_spindle_that_stops_stops_the_axes() -> None:
    cell = Turned(LATHE, PASS)
    cell.run(lambda cycle: cell.bus.jam(SPINDLE) if cycle == 700 else None)
    assert set(cell.faults) & {FaultCode.THREAD_ERROR, FaultCode.SPINDLE_SPEED}
    assert -20.0 < cell.rows[-1][2] / MM < 0.0
    assert_keeps_limits(cell, 4)


def test_a_spindle_that_does_not_come_to_speed_is_a_fault_and_nothing_moves() -> None:
    cell = Turned(LATHE, PASS)
    cell.bus.jam(SPINDLE)
    cell.run()
    assert cell.faults == [FaultCode.SPINDLE_SPEED]
    assert cell.rows[-1][2] / MM == pytest.approx(3.0)


def test_an_abort_brings_axes_and_spindle_to_rest_within_their_limits() -> None:
    cell = Turned(LATHE, PASS)
    cell.run(lambda cycle: cell.executor.mailbox.abort(0) if cycle == 700 else None)
    assert cell.faults == []
    assert_keeps_limits(cell, 4)
    assert -20.0 < cell.rows[-1][2] / MM < 0.0


TAPPING = "G21 G17 G90\nS600 M3\nG0 Z5\nG33.1 Z-12 K1\nG33.1 Z-12 K1\nG4 P0.3\nG0 X5\nM2"


def test_tapping_follows_the_spindle_through_its_reversal_and_back() -> None:
    cell = Turned(LATHE, TAPPING)
    cell.run(loads(cell, (450, 500.0, 200), (1200, 300.0, 300)))
    assert cell.faults == []
    for line in (4, 5):
        along = cell.path(line)
        z, turns = np.array(cell.rows)[along, 2] / MM, cell.turns[along]
        # the thread's end, not above it, within the way of two cycles
        assert z.min() == pytest.approx(-12.0, abs=0.02)
        assert z[-1] == pytest.approx(5.0, abs=1e-9)
        beside = (z - 5.0 + turns)[z < 4.0]
        assert np.abs(beside - np.round(np.median(beside))).max() < 10e-3
        assert_keeps_limits(cell, line)
    # it turns as before
    assert np.diff(cell.turns)[-100:].mean() * 60e3 == pytest.approx(600.0, abs=5.0)
    assert cell.rows[-1][0] / MM == pytest.approx(5.0)


def test_a_spindle_that_stands_taps_in_pecks_on_one_helix_and_stands_again() -> None:
    cell = Turned(LATHE, "G21 G17 G90\nS600\nG0 Z5\nG84 Z-12 R5 F600 Q8\nG4 P0.3\nG80 G0 X5\nM2")
    cell.run(loads(cell, (900, 300.0, 300)))
    assert cell.faults == []
    times = [each.time for each in cell.of(EventKind.LINE_START) if each.line in (4, 5)]
    tapping = slice(round(times[0] / cell.machine.cycle_s), round(times[-1] / cell.machine.cycle_s))
    z, turns = np.array(cell.rows)[tapping, 2] / MM, cell.turns[tapping]
    lowest = np.flatnonzero((z[1:-1] < z[:-2]) & (z[1:-1] <= z[2:])) + 1
    assert z[lowest] == pytest.approx([-3.0, -11.0, -12.0], abs=0.02)
    beside = (z - 5.0 + turns)[z < 4.0]
    assert np.abs(beside - np.round(beside)).max() < 10e-3
    assert np.abs(np.diff(cell.turns)[-50:]).max() * 60e3 < 1.0


def test_g86_is_drawn_out_of_the_hole_while_the_spindle_stands() -> None:
    cell = Turned(LATHE, "G21 G17 G90\nS600 M3\nG0 Z5\nG4 P0.3\nG86 Z-2 R3 F600\nG80 G0 X5\nM2")
    cell.run()
    assert cell.faults == []
    z, speed = np.array(cell.rows)[:, 2] / MM, np.diff(cell.turns, append=cell.turns[-1]) * 60e3
    bottom = np.flatnonzero(z < -1.999)[-1]
    up = np.flatnonzero((np.arange(len(z)) > bottom) & (z > 2.999))[0]
    assert np.abs(speed[bottom:up]).max() < 15.0
    assert speed[-100:-1].mean() == pytest.approx(600.0, abs=5.0)


def test_a_hold_in_a_hole_takes_effect_above_it() -> None:
    cell = Turned(LATHE, TAPPING)
    for cycle in range(6000):
        if cycle == 1500:
            cell.executor.mailbox.set_hold(True, 0)
        cell.step()
    assert np.array(cell.rows)[:, 2].min() / MM < -11.9
    assert cell.rows[-1][2] / MM == pytest.approx(5.0)
    assert cell.executor.feedback.slots[0].state == SlotState.HELD


def test_m19_stops_the_spindle_at_its_angle_and_holds_it() -> None:
    cell = Turned(LATHE, "G21 G90\nS600 M3\nG4 P0.3\nM19 R90\nG1 X1 F60\nM3\nG4 P0.3\nM2")
    cell.run()
    assert cell.faults == []
    held = cell.turns[cell.path(5)][:-1] % 1.0
    assert np.abs(held - 0.25).max() < 1e-3
    assert np.diff(cell.turns)[-50:].mean() * 60e3 == pytest.approx(600.0, abs=5.0)


def test_the_spindle_turns_on_while_axes_go_by_g28() -> None:
    cell = Turned(LATHE, "G21 G90\nS600 M3\nG0 Z5\nG28 Z5\nG4 P0.2\nM2")
    cell.run()
    assert np.diff(cell.turns)[-50:].mean() * 60e3 == pytest.approx(600.0, abs=5.0)


def test_simulate_knows_the_time_and_the_end_of_a_thread() -> None:
    report = simulate(PASS, lathe(drive="ideal")).report
    assert report["ok"]
    (line,) = [each for each in report["lines"] if each["line"] == 4]
    assert line["requested_s"] == pytest.approx(23.0 / 1.5 / 1000.0 * 60.0)
    assert report["feed_length_mm"] == pytest.approx(23.0)
    assert report["axes"]["2"]["position"] == pytest.approx(-20.0)
    assert simulate(PASS, lathe(drive="ideal")).report == report
