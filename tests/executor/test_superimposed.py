"""Axes that follow others besides what programs order: work on a conveyor that moves (D-142)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.drives.bus import Feedback, Setpoints
from mcserver.drives.simulated import SimulatedBus
from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import FaultCode
from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.units import MM
from tests.executor.coupled import LAW, Coupled, abort, eye, hold, pushed, pushes, resume, under_orders
from tests.machine_text import axes_text

BESIDES = (
    "follow = { leader = 5, ratio = 1.0, tolerance = 0.05, source = 'encoder', superimposed = true, "
    "window = [0.0, 400.0], reserve = 0.4MORE }"
)
# of the belt: 60 mm/s
BELT = "G1010\nG1030 [5]360\nG04 P0.3\nG90 G94 F6000\n"
SHAPE = "G1 X25 Y10\nG2 X45 Y10 I10 J0\nG0 X45 Y30\nG1 X10 Y0\n"


def machine(
    more: str = "",
    keys: str = "",
    inputs: str = "",
    window: float = 400.0,
    drive: str = "ideal",
    belt: str | None = None,
) -> Machine:
    """X follows the belt [5] besides; Y and [3] are as any other. ``belt``: its keys, and it is ordered."""
    bed = axes_text(
        (0,), drive=drive, keys=f"max_jerk = 40000.0\nmin_position = -50.0\nmax_position = 700.0\n{keys}"
    )
    besides = BESIDES.replace("MORE", more).replace("400.0", f"{window}")
    bed = bed.replace("[axis.drive]", f"{besides}\n[axis.drive]")
    if belt is not None:
        bed = bed.replace("'encoder'", "'setpoint'")
    led = axes_text(
        (5,),
        velocity=400.0,
        acceleration=2000.0,
        drive="simulated",
        drive_keys="encoder_resolution = 0.005",
        keys="max_following_error = 1e6",
    )
    if belt is not None:
        led = axes_text((5,), velocity=60.0, acceleration=200.0, keys=f"max_jerk = 2000.0\n{belt}")
    others = axes_text((1, 3), keys="max_jerk = 40000.0")
    head = '[machine]\nname = "picker"\n[motion]\npath_tolerance_mm = 0.2\n'
    return parse_machine(f"{head}{bed}{others}{led}{inputs}")


MACHINE = machine()


class Picker(Coupled):
    """A program beside a belt."""

    @property
    def offsets(self) -> Array:
        """Where X is ordered to be beside the program, in each cycle [m]: what the belt has gone."""
        return np.array(self.actuals)[:, self.column(5)]


def test_a_share_of_the_limits_is_kept_from_programs() -> None:
    axis = MACHINE.axes[0]
    assert axis.reserved is not None
    assert axis.max_velocity == pytest.approx(0.6 * 200.0 * MM)
    assert axis.max_jerk == pytest.approx(0.6 * 40_000.0 * MM)
    assert axis.reserved.acceleration == pytest.approx(0.4 * 2000.0 * MM)


def test_a_program_draws_the_same_shape_on_a_belt_that_moves() -> None:
    still = Picker(MACHINE, f"G1010\nG90 G94 F6000\n{SHAPE}M2").play()
    cell = Picker(MACHINE, f"{BELT}G1060 P0\n{SHAPE}G1061\nM2").play()
    assert cell.faults == still.faults == []
    assert cell.broken() == []
    drawn = cell.setpoints(0) - cell.offsets
    moves = np.flatnonzero(np.abs(np.diff(cell.setpoints(1))) > 0.0)
    part = slice(moves[0], moves[-1] + 1)
    # on the belt: the shape ends where it does on one that stands
    start = drawn[moves[-1]] - still.setpoints(0)[-1]
    path = np.column_stack([drawn[part] - start, cell.setpoints(1)[part]])
    ideal = np.column_stack([still.setpoints(0), still.setpoints(1)])
    # every fifth one: a row of the other is up to 60 µm away along the path
    apart = [np.hypot(*(ideal - place).T).min() for place in path[::5]]
    assert max(apart) < 0.07 * MM
    assert np.ptp(cell.offsets[part]) > 0.05
    # and comes to rest by itself while the belt goes on
    assert np.diff(cell.setpoints(0))[-1] == 0.0


def test_what_comes_behind_g1061_is_in_the_frame_that_stands() -> None:
    cell = Picker(MACHINE, f"{BELT}G1060 P0\nG1 X50\nG04 P1\nG1061\nG1 X20 Y5\nM2").play()
    assert cell.faults == []
    assert cell.broken() == []
    assert cell.setpoints(0).max() > 0.11
    assert cell.setpoints(0)[-1] == pytest.approx(20.0 * MM, abs=1e-9)


@under_orders(2500, ends_from=320)
def test_whatever_is_ordered_limits_are_kept_and_a_stop_leaves_the_axis_at_rest(
    orders: dict[int, Callable[[Coupled], None]], at: int, end: Callable[[Coupled], None]
) -> None:
    cell = Picker(MACHINE, f"{BELT}G1060 P0\n{SHAPE * 3}G1061\nM2")
    cell.play({**orders, at: end})
    assert cell.broken(jerk=end is abort) == []
    executor = cell.executor.executor
    assert executor._cycle.couplings.engaged == ()
    assert executor.bank.shaper is not None
    assert not executor.bank.shaper.added.any()
    if end is abort:
        assert cell.faults == []
        assert np.diff(cell.setpoints(0))[-1] == 0.0


@LAW
@given(pushed(range(300, 1500)), st.booleans())
def test_whatever_the_belt_does_the_axis_keeps_its_limits(
    what: dict[int, tuple[str, float]], shaped: bool
) -> None:
    keys = 'shaper = { type = "ei", frequency_hz = 40.0 }' if shaped else ""
    cell = Picker(machine(keys=keys), f"{BELT}G1060 P0\n{SHAPE}G1061\nM2").play(pushes(what, 5))
    assert cell.broken() == []
    assert set(cell.faults) <= {FaultCode.OUT_OF_STEP, FaultCode.WINDOW_LEFT}


def test_a_stalled_cycle_leaves_the_axis_where_its_drive_stands() -> None:
    cell = Picker(MACHINE, f"{BELT}G1060 P0\n{SHAPE}G1061\nM2")
    cell.play({900: lambda each: each.executor.miss(100)})
    assert cell.faults[0] == FaultCode.CYCLE_STALLED
    assert cell.setpoints(0)[-1] == cell.setpoints(0)[899] != 0.0
    executor = cell.executor.executor
    assert executor.bank.shaper is not None
    assert not executor.bank.shaper.added.any()
    assert executor.row.ordered[0] == executor.row.setpoint[0]


@pytest.mark.parametrize("keys", ["", 'shaper = { type = "ei", frequency_hz = 40.0 }'])
def test_a_leader_that_is_ordered_is_followed_with_its_shaper(keys: str) -> None:
    made = machine(keys=keys, belt=keys)
    cell = Picker(made, "G1010\nG1060 P0\nG1020 [5]60\nG04 P2\nG1061\nM2").play()
    assert cell.faults == []
    beside = cell.setpoints(0) - cell.setpoints(5)
    assert np.abs(beside[:1900]).max() < 0.001 * MM


def delay_feedback(monkeypatch: pytest.MonkeyPatch, cycles: int) -> None:
    """Let what simulated drives show be that many cycles behind, as on a bus."""
    exchange, shown = SimulatedBus.exchange, deque[Feedback](maxlen=cycles + 1)

    def late(bus: SimulatedBus, setpoints: Setpoints) -> Feedback:
        now = exchange(bus, setpoints)
        shown.append(replace(now, position=now.position.copy(), velocity=now.velocity.copy()))
        return replace(now, position=shown[0].position, velocity=shown[0].velocity)

    monkeypatch.setattr(SimulatedBus, "exchange", late)
    monkeypatch.setattr(SimulatedBus, "delay_cycles", cycles)


@pytest.mark.parametrize("delay", [0, 2])
def test_axes_come_to_an_exact_stop_on_a_belt_that_moves(delay: int, monkeypatch: pytest.MonkeyPatch) -> None:
    delay_feedback(monkeypatch, delay)
    bed = machine(drive="simulated")
    cell = Picker(bed, f"{BELT}G1060 P0\nG1 X10\nG0 X20\nG91\nG0 X5\nG0 X5\nG90\nG1061\nM2").play()
    assert cell.faults == []
    assert len(cell.rows) < 2500
    beside = cell.setpoints(0) - cell.offsets
    places, cycles = np.unique(np.round(beside[300:] / (0.01 * MM)), return_counts=True)
    # increments are those of the program, however far an encoder is behind
    assert np.diff(places[cycles > 20]).tolist() == pytest.approx([1000.0, 500.0, 500.0], abs=1.5)


def test_an_axis_whose_drive_fails_has_no_offset_left() -> None:
    made = machine()
    cell = Picker(made, f"{BELT}G1060 P0\n{SHAPE}G1061\nM2")
    cell.play({700: lambda each: each.bus.trip(each.column(5))})
    assert cell.faults == [FaultCode.OVER_TEMPERATURE]
    assert cell.broken() == []
    assert cell.executor.executor._cycle.couplings.engaged == ()


def test_in_a_feed_hold_the_tool_stands_on_the_work_that_goes_on() -> None:
    cell = Picker(MACHINE, f"{BELT}G1060 P0\n{SHAPE}G1061\nM2")
    cell.play({700: hold, 1500: resume})
    assert cell.faults == []
    assert np.ptp((cell.setpoints(0) - cell.offsets)[1200:1490]) < 0.02 * MM
    assert np.ptp(cell.setpoints(0)[1200:1490]) > 0.015


def test_the_end_of_the_window_stops_the_program_within_it() -> None:
    cell = Picker(machine(window=100.0), f"{BELT}G1060 P0\nG1 X40\nG04 P20\nG1061\nM2").play()
    assert cell.faults == [FaultCode.WINDOW_LEFT]
    assert cell.broken() == []
    assert cell.setpoints(0).max() <= 140.0 * MM


def test_an_axis_has_to_stand_where_its_window_leaves_room() -> None:
    cell = Picker(MACHINE, f"{BELT}G0 X310\nG1060 P0\nM2").play()
    assert cell.faults == [FaultCode.SOFT_LIMIT]
    assert cell.setpoints(0).max() <= 310.0 * MM + 1e-9


def test_a_program_ends_once_the_axis_stands() -> None:
    cell = Picker(MACHINE, f"{BELT}G1060 P0\nG1 X40\nM2").play()
    assert cell.faults == []
    assert cell.broken() == []
    assert cell.executor.executor._cycle.couplings.engaged == ()


@pytest.mark.parametrize("risen", [(0.1,), (0.1, 2.7)])
def test_works_are_taken_one_by_one_as_they_come_into_the_window(risen: tuple[float, ...]) -> None:
    made = machine(", latch = 4, after = 60.0", inputs=eye(*risen))
    pick = "G1060 P0\nG04 P1\nG1061\nG1 X0\n"
    cell = Picker(made, f"G1010\nG1030 [5]360\nG90 G94 F6000\n{pick * len(risen)}M2").play()
    assert cell.faults == []
    assert cell.broken() == []
    belt, drawn = cell.offsets, cell.setpoints(0)
    for seconds in risen:
        cycle = round(1000.0 * seconds)
        # the work is at the place of the program's zero 60 mm behind the eye
        due = int(np.argmax(belt >= belt[cycle] + 60.0 * MM))
        beside = (drawn - (belt - belt[due]))[due + 600 : due + 900]
        assert np.ptp(beside) < 0.02 * MM
        # what the belt goes in a cycle or two of the input
        assert abs(beside.mean()) < 0.15 * MM


def test_a_work_that_has_left_the_window_is_passed_over() -> None:
    made = machine(", latch = 4, after = 60.0", inputs=eye(0.1, 4.0), window=100.0)
    cell = Picker(made, "G1010\nG1030 [5]360\nG04 P3.5\nG1060 P0\nG04 P0.4\nG1061\nM2").play()
    assert cell.faults == []
    # it waits for the second one
    assert not np.diff(cell.setpoints(0))[:5000].any()


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        (", cam = [[0.0, 0.0], [1.0, 1.0]]", "a ratio and a cam"),
        (", latch = 9", "no digital input 9"),
        (", after = 3.0", "no latch"),
    ],
)
def test_a_section_that_cannot_be_is_refused(keys: str, what: str) -> None:
    with pytest.raises(MachineFileRejected, match=what):
        machine(keys)


def test_the_window_holds_0_and_is_of_superimposed_ones_alone() -> None:
    text = BESIDES.replace("MORE", "")
    for wrong in (text.replace("[0.0, 400.0]", "[10.0, 400.0]"), text.replace("superimposed = true, ", "")):
        axes = axes_text((0,)).replace("[axis.drive]", f"{wrong}\n[axis.drive]") + axes_text((5,))
        with pytest.raises(MachineFileRejected, match="MC094"):
            parse_machine(f'[machine]\nname = "wrong"\n{axes}')


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G1 X310", "MC201"),
        ("G1030 X60", "MC345"),
        ("G1 X290 F600", None),
        ("G1060 P0", "MC346"),
        ("G1020 X20", None),
    ],
)
def test_lines_on_a_belt_are_checked(line: str, code: str | None) -> None:
    found = check_program(f"G1010\nG90 G94 F600\nG1060 P0\n{line}\nG1061\nM2", MACHINE)
    assert [each.code for each in found] == ([] if code is None else [code])
