"""Axes that follow others by a gear or a cam: in step, within their limits, and what ends it (D-130)."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.executor.entries import ControlKind, EventKind
from mcserver.executor.envelope_bounds import Envelope
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.leading_curves import Cam
from mcserver.executor.shm.feedback import SlotState
from mcserver.gcode.program_check import check_program
from mcserver.machine.follow_section import cam_points
from mcserver.machine.machine_file import builtin_text, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.machine.plausibility import find_doubts
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.motion.canonical import AxisOperation
from mcserver.simulation.simulation import simulate
from mcserver.units import DEGREE, MM
from tests.executor.coupled import LAW, Coupled, abort, hold, pushed, pushes, under_orders
from tests.executor.rig import Rig
from tests.machine_text import axes_text

# X leads; Y is free; [3] is geared to X, [4] has a cam over it, [6] follows the belt [5]
BED = axes_text((0, 1), keys="max_jerk = 40000.0\nmin_position = -400.0\nmax_position = 400.0")
GEAR = "follow = { leader = 0, ratio = 10.0, tolerance = 0.05 }"
CAM = """[axis.follow]
leader = 0
tolerance = 0.01
repeats = true
cam = [[0.0, 0.0], [50.0, 20.0], [70.0, 20.0], [120.0, 0.0]]
"""
LINE = "follow = { leader = 5, ratio = 1.0, tolerance = 0.5, source = 'encoder' }"
TURNED = "max_jerk = 1000000.0\nmax_following_error = 1e6\nunits_per_motor_rev = 360.0\n"
MOVES = "G1010\nG1060 P3\nG1060 P4\nG90 G94\n{}\nG1061\nM2"
WAY = "G1 X100 F9000\nX200 Y50\nG2 X300 Y50 I50 J0\nG0 X-100\nG1020 X50\nG04 P0.2\nG1 X-40 Y0 F6000"


def text(gear: str = GEAR, cam: str = CAM, line: str = LINE, travel: float = 100.0, belt: str = "") -> str:
    rotary = axes_text((3,), rotary=True, velocity=4000.0, acceleration=40000.0, keys=TURNED + gear)
    # [axis.follow] is the last table of its axis
    slide = (
        axes_text((4,), keys=f"max_jerk = 80000.0\nmin_position = -{travel}\nmax_position = {travel}") + cam
    )
    more = axes_text(
        (5,),
        velocity=100.0,
        acceleration=1000.0,
        drive="simulated",
        drive_keys="encoder_resolution = 0.005\n" + belt,
        keys="max_following_error = 1e6",
    )
    tied = axes_text((6,), velocity=300.0, acceleration=3000.0, keys=f"max_jerk = 100000.0\n{line}")
    return f'[machine]\nname = "geared"\n{BED}{rotary}{slide}{more}{tied}'


MACHINE = parse_machine(text())


def test_followers_are_in_step_through_lines_arcs_rapids_and_overrides() -> None:
    cell = Coupled(MACHINE, MOVES.format(WAY))
    cell.play(
        {
            700: lambda each: each.executor.mailbox.set_override(0.3, 0),
            1500: lambda each: each.executor.mailbox.set_override(1.0, 0),
        }
    )
    assert cell.faults == []
    assert np.ptp(cell.setpoints(0)) > 0.39
    assert cell.beside(3).max() < 1e-3 * DEGREE
    assert cell.beside(4).max() < 1e-4 * MM
    assert cell.broken() == []


@pytest.mark.parametrize(
    ("cycle_hz", "jerk", "doubted"),
    [(1000.0, 20_000.0, False), (100.0, 20_000.0, True), (100.0, 4000.0, True), (100.0, None, True)],
)
def test_a_gear_whose_tolerance_the_cycle_is_too_long_for_is_warned_of(
    cycle_hz: float, jerk: float | None, doubted: bool
) -> None:
    own, its = ("", "") if jerk is None else (f"max_jerk = {1.3 * jerk}\n", f"max_jerk = {jerk}")
    axes = axes_text((0,), velocity=80.0, acceleration=800.0, keys=its) + axes_text(
        (1,),
        velocity=104.0,
        acceleration=1040.0,
        keys=f"{own}follow = {{ leader = 0, ratio = 1.0, tolerance = 0.002 }}",
    )
    machine = parse_machine(f'[machine]\nname = "slow"\ncycle_hz = {cycle_hz}\n{axes}')
    doubts = [each for each in find_doubts(machine) if each.code == "MC094"]
    assert ["at 100 Hz it may be" in each.message for each in doubts] == [True] * doubted
    way = "".join(f"G1 X{place}\n" for place in (100, 0, 3, 0, 40, 20, 21, 0))
    cell = Coupled(machine, f"G1010\nG90 G94\nG1060 P1\nF4800\n{way}G1061\nM2").play()
    assert (FaultCode.OUT_OF_STEP in cell.faults) is doubted


@pytest.mark.parametrize(("spare", "beside"), [(1.3, 1e-4 * MM), (1.0, 2.0 * MM)])
def test_how_far_a_follower_is_beside_its_leader_follows_from_what_its_limits_spare(
    spare: float, beside: float
) -> None:
    jerk = 50_000.0
    axes = axes_text((0, 1), keys=f"max_jerk = {jerk}") + axes_text(
        (3,),
        velocity=spare * 200.0,
        acceleration=spare * 2000.0,
        keys=f"max_jerk = {spare * jerk}\nfollow = {{ leader = 0, ratio = 1.0, tolerance = 5.0 }}",
    )
    machine = parse_machine(f'[machine]\nname = "twins"\n{axes}')
    assert [each.code for each in find_doubts(machine)] == (["MC094"] if spare == 1.0 else [])
    way = "G1 X100 F9000\nG2 X150 Y50 I50 J0\nG0 X20\nG1 X30 F3000\nX10"
    cell = Coupled(machine, f"G1010\nG90 G94\nG1060 P3\n{way}\nM2").play()
    assert cell.faults == []
    assert cell.beside(3).max() < beside
    assert cell.broken() == []


@under_orders(2500, ends_from=100)
def test_whatever_is_ordered_limits_are_kept_and_a_stop_leaves_both_at_rest(
    orders: dict[int, Callable[[Coupled], None]], at: int, end: Callable[[Coupled], None]
) -> None:
    cell = Coupled(MACHINE, MOVES.format(WAY))
    cell.play({**orders, at: end})
    assert cell.broken(jerk=end is abort) == []
    if end is abort:
        # the leader comes to rest on its path, and what follows it in step
        assert cell.beside(3).max() < 1e-3 * DEGREE
        assert cell.faults == []
    assert not cell.executor.executor.motions.mask
    assert cell.executor.executor._cycle.couplings.engaged == ()


def test_an_axis_follows_an_encoder_that_moves_from_step_in_to_uncoupled_without_a_jump() -> None:
    program = "G1010 P5 G1010 P6\nG1030 [5]300\nG04 P0.5\nG1060 P6\nG04 P1\nG1030 [5]120\nG04 P1\nG1061\nM2"
    cell = Coupled(MACHINE, program).play()
    assert cell.faults == []
    assert cell.broken() == []
    belt = np.array(cell.actuals)[:, cell.machine.column_of(5)]
    speeds = np.gradient(cell.setpoints(6)) / 1e-3
    # 300 and 120 turns of 10 mm a minute
    assert speeds[1450] == pytest.approx(0.05, rel=0.02)
    assert speeds[2350] == pytest.approx(0.02, rel=0.02)
    # it takes the place that it had as it was coupled, with what the belt has gone since
    beside = cell.setpoints(6) - belt
    for along in (slice(1000, 1450), slice(2000, 2450)):
        # a step of the encoder is 5 µm
        assert np.ptp(beside[along]) < 6e-3 * MM
    assert beside[1400] == pytest.approx(beside[2400], abs=0.04 * MM)
    # and comes to rest by itself while the belt goes on
    assert np.diff(cell.setpoints(6))[-1] == 0.0


@LAW
@given(pushed(range(300, 2500)))
def test_whatever_the_encoder_does_the_follower_keeps_its_limits(
    what: dict[int, tuple[str, float]],
) -> None:
    program = "G1010 P5 G1010 P6\nG1030 [5]300\nG1060 P6\nG04 P2.4\nM2"
    cell = Coupled(MACHINE, program).play(pushes(what, 5))
    assert cell.broken() == []
    assert set(cell.faults) <= {FaultCode.OUT_OF_STEP}


def test_a_leader_that_cannot_be_followed_stops_in_its_limits_before_more_is_lost() -> None:
    # ten times what the rotary axis can
    cell = Coupled(parse_machine(text(gear=GEAR.replace("10.0", "100.0"))), MOVES.format("G1 X300 F12000"))
    cell.play()
    assert cell.faults == [FaultCode.OUT_OF_STEP]
    assert cell.broken() == []
    assert cell.setpoints(0)[-1] < 0.05


def test_a_follower_never_leaves_its_travel() -> None:
    cell = Coupled(parse_machine(text(travel=15.0)), MOVES.format("G1 X100 F9000")).play()
    assert cell.faults == [FaultCode.OUT_OF_STEP]
    assert cell.setpoints(4).max() <= 15.0 * MM + 1e-9
    assert cell.broken() == []


@pytest.mark.parametrize("axis", [0, 3])
def test_a_fault_of_leader_or_follower_ends_the_program_and_the_other_stops_in_its_limits(axis: int) -> None:
    made = parse_machine(text().replace('"ideal"', '"simulated"'))
    cell = Coupled(made, MOVES.format("G1 X300 F9000"))
    cell.play({900: lambda each: each.bus.trip(each.column(axis))})
    assert cell.faults == [FaultCode.OVER_TEMPERATURE]
    assert cell.broken(but=(5, axis)) == []
    assert cell.executor.executor._cycle.couplings.engaged == ()


def test_a_leader_whose_encoder_falls_silent_is_lost() -> None:
    program = "G1010 P6\nG1060 P6\nG04 P2\nM2"
    cell = Coupled(MACHINE, program)
    cell.bus.push(cell.column(5), 0.03)
    cell.play({500: lambda each: each.bus.silence(each.column(5))})
    assert cell.faults == [FaultCode.LEADER_LOST]
    assert cell.broken() == []


def test_a_cam_is_coupled_only_where_it_has_its_axis() -> None:
    cell = Coupled(MACHINE, "G1010\nG0 [4]5\nG1060 P4\nG1 X50 F3000\nM2").play()
    assert cell.faults == [FaultCode.BESIDE_CAM]
    assert cell.setpoints(0).max() == 0.0
    cell = Coupled(MACHINE, "G1010\nG0 X60 [4]20\nG1060 P4\nG1 X0 F3000\nG1061\nG91\nG0 [4]5\nM2").play()
    assert cell.faults == []
    # increments begin where it has been led to
    assert cell.setpoints(4)[-1] == pytest.approx(5.0 * MM)


def test_an_axis_command_ends_it_also_while_it_moves() -> None:
    cell = Coupled(MACHINE, "G1010\nG1030 [5]300\nG1060 P6\nG04 P0.3\nG1001\nM2").play()
    assert cell.faults == []
    assert cell.broken() == []
    assert cell.executor.executor.bank.energized == 0


def test_a_pause_lends_neither_of_the_two() -> None:
    cell = Coupled(MACHINE, "G1010\nG1060 P3\nG1 X20 F3000\nM0\nM2")
    for _ in range(3000):
        cell.step()
        if cell.of(EventKind.PAUSED):
            break
    (paused,) = cell.of(EventKind.PAUSED)
    columns = [cell.machine.column_of(axis) for axis in (0, 3)]
    assert [paused.token >> column & 1 for column in columns] == [0, 0]
    assert paused.token >> cell.machine.column_of(1) & 1


def test_a_reference_of_the_leader_moves_nothing() -> None:
    rig = Rig(MACHINE)
    program, leader, follower = rig.program, 0, MACHINE.column_of(3)
    program.capture()
    program.axis(AxisOperation.COUPLE, 1 << follower)
    program.control(ControlKind.REFERENCE, axes=1 << leader, values=program._values({leader: 0.05}))
    program.rapid({leader: 0.07})
    program.wait(1 << leader)
    rig.play()
    assert not rig.of(EventKind.FAULT)
    assert rig.setpoint[-1, follower] == pytest.approx(200.0 * DEGREE)
    assert np.abs(np.diff(rig.setpoint[:, follower])).max() < 4.0 * DEGREE


def test_nothing_else_moves_a_follower() -> None:
    rig = Rig(MACHINE)
    follower = MACHINE.column_of(3)
    rig.program.capture()
    rig.program.axis(AxisOperation.COUPLE, 1 << follower)
    rig.program.rapid({follower: 1.0})
    rig.play()
    assert [each.code for each in rig.of(EventKind.FAULT)] == [FaultCode.COUPLED]
    assert rig.setpoint[:, follower].max() == 0.0


def test_a_stalled_cycle_ends_it_where_the_axes_stand() -> None:
    cell = Coupled(MACHINE, MOVES.format("G1 X300 F9000"))
    cell.play({900: lambda each: each.executor.miss(100)})
    assert cell.faults[0] == FaultCode.CYCLE_STALLED
    assert cell.setpoints(3)[-1] == cell.setpoints(3)[899] != 0.0


def test_a_hold_holds_both() -> None:
    cell = Coupled(MACHINE, MOVES.format("G1 X300 F9000"))
    cell.step(800)
    hold(cell)
    cell.step(1000)
    assert cell.executor.feedback.slots[0].state == SlotState.HELD
    assert cell.beside(3).max() < 1e-3 * DEGREE


@given(
    st.lists(st.tuples(st.floats(0.1, 5.0), st.floats(-10.0, 10.0)), min_size=2, max_size=8), st.booleans()
)
def test_a_cam_passes_its_points_never_leaves_their_span_and_has_no_step_of_acceleration(
    points: list[tuple[float, float]], repeats: bool
) -> None:
    places = np.cumsum([width for width, _ in points]).tolist()
    table = cam_points(
        [list(each) for each in zip(places, [v for _, v in points], strict=True)], repeats=repeats
    )
    cam = Cam(table, repeats=repeats)
    for (start, low, slope), (end, high, _) in pairwise(table):
        assert cam.at(start) == pytest.approx((low, slope, 0.0), abs=1e-9)
        values = [cam.at(each)[0] for each in np.linspace(start, end, 17)[:-1].tolist()]
        assert min(low, high) - 1e-9 <= min(values)
        assert max(values) <= max(low, high) + 1e-9
    # and its derivatives are what it says
    at, by = 0.5 * (places[0] + places[1]), 1e-5
    before, here, after = (cam.at(at + each)[0] for each in (-by, 0.0, by))
    _, slope, curvature = cam.at(at)
    assert (after - before) / (2.0 * by) == pytest.approx(slope, abs=1e-4, rel=1e-4)
    assert (after - 2.0 * here + before) / by**2 == pytest.approx(curvature, abs=1e-2 + 1e-3 * abs(curvature))


@pytest.mark.parametrize(
    ("gear", "cam"),
    [
        (GEAR.replace("leader = 0", "leader = 9"), CAM),
        (GEAR.replace("leader = 0", "leader = 4"), CAM),
        (GEAR.replace("ratio = 10.0, ", ""), CAM),
        (GEAR.replace("ratio = 10.0", "ratio = 10.0, repeats = true"), CAM),
        (GEAR.replace("ratio = 10.0", "ratio = 0.0"), CAM),
        (GEAR, CAM.replace("[50.0, 20.0]", "[150.0, 20.0]")),
        (GEAR, CAM.replace("[50.0, 20.0]", "[0.0001, 20.0]")),
        (GEAR, CAM.replace("[0.0, 0.0]", "[0.0, 0.0, 1.0]").replace("0.0]]", "0.0, 2.0]]")),
        (GEAR, CAM.replace("true", "false").replace("[0.0, 0.0]", "[0.0, 0.0, 1.0]")),
        (GEAR.replace("}", "}\ngantry = { leader = 0, max_skew = 1.0 }"), CAM),
        (GEAR.replace("}", "}\nshaper = { type = 'zv', frequency_hz = 20.0 }"), CAM),
        (GEAR.replace("}", "}\ntool_shapers.2 = { type = 'zv', frequency_hz = 20.0 }"), CAM),
    ],
)
def test_what_cannot_follow_is_refused(gear: str, cam: str) -> None:
    with pytest.raises(MachineFileRejected) as caught:
        parse_machine(text(gear, cam))
    assert "MC094" in [each.code for each in caught.value.diagnostics]


@pytest.mark.parametrize(
    "cam", ["[[-1e308, 0.0], [1e308, 5.0]]", "[[0.0, 0.0], [9.0, 1.0, 1e300], [20.0, 0.0]]"]
)
def test_numbers_whose_squares_are_none_are_refused(cam: str) -> None:
    with pytest.raises(MachineFileRejected, match="does not fit: expected float"):
        parse_machine(text(GEAR, f"[axis.follow]\nleader = 0\ntolerance = 0.1\ncam = {cam}\n"))


@pytest.mark.parametrize(
    ("speed", "high", "bound"),
    [(1.0, 0.02, FaultCode.ENVELOPE_POSITION), (0.04, 1.0, FaultCode.ENVELOPE_SPEED)],
    ids=["travel", "speed"],
)
def test_an_approved_run_holds_a_follower_within_its_envelope_whatever_leads_it_and_names_the_approval(
    speed: float, high: float, bound: FaultCode
) -> None:
    wide, count = 10.0, len(MACHINE.axes)
    column = MACHINE.column_of(6)
    highs, speeds = [wide] * count, [100.0] * count
    highs[column], speeds[column] = high, speed
    turning = 1 << MACHINE.column_of(5)
    envelope = Envelope((-wide,) * count, tuple(highs), tuple(speeds), 60.0, turning)
    # a belt at 50 mm/s
    program = "G1010 P5 G1010 P6\nG1030 [5]300\nG04 P0.5\nG1060 P6\nG04 P1\nG1061\nM2"
    cell = Coupled(MACHINE, program, envelope=envelope).play()
    assert cell.faults == [bound]
    assert cell.broken() == []
    assert cell.setpoints(6).max() <= high + 1e-9
    assert np.abs(np.diff(cell.setpoints(6))).max() <= speed * 1e-3 + 1e-9


def test_an_approved_run_whose_follower_cannot_keep_up_by_its_own_limits_does_not_name_the_approval() -> None:
    machine = parse_machine(text(gear=GEAR.replace("10.0", "100.0")))
    count = len(machine.axes)
    envelope = Envelope((-10.0,) * count, (10.0,) * count, (100.0,) * count, 60.0, 0)
    cell = Coupled(machine, MOVES.format("G1 X300 F12000"), envelope=envelope).play()
    assert cell.faults == [FaultCode.OUT_OF_STEP]


def test_the_pairs_of_the_page_work_as_written() -> None:
    page = (Path(__file__).parents[2] / "docs" / "couplings.md").read_text("utf-8")
    described, belt, arm = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    program, pick, draw = re.findall(r"```gcode\n(.*?)```", page, re.DOTALL)
    machine, picker = parse_machine(described), parse_machine(belt)
    assert find_doubts(machine) == find_doubts(picker) == []
    assert check_program(f"G1010\n{pick}M2", picker) == []
    given = f'{axes_text((9,))}[[input]]\nnumber = 4\nname = "eye"\n'
    robot = parse_machine(builtin_text("arm6").replace("[[axis]]", f"{arm}\n[[axis]]", 1) + given)
    assert check_program(f"G1010\n{draw}M2", robot, kinematics=build_kinematics(robot)) == []
    report = simulate(program, machine).report
    assert (report["ok"], report["diagnostics"]) == (True, [])
    assert report["axes"]["3"]["max"] == pytest.approx(36.0 * 400.0, abs=0.01)
