"""Topics of servo mode as MoveIt Servo has them: whoever publishes twists or joint velocities leads the axes.

The axes are leased with the first command that is not zero, and given back once the commands have ceased. One
publisher at a time is followed. What ended otherwise (a stop, a fault, a lease of another) is not begun anew
by a stick that is still pushed: commands have to be zero, or cease, for a moment.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from mcclient import MotionError
from mcclient.servo import Servo
from mcclient.types import ENDED, MachineStatus, ServoStatus

from mcserver.ros.interfaces import MalformedPayload, interfaces
from mcserver.ros.joints import Joint
from mcserver.ros.lane import Surroundings
from mcserver.ros.node import LARGE_BYTES, Node
from mcserver.ros.outcome import LONGEST, ended_by
from mcserver.ros.servo_options import ServoOptions
from mcserver.ros.stamps import seconds_of
from mcserver.ros.velocity_commands import JOG, TWIST, Command, CommandReader, UnfitCommand

log = logging.getLogger(__name__)

# between two messages to the server, however many commands come
PACE_S = 0.005
# The server stops the axes so much later than the commands have ceased, should this process not do it [s].
MARGIN_S = 0.1
# Zero commands for so long give the axes back.
IDLE_S = 2.0
# Without a command that is not zero for so long, commands count again after an end of another kind [s].
RELEASE_S = 0.5
# An axis that has less left than it goes in this time at top speed is at its end.
END_S = 2e-3
# How long after a command that did not count it is told.
TOLD_S = 2.0


class ServoSaid(NamedTuple):
    """What ``/diagnostics`` says of servo mode.

    Attributes:
        follows: commands are followed. why: a command did not count, or the axes do less than commanded.
    """

    follows: bool
    why: str
    values: dict[str, Any]


class ServoTopics:
    """``delta_twist_cmds`` and ``delta_joint_cmds``.

    Args:
        joints: of the machine.
    """

    def __init__(
        self,
        node: Node,
        around: Surroundings,
        reader: CommandReader,
        options: ServoOptions,
        joints: tuple[Joint, ...],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._around = around
        self._timeout_s = options.timeout_s
        bounded = [joint for joint in joints if joint.name in options.within]
        within = {joint.axis: options.within[joint.name] for joint in bounded}
        self._within = {
            joint.axis: (within[joint.axis][0] / joint.si_per_unit, within[joint.axis][1] / joint.si_per_unit)
            for joint in bounded
        }
        # where the axes come to an end, by their travel or their bounds
        self._ends = {joint.axis: within.get(joint.axis, (joint.low, joint.high)) for joint in joints}
        self._joints = {joint.axis: joint for joint in joints}
        self._clock = clock
        # the publisher that is followed, its newest command, and when that came; when one not zero came
        self._owner: bytes | None = None
        self._newest: Command | None = None
        self._came_at = self._moved_at = -math.inf
        self._came = asyncio.Event()
        # Commands that are under way as this begins move nothing either.
        self._blocked = True
        self._pushed_at = clock()
        self._ended = "MC193: commands were there before the bridge was"
        # why the newest command that did not count did not, and when it came
        self._why, self._told_at = "", -math.inf
        self._taken = self._dropped = 0
        self._program = ""
        self._counted: ServoStatus | None = None
        for topic, kind, read in (
            ("delta_twist_cmds", TWIST, reader.twist),
            ("delta_joint_cmds", JOG, reader.jog),
        ):
            node.subscribe(f"{options.name}/{topic}", kind, self._receiver(kind, read))

    async def run(self) -> None:
        """Follow commands until this is cancelled."""
        while True:
            while self._newest is None:
                self._came.clear()
                await self._came.wait()
            try:
                await self._lead(frozenset(self._newest.axes))
            except UnfitCommand as unfit:
                self._block(f"MC191: {unfit}")
            except MotionError as error:
                self._block((await ended_by(error, self._around.reasons)).text)
            finally:
                self._program = ""

    def said(self, status: MachineStatus) -> ServoSaid:
        """Return what is to be known of it, once a second."""
        counted = next((each.servo for each in status.programs if each.program == self._program), None)
        before, self._counted = self._counted, counted
        values: dict[str, Any] = {"commands": self._taken, "dropped": self._dropped}
        if counted is not None:
            values |= {"slowed": counted.slowed, "refused": counted.refused, "late": counted.late}
        why = self._why if self._clock() < self._told_at + TOLD_S else ""
        if self._program and not why:
            why = self._slow(status, counted, before)
        return ServoSaid(bool(self._program), why, values)

    # ------------------------------------------------------------------ what comes

    def _receiver(self, kind: str, read: Callable[[Any], Command]) -> Callable[[bytes, bytes], None]:
        def take(payload: bytes, sender: bytes) -> None:
            now = self._clock()
            try:
                self._take(self._read(kind, read, payload), sender, now)
            except (MalformedPayload, UnfitCommand) as error:
                self._drop(f"MC191: {error}", now)

        return take

    def _read(self, kind: str, read: Callable[[Any], Command], payload: bytes) -> Command:
        if len(payload) > LARGE_BYTES:
            raise MalformedPayload(f"{len(payload)} bytes are no {kind}")
        message = interfaces().decode(kind, payload)
        stamp = seconds_of(message.header.stamp)
        age = time.time() - stamp
        if stamp and abs(age) > self._timeout_s:
            raise UnfitCommand(
                f"its stamp is {abs(age):.3f} s {'old' if age > 0.0 else 'ahead'}, and {self._timeout_s:g} s "
                "are possible: set the clocks, or leave the stamp 0"
            )
        return read(message)

    def _take(self, command: Command, sender: bytes, now: float) -> None:
        if self._blocked and not command.rests:
            if now - self._pushed_at < RELEASE_S:
                self._pushed_at = now
                self._drop(f"{self._ended}; send zero or nothing for {RELEASE_S:g} s", now)
                return
            self._blocked = False
        if self._owner is None:
            if command.rests:
                return
            self._owner = sender
        elif sender != self._owner:
            self._drop("MC192: another publisher is followed, until its commands cease", now)
            return
        self._taken += 1
        self._newest, self._came_at = command, now
        if not command.rests:
            self._moved_at = self._pushed_at = now
        self._came.set()

    def _drop(self, why: str, now: float) -> None:
        self._dropped += 1
        self._why, self._told_at = why[:LONGEST], now

    # ------------------------------------------------------------------ what is led

    async def _lead(self, axes: frozenset[int]) -> None:
        """Lead axes as long as commands are of them."""
        counts_s = self._timeout_s + MARGIN_S
        # the server says which of its axes lack bounds
        within = {axis: bounds for axis, bounds in self._within.items() if axis in axes} or None
        async with self._around.machine.servo(
            sorted(axes), name="ROS servo", within=within, counts_s=counts_s
        ) as servo:
            self._program = servo.id
            while (command := self._due(axes)) is not None:
                self._came.clear()
                await servo.send(velocities=command.row(servo.axes), tool=command.tool, frame=command.frame)
                await asyncio.sleep(PACE_S)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(max(0.0, self._came_at + self._timeout_s - self._clock())):
                        await self._came.wait()
            await self._rest(servo)

    def _due(self, axes: frozenset[int]) -> Command | None:
        """Return the command to follow; None: there is none, or of other axes."""
        now = self._clock()
        if now - self._came_at >= self._timeout_s or now - self._moved_at >= IDLE_S:
            self._newest = self._owner = None
        newest = self._newest
        return newest if newest is not None and axes.issuperset(newest.axes) else None

    async def _rest(self, servo: Servo) -> None:
        """Stop the axes within their limits; in a hold they stand, and nothing goes on behind it."""
        servo.check()
        if servo.state == "held":
            raise MotionError("MC535", "the commands ceased in a hold: servo mode has ended")
        if servo.state not in ENDED:
            await servo.send(velocities=np.zeros(len(servo.axes)))

    def _block(self, why: str) -> None:
        now = self._clock()
        self._ended, self._blocked, self._pushed_at = why, True, now
        self._why, self._told_at = why[:LONGEST], now
        self._newest = self._owner = None
        log.warning("servo mode: %s", why)

    def _slow(self, status: MachineStatus, counted: ServoStatus | None, before: ServoStatus | None) -> str:
        """Return why the axes do not do as commanded; empty: they do, as far as it is known."""
        for program in status.programs:
            if program.program == self._program and program.state != "running":
                return f"the program is {program.state}"
        if status.override == 0.0:
            return "the override is 0"
        newest, setpoint = self._newest, self._around.states.setpoint
        if newest is not None and newest.tool is None:
            rows = self._around.states.columns([self._joints[axis] for axis in newest.axes])
            for axis, velocity, at in zip(newest.axes, newest.velocities, setpoint[rows], strict=True):
                joint = self._joints[axis]
                low, high = self._ends[axis]
                left = high - at if velocity > 0.0 else at - low
                if velocity and left <= END_S * joint.max_velocity:
                    return (
                        f"{joint.name} is at the end of its {'bounds' if axis in self._within else 'travel'}"
                    )
        if counted is not None and before is not None and counted.slowed > before.slowed:
            return "slowed: near a singular position or the end of a joint's travel, or at its top speed"
        if counted is not None and before is not None and counted.refused > before.refused:
            return "the server refuses the commands"
        return ""
