"""Hostile streams of targets: ``make laws ARGS="--servo --first 0 --count 1000"``.

Each seed is a machine of 2, 6 or 64 axes with limits of its own, or an arm with a tool, and a client that
streams whatever there is: positions, velocities, chunks, the tool's poses and twists; jumps, NaN, infinities,
numbers beyond all bounds; messages lost, doubled, out of order and in bursts, clocks that stand and jump,
garbage straight in the executor's box; silences after which servo mode is opened again; holds, overrides,
aborts and missed cycles. Judged from outside, on the setpoints of every cycle: velocity, acceleration, jerk
and travel of every axis, and the torques of an arm whose joints' are limited.
"""

from __future__ import annotations

import math
import random
import tempfile
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Control, ControlKind
from mcserver.executor.shm.target_box import POINTS, Targets
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.canonical import AxisOperation
from mcserver.motion.geometry.torque_limits import TorqueLimits
from mcserver.motion.limits.torque_in_box import followed_axis
from mcserver.service.servo import torque_share
from mcserver.service.target_stream import Now, TargetMessage, TargetStream
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.kinematics import arm7

Array = NDArray[np.float64]

CYCLES = 1000
# Rounding of positions over the cycle's length cubed, and of limits.
SLACK = 1.0 + 1e-5
WIDTHS = (2, 2, 2, 2, 2, 2, 6, 6, 6, 64)
CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)
# What is no place: in all of them a client's arithmetic has gone wrong.
WRONG = (math.nan, math.inf, -math.inf, 1e300, -1e300, 1e9, 5e-324)


# Every so many seeds an arm, led by its tool; and every so many of these one whose torques are limited.
ARMS, TORQUE_ARMS = 4, 3
# Of the joints [N·m]: little more than it takes to hold the arm, or plenty for slow motion; and what of them
# a motion may take.
TORQUES = ((25.0, 70.0, 25.0, 30.0, 7.0, 6.0, 0.6), (160.0, 160.0, 90.0, 90.0, 50.0, 40.0, 40.0))
TOLERATED = 1.02


