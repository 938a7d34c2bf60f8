"""Input shaping: what drives get keeps every limit and its bound, and nothing is said before its end."""

from __future__ import annotations

import itertools
import math
from typing import get_args

import msgspec
import numpy as np
import pytest

from mcserver.drives.simulated import SimulatedBus
from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.envelope_bounds import enforced
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.shm.feedback import AxisCondition, SlotState
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.machine.shaper_section import Shaper, ShaperType, Shaping
from mcserver.planning.start_state import StartState
from mcserver.simulation.preview import preview
from mcserver.simulation.simulation import Simulation, simulate
from tests.bench.motion_laws import judge, program_of
from tests.bench.shaped_machines import broken_by_shapers
from tests.executor.homing_cell import SWITCH, Cell
from tests.executor.homing_cell import machine as machine_to_home
from tests.executor.planned import Planned
from tests.executor.rig import CYCLE_S, Rig, machine, under_way
from tests.limits import assert_keeps, limits_of
from tests.machine_text import axes_text

EI, ZV, SMOOTH = (
    f'shaper = {{ type = "{kind}", frequency_hz = 40.0, damping = 0.05 }}' for kind in ("ei", "zv", "smooth")
)
WIDE = "path_tolerance_mm = 5.0"
RIG = {"acceleration": 5000.0, "jerk": 200_000.0, "motion": WIDE, "axis": EI}
MM = 1e-3


def shaped(*shapers: str, axis: str = "", drive: str = "ideal", end: str = "") -> Machine:
    """A machine of linear axes with a shaper each, or none."""
    text = f'[machine]\nname = "shaped"\n[motion]\n{WIDE}\n'
    for index, shaper in enumerate(shapers):
        text += axes_text([index], keys=f"max_jerk = 50000.0\n{shaper}\n{axis}", drive=drive)
    return parse_machine(text + end)


def run(text: str, described: Machine) -> Simulation:
    found = simulate(text, described, record=True)
    assert found.report["ok"], found.report["diagnostics"]
    return found


def moving(**keys: object) -> Rig:
    """A program in the midst of a fast move of axis 0."""
    return under_way(Rig(machine(**{**RIG, **keys})), 0.5)  # type: ignore[arg-type]


def assert_limits(rig: Rig) -> None:
    assert_keeps(rig.setpoint, limits_of(rig.machine), most=(1.05,) * 3)
    assert broken_by_shapers(rig) == []


@pytest.mark.parametrize("kind", get_args(ShaperType))
@pytest.mark.parametrize("damping", [0.0, 0.1, 0.3])
def test_a_shaper_is_a_mean_that_leaves_no_vibration_at_its_frequency(kind: str, damping: float) -> None:
    shaper = Shaper(kind, 37.0, damping)  # type: ignore[arg-type]
    omega = 2.0 * math.pi * 37.0
    root = math.sqrt(1.0 - damping**2)
    impulses = shaper.impulses()
    assert sum(weight for _, weight in impulses) == pytest.approx(1.0)
    assert all(weight >= 0.0 for _, weight in impulses)
    turns = [weight * np.exp(omega * at * complex(damping, root)) for at, weight in impulses]
    left = abs(sum(turns)) * math.exp(-damping * omega * impulses[-1][0])
    assert left <= (1e-9 if "zv" in kind else 0.0501)
    (alone,) = (Shaping.of([axis], CYCLE_S) for axis in shaped(f"shaper = {written(shaper)}").axes)
    assert alone is not None
    (weights,) = alone.weights
    assert min(weights) >= 0.0
    assert sum(weights) == pytest.approx(1.0)
    assert sum(at * weight for at, weight in enumerate(weights)) == pytest.approx(alone.delay)


def written(shaper: Shaper) -> str:
    return f'{{ type = "{shaper.type}", frequency_hz = {shaper.frequency_hz}, damping = {shaper.damping} }}'


@pytest.mark.parametrize("share", [0.9, 1.0, 1.1])
def test_ei_and_smooth_leave_a_twentieth_of_a_vibration_at_a_tenth_beside_their_frequency(
    share: float,
) -> None:
    keys = f"flexible_hz = {40.0 * share}\nflexible_damping = 0.05\nbandwidth_hz = 300.0\n"

    def left_by(axis: str) -> float:
        rig = Rig(machine(1, drive="simulated", drive_keys=keys, motion=WIDE, axis=axis, acceleration=5000.0))
        rig.program.capture()
        rig.program.dwell(0.05)
        rig.program.rapid({0: 0.03})
        rig.program.wait(1)
        rig.play()
        rig.step(50)
        (rests,) = np.nonzero(rig.setpoint[:, 0] != 0.03)
        swing = rig.actual[rests[-1] + 2 :, 0] - 0.03
        return float(np.abs(swing[:40]).max())

    assert max(left_by(EI), left_by(SMOOTH)) <= 0.05 * left_by("")


