"""Poses and twists of a tool in servo mode: arms on a virtual clock, judged by setpoints of each cycle."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mckinematics.rotation import euler_to_matrix, matrix_to_euler, rotation_matrices, rotation_vectors
from mckinematics.solver import MachineKinematics
from numpy.typing import NDArray

from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.motion.canonical import AxisOperation
from mcserver.service.reports import ServoStatus
from mcserver.service.target_stream import Now, TargetMessage, TargetStream
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.kinematics import arm7
from tests.kinematics.tool_machines import Joint, Z, chain_machine
from tests.limits import assert_keeps, limits_of

Array = NDArray[np.float64]
CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)
PERIOD = 10
LIFT = np.array([0.0, 0.0, 0.02])
Given = Callable[[float], dict[str, object]]


class Arm:
    """A machine whose axes follow; messages come every 10 cycles."""

    def __init__(self, machine: Machine | None = None) -> None:
        self.machine = machine or load_machine("arm6")
        self.kinematics = MachineKinematics(self.machine)
        self.executor = VirtualExecutor(self.machine)
        ring = self.executor.open_slot(0)
        everything = (1 << len(self.machine.axes)) - 1
        for kind in (ControlKind.AXIS, ControlKind.FOLLOW, ControlKind.FINISH):
            ring.put_control(Control(kind, 0.0, 0, axes=everything, operation=CAPTURE))
        self.executor.step(100)
        self.stream = TargetStream(self.machine.axes, self.machine.cycle_s, self.kinematics)
        self.setpoints: list[Array] = [self.executor.executor.row.setpoint.copy()]
        self.seq = 0

    @property
    def status(self) -> ServoStatus:
        return self.stream.status

    def give(self, *, tool: int | None = 1, rate: float = 1.0, counts_s: float = 0.1, **rows: object) -> None:
        now = self.executor.executor.time
        self.seq += 1
        given = {
            name: np.atleast_2d(np.array(value))
            for name, value in rows.items()
            if name in ("positions", "velocities")
        }
        message = TargetMessage(
            self.seq,
            now,
            counts_s,
            given.get("positions"),
            given.get("velocities"),
            rows.get("times"),  # type: ignore[arg-type]
            tool,
            bool(rows.get("in_tool", False)),
        )
        curve = self.stream.take(message, Now(now, self.setpoints[-1].copy(), rate))
        if curve is not None:
            self.executor.sink(0).targets.put(curve)

    def step(self, cycles: int) -> None:
        for _ in range(cycles):
            self.executor.step()
            self.setpoints.append(self.executor.executor.row.setpoint.copy())

    def follow(self, given: Given, seconds: float) -> None:
        for number in range(round(seconds * 1000) // PERIOD):
            self.give(**given(number * PERIOD * 1e-3))  # type: ignore[arg-type]
            self.step(PERIOD)

    def pose(self, joints: Array | None = None) -> Array:
        row = self.setpoints[-1] if joints is None else joints
        pose = self.kinematics.pose(1, dict(enumerate(row)))
        return np.array([*pose.position, *pose.angles])

    def path(self) -> Array:
        """Of the tool, shape (n, 3)."""
        return self.kinematics.tool(1).chain.forward(np.array(self.setpoints))[0]

    def turned(self, pose: Array) -> float:
        """By which angle the tool's orientation is off a pose's [rad]."""
        wanted = euler_to_matrix(tuple(pose[3:]), "ZYX")
        now = euler_to_matrix(tuple(self.pose()[3:]), "ZYX")
        return float(np.linalg.norm(rotation_vectors((wanted @ now.T)[None])))

    def assert_limits(self) -> None:
        assert_keeps(self.setpoints, limits_of(self.machine), most=(1.0 + 1e-5,) * 3)


def circle(arm: Arm, radius: float, hz: float, *, turned: float = 0.0) -> Given:
    """Poses on a circle in the plane Y Z through where the tool is, at rest at first."""
    start, turn = arm.pose(), 2.0 * math.pi * hz

    def at(t: float) -> dict[str, object]:
        # an even start: the angle grows quadratically at first
        angle = 0.5 * turn * t * t if t < 1.0 else turn * (t - 0.5)
        offset = [
            0.0,
            radius * math.sin(angle),
            radius * (1.0 - math.cos(angle)),
            turned * math.sin(angle),
            0.0,
            0.0,
        ]
        return {"positions": start + np.array(offset)}

    return at


def test_a_circle_is_followed_and_ends_where_it_began() -> None:
    arm = Arm()
    start = arm.pose()
    asked = circle(arm, 0.1, 0.5, turned=0.3)
    arm.follow(asked, 2.5)
    path = arm.path()
    off = np.hypot(path[:, 1] - start[1], path[:, 2] - start[2] - 0.1) - 0.1
    assert np.abs(off).max() < 1e-4
    assert np.abs(path[:, 0] - start[0]).max() < 1e-4
    last = asked(2.5)["positions"]
    arm.follow(lambda _: {"positions": last}, 0.3)
    assert arm.pose()[:3] == pytest.approx(np.array(last)[:3], abs=1e-8)  # type: ignore[index]
    assert arm.turned(np.array(last)) < 1e-8
    assert (arm.status.taken, arm.status.slowed) == (280, 0)
    arm.assert_limits()


def test_a_pose_may_be_passed_at_a_twist() -> None:
    arm = Arm()
    start, speed = arm.pose(), np.array([0.0, 0.2, 0.0, 0.0, 0.0, 0.5])
    arm.follow(lambda t: {"positions": start + speed * t, "velocities": speed}, 0.8)
    moved = np.diff(arm.path()[-5:], axis=0) * 1e3
    assert moved == pytest.approx(np.tile(speed[:3], (4, 1)), abs=1e-3)


@pytest.mark.parametrize("in_tool", [False, True])
def test_a_twist_moves_straight_on_until_it_does_not_count(in_tool: bool) -> None:
    arm = Arm()
    start = arm.pose()
    arm.follow(lambda _: {"velocities": [0.0, 0.1, -0.1, 0.0, 0.0, 0.0], "in_tool": in_tool}, 1.0)
    # at A0 B0 C0 the tool's axes are the base's; while the axes gain speed each has a jerk of its own
    assert arm.path()[-1] - start[:3] == pytest.approx([0.0, 0.0976, -0.0977], abs=2e-3)
    assert arm.turned(start) < 5e-3
    way = arm.path()[200:] - arm.path()[200]
    along = way[-1] / np.linalg.norm(way[-1])
    assert np.linalg.norm(way - np.outer(way @ along, along), axis=1).max() < 1e-5
    arm.step(400)
    assert np.ptp(arm.setpoints[-5:], axis=0).max() == 0.0
    arm.assert_limits()


def test_a_twist_in_the_tool_s_frame_is_turned_with_it() -> None:
    arm = Arm()
    start = arm.pose()
    turned = start + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.5 * math.pi])
    arm.follow(lambda _: {"positions": turned}, 1.0)
    arm.follow(lambda _: {"velocities": [0.1, 0.0, 0.0, 0.0, 0.0, 0.0], "in_tool": True}, 0.5)
    way = arm.pose()[:3] - start[:3]
    assert np.abs(way) == pytest.approx([0.0, 0.045, 0.0], abs=0.01)


def test_a_twist_out_of_reach_is_slowed_to_a_stop_and_one_back_leads_back() -> None:
    arm = Arm()
    arm.follow(lambda _: {"velocities": [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]}, 3.0)
    out = arm.path()
    assert arm.status.slowed > 100
    assert np.abs(out - out[0])[:, 1:].max() < 2e-3
    arm.follow(lambda _: {"velocities": [-0.5, 0.0, 0.0, 0.0, 0.0, 0.0]}, 3.0)
    assert arm.pose()[0] < out[-1, 0] - 0.3
    arm.assert_limits()


def test_a_twist_to_the_end_of_travel_slows_all_axes_together() -> None:
    arm = Arm()
    start = arm.pose()
    arm.follow(lambda _: {"velocities": [0.0, 0.0, 0.0, 0.0, 0.0, 3.0]}, 4.0)
    high = arm.machine.axes[5].max_position
    assert np.abs(np.array(arm.setpoints)[:, 5]).max() <= high + 1e-12
    assert np.abs(arm.pose()[:3] - start[:3]).max() < 2e-3
    assert arm.status.slowed > 10


def test_poses_out_of_reach_are_refused_and_nothing_moves_towards_them() -> None:
    arm = Arm()
    start = arm.pose()
    arm.follow(lambda _: {"positions": start}, 0.05)
    far = start + np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    arm.follow(lambda _: {"positions": far}, 0.3)
    assert arm.pose() == pytest.approx(start, abs=1e-9)
    assert arm.status.jumped + arm.status.refused == 30


def test_a_pose_that_jumps_is_dropped_until_the_next_one_confirms_it() -> None:
    arm = Arm()
    start = arm.pose()
    arm.follow(lambda _: {"positions": start}, 0.05)
    flipped = start + np.array([0.0, 0.0, 0.0, 0.0, 0.0, math.pi])
    arm.give(positions=flipped)
    arm.give(positions=start)
    assert arm.status.jumped == 1
    over = start + np.array([0.0, 0.4, 0.0, 0.0, 0.0, 0.0])
    arm.follow(lambda _: {"positions": over}, 1.5)
    assert (arm.status.jumped, arm.status.refused) == (2, 0)
    assert arm.status.slowed > 10
    assert arm.pose()[:3] == pytest.approx(over[:3], abs=1e-8)
    arm.assert_limits()


@pytest.mark.parametrize("radius", [0.03, 0.001])
def test_a_stream_round_the_wrist_s_singularity_keeps_limits_and_branch(radius: float) -> None:
    # axis 4 at 0 aligns axes 3 and 5; the tool turns round that orientation
    arm = Arm()
    aligned = arm.setpoints[-1].copy()
    aligned[2], aligned[4] = 0.5, 0.1
    arm.follow(lambda _: {"tool": None, "positions": aligned}, 1.5)
    # the wrist's own orientation at axis 4 = 0
    straight = aligned.copy()
    straight[4] = 0.0
    middle = arm.pose(straight)
    base = euler_to_matrix(tuple(middle[3:]), "ZYX")

    def round_it(t: float) -> dict[str, object]:
        angle = 3.0 * t
        tilt = rotation_matrices(radius * np.array([[math.cos(angle), math.sin(angle), 0.0]]))[0]
        return {"positions": [*middle[:3], *matrix_to_euler(base @ tilt, "ZYX")], "counts_s": 1.0}

    arm.follow(round_it, 2.2)
    arm.assert_limits()
    assert arm.status.taken > 200
    assert np.abs(arm.pose()[:3] - middle[:3]).max() < 0.02


@pytest.mark.parametrize(("beside", "turned"), [(0.0, 0.0), (0.003, math.pi)])
def test_poses_pass_through_the_wrist_s_singularity_straight_and_beside_it_the_wrist_turns(
    beside: float, turned: float
) -> None:
    arm = Arm()
    bent = arm.setpoints[-1].copy()
    bent[2], bent[4] = 0.5, 0.1
    arm.follow(lambda _: {"tool": None, "positions": bent}, 0.8)
    straight = bent.copy()
    straight[4] = 0.0
    middle = arm.pose(straight)
    base = euler_to_matrix(tuple(middle[3:]), "ZYX")
    towards = rotation_vectors((base.T @ euler_to_matrix(tuple(arm.pose(bent)[3:]), "ZYX"))[None])[0]
    aside = np.cross(towards, [0.0, 0.0, 1.0])
    aside *= beside / np.linalg.norm(aside)

    def through(t: float) -> dict[str, object]:
        turn = rotation_matrices(((1.0 - min(2.0 * t, 2.0)) * towards + aside)[None])[0]
        return {"positions": [*middle[:3], *matrix_to_euler(base @ turn, "ZYX")], "counts_s": 1.0}

    arm.follow(through, 2.0)
    assert abs(arm.setpoints[-1][3]) == pytest.approx(turned, abs=0.1)
    assert arm.turned(np.array(through(2.0)["positions"])) < 1e-8
    assert arm.status.refused < 10
    arm.assert_limits()


def test_what_is_no_pose_of_the_program_s_tools_is_refused() -> None:
    arm = Arm()
    start = arm.pose()
    for bad in (
        {"tool": 7, "positions": start},
        {"positions": start[:3]},
        {"positions": np.full(6, math.nan)},
        {"positions": np.full(6, 1e300)},
        {"velocities": np.full(6, math.inf)},
        {"velocities": np.full(6, 1e9)},
        {"positions": [start, start]},
    ):
        arm.give(**bad)  # type: ignore[arg-type]
    assert (arm.status.taken, arm.status.refused) == (0, 7)
    without = TargetStream(arm.machine.axes[:3], 1e-3, arm.kinematics)
    message = TargetMessage(1, 0.0, 0.1, start[None], None, None, 1)
    assert without.take(message, Now(0.0, np.zeros(3))) is None
    assert without.status.refused == 1


def test_a_chain_of_two_joints_is_led_in_its_plane_alone(tmp_path: Path) -> None:
    joints = [Joint("revolute", "0 0 0", Z), Joint("revolute", "0.3 0 0", Z)]
    arm = Arm(chain_machine(tmp_path, joints, start={0: 20.0, 1: 60.0}))
    start = arm.pose()[:3]
    arm.follow(lambda _: {"positions": start + LIFT}, 0.05)
    assert (arm.status.taken, np.ptp(arm.setpoints, axis=0).max()) == (0, 0.0)
    arm.follow(lambda _: {"velocities": 5.0 * LIFT}, 0.05)
    assert np.ptp(arm.setpoints, axis=0).max() == 0.0
    arm.follow(lambda _: {"positions": start - LIFT[[2, 1, 0]]}, 0.5)
    assert arm.pose()[:3] == pytest.approx(start - LIFT[[2, 1, 0]], abs=1e-8)


def test_a_chunk_of_poses_is_stretched_where_the_axes_are_too_slow() -> None:
    arm = Arm()
    arm.executor.mailbox.set_override(0.1, 0)
    start = arm.pose()
    share = np.arange(1, 41) / 40.0
    rows = start + (share**2 * (3.0 - 2.0 * share))[:, None] * np.array([0.0, 0.3, 0.0, 0.0, 0.0, 0.0])
    arm.give(positions=rows, times=share, rate=0.1)
    assert (arm.status.taken, arm.status.slowed) == (1, 1)
    arm.step(4000)
    assert arm.pose()[:3] == pytest.approx(rows[-1, :3], abs=1e-8)
    assert np.abs(arm.path() - start[:3])[:, [0, 2]].max() < 1e-3
    arm.assert_limits()


def test_under_an_override_a_twist_keeps_its_direction() -> None:
    arm = Arm()
    arm.executor.mailbox.set_override(0.02, 0)
    start = arm.pose()
    arm.follow(lambda _: {"velocities": [0.0, 0.3, 0.3, 0.0, 0.0, 0.0], "rate": 0.02}, 2.0)
    way = arm.pose()[:3] - start[:3]
    assert way[1] > 0.005
    assert way == pytest.approx([0.0, way[1], way[1]], abs=5e-4)


def test_legs_of_other_tools_stay_where_they_were_led_to() -> None:
    dog = Arm(load_machine("robot-dog"))
    number = dog.kinematics.tools[0]
    here = dog.setpoints[-1].copy()
    other = dog.kinematics.tools[1]
    feet = {tool: dog.kinematics.pose(tool, dict(enumerate(here))).position for tool in (number, other)}
    lifted = {tool: np.array(foot) + LIFT for tool, foot in feet.items()}
    dog.follow(lambda _: {"tool": number, "positions": lifted[number]}, 1.0)
    dog.follow(lambda _: {"tool": other, "positions": lifted[other]}, 1.0)
    joints = dict(enumerate(dog.setpoints[-1]))
    for tool, foot in lifted.items():
        assert dog.kinematics.pose(tool, joints).position == pytest.approx(foot, abs=1e-8)
    dog.follow(lambda _: {"tool": number, "velocities": [0.0, 0.0, -0.02]}, 0.5)
    joints = dict(enumerate(dog.setpoints[-1]))
    assert dog.kinematics.pose(other, joints).position == pytest.approx(lifted[other], abs=1e-8)


def test_joints_to_spare_go_to_the_tool_s_posture_as_the_tool_travels(tmp_path: Path) -> None:
    posture = [0.0, 30.0, 60.0, 70.0, 0.0, 40.0, 0.0]
    left = []
    for keys in ("", f"posture = {posture}"):
        arm = Arm(arm7.machine(tmp_path, tools=[keys]))
        arm.follow(circle(arm, 0.03, 1.0), 2.0)
        arm.assert_limits()
        left.append(float(np.linalg.norm(np.degrees(arm.setpoints[-1]) - posture)))
    assert left[1] < left[0] - 0.2