def machine_of(chance: random.Random, seed: int) -> Machine:
    """Axes as slow as a crane or as quick as a wafer stage, some without limits; or an arm with a tool."""
    if seed % ARMS == ARMS - 1:
        arm = seed // ARMS
        return load_machine("arm6") if arm % TORQUE_ARMS else torque_arm(arm // TORQUE_ARMS % len(TORQUES))
    text = '[machine]\nname = "streamed"\n'
    kind = chance.choice(("ideal", "ideal", "ideal", "simulated"))
    for index in range(chance.choice(WIDTHS)):
        velocity = 10.0 ** chance.uniform(1.0, 3.5)
        acceleration = velocity * 10.0 ** chance.uniform(0.0, 1.7)
        text += f'[[axis]]\nindex = {index}\ntype = "{chance.choice(("linear", "rotary"))}"\n'
        text += f"max_velocity = {velocity}\nmax_acceleration = {acceleration}\n"
        if chance.random() < 0.9:
            text += f"max_jerk = {acceleration * 10.0 ** chance.uniform(0.3, 2.5)}\n"
        if chance.random() < 0.8:
            reach = velocity * 10.0 ** chance.uniform(-2.0, 0.5)
            text += f"min_position = {-reach}\nmax_position = {reach * chance.uniform(0.01, 1.0)}\n"
        text += f'[axis.drive]\nkind = "{kind}"\n'
    return parse_machine(text)


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory()


def torque_arm(which: int) -> Machine:
    """An arm of seven joints with the torques of a number."""
    return arm7.machine(Path(_folder().name), torques=TORQUES[which])


@cache
def torques_of(which: int) -> tuple[TorqueLimits, float]:
    """Return the limits of such an arm, and the share of its accelerations that the server leaves it."""
    machine = torque_arm(which)
    kinematics = build_kinematics(machine)
    limits = TorqueLimits.of(machine, None if kinematics is None else kinematics.dynamics)
    assert limits is not None
    at = np.array([axis.initial_position for axis in machine.axes])
    return limits, torque_share(machine, kinematics, range(len(at)), at)


def limited(machine: Machine) -> tuple[TorqueLimits, float] | None:
    """Return those of a machine; None: its torques are not limited."""
    torques = tuple(axis.max_torque for axis in machine.axes)
    return torques_of(TORQUES.index(torques)) if torques in TORQUES else None


class Client:
    """Streams to one program, badly.

    Attributes:
        sent: messages.
    """

    def __init__(self, chance: random.Random, machine: Machine) -> None:
        self._chance = chance
        self._machine = machine
        self._numbers = np.random.default_rng(chance.getrandbits(32))
        self._top = np.array([axis.max_velocity for axis in machine.axes])
        self._period = chance.choice((1, 2, 5, 10, 10, 33, 100))
        self._rough = chance.choice((0.0, 0.0, 0.05, 0.3))
        self._turn = chance.uniform(0.5, 30.0)
        self._reach = self._top * 10.0 ** chance.uniform(-3.0, 0.5)
        self._place = np.zeros(len(machine.axes))
        self._held: list[TargetMessage] = []
        self._clock = chance.uniform(-1e6, 1e6)
        self._silent = 0
        torques = limited(machine)
        self.share = 1.0 if torques is None else torques[1]
        kinematics = build_kinematics(machine)
        self._tools = 0.0 if kinematics is None else chance.choice((0.3, 0.9, 1.0))
        start = {axis.index: axis.initial_position for axis in machine.axes}
        self._pose = np.zeros(6)
        if kinematics is not None:
            pose = kinematics.pose(1, start)
            self._pose = np.array([*pose.position, *pose.angles])
        self._tip = 10.0 ** np.array([chance.uniform(-4.0, 0.3)] * 3 + [chance.uniform(-4.0, 0.8)] * 3)
        led = [followed_axis(axis, self.share) for axis in machine.axes]
        self.stream = TargetStream(led, machine.cycle_s, kinematics)
        self.seq = 0
        self.sent = 0

    def messages(self, cycle: int) -> list[TargetMessage]:
        """Return what comes in this cycle."""
        chance = self._chance
        if self._silent > 0:
            self._silent -= 1
            return []
        if cycle % self._period:
            return []
        message = self._message(cycle)
        if chance.random() >= self._rough:
            return [message]
        match chance.randrange(8):
            case 0:
                return []
            case 1:
                return [message] * chance.randint(2, 5)
            case 2:
                self._held.append(message)
                return []
            case 3:
                burst, self._held = [*self._held, message], []
                chance.shuffle(burst)
                return burst
            case 4:
                self._silent = chance.choice((5, 60, 300))
                return [message]
            case 5:
                self._clock += chance.choice((-1e3, -0.05, 0.05, 1e3, -cycle * 1e-3))
            case 6:
                self.seq += chance.choice((1, 10, -3, 2**40))
        return [message]

    def garbage(self, now: float) -> Targets:
        """Return what nobody has looked at."""
        count = self._chance.choice((1, 2, POINTS))
        knots = self._numbers.normal(
            0.0, 10.0 ** self._chance.uniform(-3, 6), (count, 1 + 2 * len(self._top))
        )
        knots[:, 0] = now + np.sort(knots[:, 0]) if self._chance.random() < 0.5 else knots[:, 0]
        self._spoil(knots)
        until = self._chance.choice((now + 0.1, now + 0.1, math.nan, math.inf, -1.0))
        return Targets(knots, now, until, by_velocity=self._chance.random() < 0.3)

    def _message(self, cycle: int) -> TargetMessage:
        chance, width = self._chance, len(self._top)
        self.seq += 1
        self.sent += 1
        t = cycle * self._machine.cycle_s
        times = None
        at = np.array([t])
        if chance.random() < 0.1:
            times = np.cumsum(self._numbers.uniform(1e-3, 0.03, chance.choice((2, 10, 100))))
            at = t + times
        if chance.random() < self._tools:
            return self._tool_message(t, at, times)
        angle = self._turn * at[:, None] + np.arange(width)
        positions: Array = self._place + self._reach * np.sin(angle)
        velocities: Array = self._turn * self._reach * np.cos(angle)
        if chance.random() < self._rough:
            self._place = self._reach * self._numbers.normal(0.0, 3.0, width)
        for rows in (positions, velocities):
            if chance.random() < 0.3 * self._rough:
                self._spoil(rows)
        kind = chance.randrange(5)
        return TargetMessage(
            self.seq,
            self._clock + t,
            chance.choice((0.02, 0.1, 0.1, 1.0)),
            None if kind == 0 else positions,
            None if kind in (1, 2) else velocities,
            times,
        )

    def _tool_message(self, t: float, at: Array, times: Array | None) -> TargetMessage:
        """Poses about where the tool began, on the way through singular positions and out of reach."""
        chance = self._chance
        turn = min(self._turn, 6.0)
        # from rest, and now and then from anywhere
        grown = np.minimum(at, 1.0)[:, None] if self._rough < 0.3 else 1.0
        angle = turn * at[:, None] + np.arange(6)
        poses: Array = self._pose + grown * self._tip * (np.sin(angle) - np.sin(np.arange(6)))
        twists: Array = turn * self._tip * np.cos(angle)
        if chance.random() < 0.2 * self._rough:
            self._pose = self._pose + self._numbers.choice([0.0, 0.0, 2.0, -2.0, math.pi], 6)
        for rows in (poses, twists):
            if chance.random() < 0.3 * self._rough:
                self._spoil(rows)
        kind = chance.randrange(4)
        return TargetMessage(
            self.seq,
            self._clock + t,
            chance.choice((0.02, 0.1, 0.1, 1.0)),
            None if kind == 0 else poses,
            None if kind in (1, 2) else twists,
            times,
            1 if chance.random() >= 0.1 * self._rough else chance.choice((0, 2, 10**9)),
            chance.random() < 0.3,
        )

    def _spoil(self, rows: Array) -> None:
        for _ in range(self._chance.randint(1, 3)):
            at = tuple(self._chance.randrange(size) for size in rows.shape)
            rows[at] = self._chance.choice(WRONG)


class Played(NamedTuple):
    """What the executor did.

    Attributes:
        setpoints, velocities: as handed to the drives in each cycle, shape (n, K).
        shares: of the axes' speed that orders left in each cycle, shape (n,). messages: sent.
    """

    machine: Machine
    setpoints: Array
    velocities: Array
    shares: Array
    messages: int


def play(seed: int) -> Played:
    """Stream to the machine of a seed."""
    chance = random.Random(seed)
    machine = machine_of(chance, seed)
    setpoints = np.zeros((CYCLES, len(machine.axes)))
    velocities, shares = np.zeros_like(setpoints), np.ones(CYCLES)
    executor = VirtualExecutor(machine)
    slot, row = executor.executor._slots[0], executor.executor.row
    everything = (1 << len(machine.axes)) - 1
    client, sent = Client(chance, machine), 0
    straight_in = chance.choice((0.0, 0.0, 0.02))
    orders = chance.choice((0.0, 0.0, 0.01))
    box = executor.sink(0).targets
    for cycle in range(CYCLES):
        if cycle == 0 or (not slot.running and chance.random() < 0.05):
            ring = executor.open_slot(0)
            sent += client.sent
            client = Client(chance, machine)
            for kind in (ControlKind.AXIS, ControlKind.HALT_AXES, ControlKind.FOLLOW, ControlKind.FINISH):
                ring.put_control(
                    Control(kind, 0.0, 0, axes=everything, operation=CAPTURE, value=client.share)
                )
        else:
            now = executor.executor.time
            for message in client.messages(cycle):
                rate = chance.choice((1.0, 0.3, 0.0))
                targets = client.stream.take(message, Now(now, row.setpoint.copy(), rate))
                if targets is not None:
                    box.put(targets)
            if chance.random() < straight_in:
                box.put(client.garbage(now))
            if chance.random() < orders:
                _order(chance, executor)
        executor.step()
        setpoints[cycle], velocities[cycle] = row.setpoint, row.velocity
        shares[cycle] = slot.rapid_rate
    executor.close()
    return Played(machine, setpoints, velocities, shares, sent + client.sent)


def _order(chance: random.Random, executor: VirtualExecutor) -> None:
    mailbox = executor.mailbox
    match chance.randrange(6):
        case 0:
            mailbox.set_hold(True, 0)
        case 1 | 2:
            mailbox.resume(0)
        case 3:
            mailbox.set_override(chance.choice((0.0, 0.1, 0.5, 1.0, 2.0)), 0)
        case 4:
            executor.miss(chance.randint(1, 30))
        case 5:
            mailbox.abort(0) if chance.random() < 0.2 else executor.sink(0).targets.close()


def broken_laws_of_streams(seed: int) -> tuple[list[str], int, int]:
    """Name the laws that the stream of a seed breaks; and return its messages and cycles."""
    played = play(seed)
    machine, setpoints = played.machine, played.setpoints
    broken = []
    rested = np.concatenate((np.repeat(setpoints[:1], 3, axis=0), setpoints))
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        limit = np.array([getattr(axis, f"max_{name}") for axis in machine.axes])
        # positions are rounded to a last digit
        rounding = 8.0 * np.spacing(np.abs(setpoints).max(axis=0)) / machine.cycle_s**order
        found = np.abs(np.diff(rested, order, axis=0)).max(axis=0) / machine.cycle_s**order
        worst = float(((found - rounding) / limit).max())
        if not worst <= SLACK:
            broken.append(f"{name} {worst:.9g} of its limit")
    low = np.array([axis.min_position for axis in machine.axes])
    high = np.array([axis.max_position for axis in machine.axes])
    beyond = float(np.maximum(low - setpoints, setpoints - high).max())
    if not beyond <= 1e-9:
        broken.append(f"travel by {beyond:.3g}")
    torques = limited(machine)
    if torques is not None:
        speed = (rested[2:] - rested[:-2]) / (2.0 * machine.cycle_s)
        change = np.diff(rested, 2, axis=0) / machine.cycle_s**2
        load = torques[0].load(rested[1:-1], speed, change, ())
        if not load <= TOLERATED:
            broken.append(f"torque {load:.4g} of its limit")
    return broken + _broken_by_velocities(played), played.messages, len(setpoints)


def _broken_by_velocities(played: Played) -> list[str]:
    """Judge the velocities handed to the drives: what the positions do, and no more than orders leave."""
    cycle_s, axes = played.machine.cycle_s, played.machine.axes
    torques = limited(played.machine)
    share = 1.0 if torques is None else torques[1]
    broken = []
    moved = np.diff(played.setpoints, axis=0) / cycle_s
    rounding = 8.0 * np.spacing(np.abs(played.setpoints).max(axis=0)) / cycle_s
    for column, axis in enumerate(axes):
        # at the end of a cycle it is that of the middle, but for half a cycle at the greatest acceleration
        apart = np.abs(played.velocities[1:, column] - moved[:, column]) - rounding[column]
        worst = float(apart.max()) / (0.5 * axis.max_acceleration * cycle_s)
        if not worst <= SLACK:
            broken.append(f"velocity of axis {axis.index} is not that of its positions: {worst:.9g}")
        # from the greatest acceleration: taken back first
        led = followed_axis(axis, share)
        stop_s = led.max_velocity / led.max_acceleration + 2.0 * led.max_acceleration / led.max_jerk
        behind = math.ceil(stop_s / cycle_s) + 2
        if behind >= len(moved):
            continue
        left = np.lib.stride_tricks.sliding_window_view(played.shares, behind).max(axis=1)
        speed = np.abs(moved[behind - 2 :, column]) - rounding[column]
        worst = float((speed - SLACK * left * axis.max_velocity).max())
        if not worst <= 1e-9 * axis.max_velocity:
            broken.append(f"axis {axis.index} is faster by {worst:.3g} m/s than orders leave it")
    return broken