def test_an_axis_without_a_shaper_is_delayed_exactly() -> None:
    rig = Rig(shaped(EI, ""))
    rig.program.capture()
    rig.program.move({0: 0.05, 1: 0.05}, 1000)
    rig.play()
    shaping = rig.machine.shaping
    assert shaping is not None
    assert np.abs(rig.setpoint[shaping.delay :, 1] - rig.ordered[: -shaping.delay, 1]).max() < 1e-15
    assert shaping.deviations[1] == 0.0
    assert broken_by_shapers(rig) == []


@pytest.mark.parametrize("seed", range(3))
def test_random_programs_under_orders_keep_the_laws_of_motion_with_shapers(seed: int) -> None:
    broken, _, _ = judge(seed, program_of, orders=True, shapers=True)
    assert broken == []


def test_the_path_is_left_by_its_tolerance_at_the_most_corners_and_shapers_together() -> None:
    text = "G90 G94 G61\nG1010\nG64 P0.4\nG01 X20 F9000\nY20\nX0\nY0\nG02 X20 Y20 I20 J0\nM02"
    found = run(text, shaped(EI, ZV))
    recorded = found.recording
    assert recorded is not None
    deviation = found.report["shaping"]["path_deviation_mm"]
    assert 0.05 < deviation < 0.4
    far = distance_from(recorded.setpoint)
    # a corner uses what shapers leave of the tolerance
    assert deviation < far.max() <= 0.4


def distance_from(points: np.ndarray) -> np.ndarray:
    """Distance of each point from a square of 20 mm and an arc of 20 mm about one of its corners."""
    corners = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0), (0.0, 0.0)]
    found = [np.abs(np.hypot(points[:, 0] - 20.0, points[:, 1]) - 20.0)]
    for start, end in itertools.pairwise(np.array(corners)):
        along = np.clip((points - start) @ (end - start) / 400.0, 0.0, 1.0)
        found.append(np.linalg.norm(points - start - along[:, None] * (end - start), axis=1))
    return np.min(found, axis=0)


def test_an_exact_stop_waits_for_the_shaped_end() -> None:
    found = run("G90 G94 G61\nG1010\nG01 X20 F9000\nG01 Y20\nG00 X0\nM02", shaped(EI, ZV))
    recorded = found.recording
    assert recorded is not None
    for corner in ((20.0, 0.0), (20.0, 20.0)):
        assert (recorded.setpoint == corner).all(axis=1).any()
    ends = {line["line"]: line["end_s"] for line in found.report["lines"]}
    for line, axis, target in ((3, 0, 20.0), (4, 1, 20.0)):
        arrived = float(recorded.time_s[np.flatnonzero(recorded.setpoint[:, axis] == target)[0]])
        assert ends[line] >= arrived - 1e-9
        assert ends[line] <= arrived + 0.002
    assert recorded.setpoint[-1].tolist() == [0.0, 20.0]


@pytest.mark.parametrize("order", ["hold", "abort", "estop"])
def test_stops_keep_the_limits_and_end_later_by_the_shaper_at_the_most(order: str) -> None:
    def rest_of(axis: str) -> tuple[Rig, int]:
        rig = moving(axis=axis)
        mailbox = rig.executor.mailbox
        {
            "hold": lambda: mailbox.set_hold(True, 0),
            "abort": lambda: mailbox.abort(0),
            "estop": mailbox.emergency_stop,
        }[order]()
        rig.step(1500)
        return rig, int(np.flatnonzero(np.diff(rig.setpoint[:, 0]))[-1])

    plain, shorter = rest_of("")
    rig, longer = rest_of(EI)
    assert rig.machine.shaping is not None
    assert 0 <= longer - shorter <= rig.machine.shaping.length
    state = rig.executor.feedback.slots[0].state
    assert state is plain.executor.feedback.slots[0].state
    if order != "estop":
        # without regard to jerk
        assert_limits(rig)
    if order == "hold":
        rig.executor.mailbox.resume(0)
        rig.run()
        assert rig.setpoint[-1, 0] == 0.5
        assert_limits(rig)


def test_held_and_off_are_said_once_drives_have_got_the_last_setpoint() -> None:
    rig = moving()
    rig.executor.mailbox.set_hold(True, 0)
    while rig.executor.feedback.slots[0].state is not SlotState.HELD:
        rig.step()
    assert not rig.executor.feedback.velocity.any()
    rig = moving(drive="simulated")
    rig.executor.mailbox.emergency_stop()
    while rig.executor.feedback.condition[0] is not AxisCondition.OFF and rig.executor.feedback.condition[0]:
        before = rig.executor.feedback.setpoint[0]
        rig.step()
    assert rig.executor.feedback.setpoint[0] == pytest.approx(before, abs=1e-4)


def test_a_stall_leaves_the_drives_at_the_last_setpoint() -> None:
    rig = moving()
    before = rig.setpoint[-1].copy()
    assert rig.executor.feedback.velocity[0] > 0.3
    rig.executor.miss(2000)
    rig.step(100)
    assert (rig.setpoint[1000:] == before).all()
    assert not rig.executor.feedback.velocity.any()
    assert rig.executor.feedback.slots[0].state is SlotState.FAULTED
    assert {event.code for event in rig.of(EventKind.FAULT)} == {FaultCode.CYCLE_STALLED}


def test_an_axis_that_coasts_is_captured_without_a_jump() -> None:
    rig = Rig(machine(**{**RIG, "travel": None, "drive": "simulated"}))  # type: ignore[arg-type]
    (bus,) = rig.executor.buses
    assert isinstance(bus, SimulatedBus)
    bus.push(0, 0.3)
    rig.step(20)
    rig.program.capture()
    rig.play()
    rig.step(50)
    assert np.abs(rig.acceleration()[22:]).max() <= 1.05 * rig.machine.axes[0].max_acceleration
    assert rig.setpoint[-1, 0] == rig.ordered[-1, 0]


def test_a_speed_is_shaped_and_taken_back_within_the_limits() -> None:
    rig = Rig(machine(**{**RIG, "travel": None, "drive": "simulated"}))  # type: ignore[arg-type]
    rig.program.speed({0: 0.4})
    rig.program.dwell(0.4)
    rig.program.control(ControlKind.HALT_AXES, axes=1)
    rig.program.rapid({0: 0.0})
    rig.program.wait(1)
    rig.play()
    assert rig.setpoint[-1, 0] == pytest.approx(0.0, abs=1e-12)
    assert_limits(rig)


def test_homing_gives_positions_without_a_jump_for_the_drive() -> None:
    drive = "home_switch = [-1000.0, -50.0]\n"
    plain = machine_to_home((drive, f"{SWITCH}then_move_to = 5.0"), travel=500.0)
    axis = msgspec.structs.replace(plain.axes[0], shaper=Shaper("ei", 40.0, 0.05))
    cell = Cell(msgspec.structs.replace(plain, axes=(axis,), shaping=Shaping.of([axis], CYCLE_S)))
    cell.find_home(0)
    assert cell.of(EventKind.HOMED)
    assert not cell.of(EventKind.FAULT)
    steps = np.diff(np.array(cell.drive_setpoints)[:, 0], 2) / CYCLE_S**2
    assert np.abs(steps).max() <= 1.01 * axis.max_acceleration


def test_outputs_are_set_where_the_shaped_path_is() -> None:
    outputs = '[dialect]\nprofile = "cnc"\n[dialect.outputs]\nM3 = { power = "S" }\nM5 = { power = 0 }\n'
    outputs += '[[output]]\nnumber = 0\nname = "power"\nkind = "analog"\nmax = 1000.0\nlaser = true\n'
    text = "G21 G90 G94 F6000 G64 P4\nM3 S400\nG1 X10\nG1 X20 S800\nG1 X30\nM5\nG1 X40\nM2"
    found = run(text, shaped(EI, EI, end=outputs))
    recorded = found.recording
    assert recorded is not None
    power, place = recorded.outputs["power"], recorded.setpoint[:, 0]
    for value, start, end in ((400.0, 0.0, 10.0), (800.0, 10.0, 30.0)):
        lit = place[power == value]
        assert lit.min() == pytest.approx(start, abs=0.15)
        assert lit.max() == pytest.approx(end, abs=0.15)


def test_an_approved_run_stays_within_what_was_shown() -> None:
    described = shaped(EI, ZV)
    text = "G90 G94\nG1010\nG01 X5 F12000\nX0 Y3\nG02 X4 Y3 I2 J0\nG00 X0 Y0\nM02"
    shown = preview(text, described, StartState.of(described), (0, 1))
    assert shown.envelope is not None
    played = Planned(described, text, envelope=enforced(shown.envelope, described, 1.0, (0.0, 0.0)))
    while not played.ended:
        played.step()
    assert played.faults == []
    assert np.abs(played.rows[-1]).max() == 0.0


def test_a_machine_without_room_for_its_shapers_is_refused_with_the_numbers() -> None:
    text = '[machine]\nname = "m"\n[motion]\npath_tolerance_mm = 0.05\n[[axis]]\nindex = 0\ntype = "linear"\n'
    text += f"max_velocity = 100\nmax_acceleration = 5000\n{EI}\n"
    with pytest.raises(MachineFileRejected, match=r"0.05 mm leave nothing for corners: .* by up to 0.\d+ mm"):
        parse_machine(text)
    with pytest.raises(MachineFileRejected, match="makes the profiles itself"):
        parse_machine(text + '[axis.drive]\nkind = "cia402"\nbus = "can0"\nnode = 3\nmode = "pp"\n')


def test_a_tolerance_below_what_shapers_take_is_refused_with_the_numbers() -> None:
    found = simulate("G64 P0.01\nM02", shaped(EI), record=False)
    (fault,) = found.report["diagnostics"]
    assert fault["code"] == "MC116"
    assert "by up to" in fault["message"]
