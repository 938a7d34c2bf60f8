"""Servo mode: programs whose leased axes follow targets streamed by their client."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.errors import Refused
from mcserver.executor.entries import Control, ControlKind
from mcserver.executor.envelope_bounds import Envelope, enforced
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.canonical import AxisOperation
from mcserver.motion.geometry.torque_limits import TorqueLimits
from mcserver.motion.limits.torque_in_box import TorqueBox, followed_axis
from mcserver.service.arming import RunRequest
from mcserver.service.axes_of_requests import axes_of
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.service import MachineService
from mcserver.service.target_stream import Now, TargetMessage, TargetStream

if TYPE_CHECKING:
    from mckinematics.solver import MachineKinematics

Array = NDArray[np.float64]
# Least and greatest positions by axis number [m or rad].
Sides = tuple[Mapping[int, float], Mapping[int, float]]

# Interval of acknowledgements, each for all messages since the last one; it also shows the client that the
# server is alive, and an end.
ANSWER_S = 0.05
# Targets are not followed if torques leave axes less than this share of their accelerations.
LEAST_TORQUE_SHARE = 0.005
_CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)


async def open_servo(
    service: MachineService,
    client: str,
    axes: Sequence[int] | None,
    name: str = "",
    within: Sides | None = None,
    approved: RunRequest | None = None,
) -> Program:
    """Lease axes, energize them, and start following.

    Args:
        within: least and greatest position of each axis, by number [m or rad], to which targets are clipped;
            None: its travel. With bodies or zones the program ends as faulted at once, without motion, if
            they would not stay clear everywhere in it.
        approved: request whose extents, speeds, duration and override are enforced; None: no approval needed.

    Raises:
        ServiceError: MC439 an axis whose drive does not follow setpoints, MC507, MC512 an axis is leased,
            MC595 the machine has bodies or zones, and ``within`` is missing; MC327 ``within`` does not match
            the axes; MC600 holding the axes still exceeds a joint's torque somewhere within the bounds;
            MC508, MC509, MC515, MC519.
    """
    machine = service.machine
    if machine.clearance is not None and within is None and approved is None:
        raise Refused(
            "MC595",
            f"{machine.name} has [clearance], and where targets may lead its axes is not said",
            "give the least and the greatest position of each axis: low and high",
        )
    chosen = axes_of(machine, axes)
    for index in chosen:
        service.refuse_leased(index)
    columns = [machine.column_of(index) for index in chosen]
    for column in columns:
        if machine.axes[column].profiled:
            raise Refused(
                "MC439",
                f"the drive of axis {machine.axes[column].index} goes to points on its own profiles",
                "leave the axis out, or use a drive with csp or ip",
                axis=machine.axes[column].index,
            )
    mask = sum(1 << column for column in columns)
    # the second drive of a gantry gets its leader's setpoint, and has no targets of its own
    columns = [machine.column_of(index) for index in streamed(machine, chosen)]
    led = sum(1 << column for column in columns)
    low, high, envelope = None, None, None
    if approved is not None:
        envelope, within = _envelope(machine, approved, within)
    if within is not None:
        low, high = _bounds(machine, columns, within)
    kinematics = build_kinematics(machine)
    setpoint = np.array(service.port.snapshot().setpoint)
    # with limited torques this takes tenths of a second
    share = await asyncio.to_thread(torque_share, machine, kinematics, columns, setpoint, (low, high))
    follow = [Control(ControlKind.FOLLOW, 0.0, 0, axes=led, values=high, value=share)]
    if low is not None:
        follow.insert(0, Control(ControlKind.FOLLOW_FROM, 0.0, 0, axes=led, values=low))
    program = await service.open(
        client,
        ProgramOptions(
            name=name or "servo mode",
            axes=chosen,
            controls=[
                Control(ControlKind.AXIS, 0.0, 0, axes=mask, operation=_CAPTURE),
                # first stop an axis that coasts, or that an ended program has left at a speed
                Control(ControlKind.HALT_AXES, 0.0, 0, axes=mask),
                *follow,
                Control(ControlKind.FINISH, 0.0, 0),
            ],
            override_limit=math.inf if approved is None else approved.override,
            envelope=envelope,
        ),
    )
    if program.state == "queued":
        service.abort(program.program, "its axes are in use")
        raise Refused("MC512", "the axes are in use, or 8 programs run", "wait until one has ended")
    axes_led = [followed_axis(machine.axes[column], share) for column in columns]
    if envelope is not None:
        axes_led = [
            msgspec.structs.replace(axis, max_velocity=min(axis.max_velocity, envelope.speed[column]))
            for axis, column in zip(axes_led, columns, strict=True)
        ]
    program.targets = TargetStream(axes_led, machine.cycle_s, kinematics)
    # it has no lines to acknowledge
    return await service.recorded(program)


def streamed(machine: Machine, axes: Sequence[int]) -> list[int]:
    """Return the leased axes that have a column in rows of targets, in order."""
    return [axis for axis in axes if axis not in machine.followers]


def _envelope(machine: Machine, approved: RunRequest, within: Sides | None) -> tuple[Envelope, Sides]:
    """Return the envelope of an approved stream, and the least and greatest position of each axis."""
    shown = approved.envelope
    assert shown is not None, "a run with faults is not approved"
    # wherever it begins, a tip has no more room than shown to the operator
    held = enforced(shown, machine, min(1.0, approved.override), [0.0] * len(machine.axes))
    low, high = within or ({}, {})
    indices = [axis.index for axis in machine.axes]
    return held, (
        {axis: max(low.get(axis, least), least) for axis, least in zip(indices, shown.low, strict=True)},
        {axis: min(high.get(axis, most), most) for axis, most in zip(indices, shown.high, strict=True)},
    )


def _bounds(
    machine: Machine, columns: Sequence[int], within: Sides
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return the least and greatest positions of all columns within their travel, shape (K,) each.

    Raises:
        Refused: MC327.
    """
    low, high = np.zeros(len(machine.axes)), np.zeros(len(machine.axes))
    for column in columns:
        axis = machine.axes[column]
        least, most = (each.get(axis.index, math.nan) for each in within)
        low[column], high[column] = max(least, axis.min_position), min(most, axis.max_position)
        if not (math.isfinite(least) and math.isfinite(most) and low[column] <= high[column]):
            raise Refused(
                "MC327",
                f"axis {axis.index} has no place from its low to its high within its travel",
                "give both for each axis, low below high, in mm or degrees",
                axis=axis.index,
            )
    return tuple(low.tolist()), tuple(high.tolist())


def torque_share(
    machine: Machine,
    kinematics: MachineKinematics | None,
    columns: Sequence[int],
    setpoint: Array,
    bounds: tuple[Sequence[float] | None, Sequence[float] | None] = (None, None),
) -> float:
    """Return the share of the axes' accelerations that torques leave, from their positions to their bounds.

    Args:
        setpoint: of all columns [m or rad]. bounds: least and greatest positions of all columns; None: their
            travel.

    Raises:
        Refused: MC600.
    """
    limits = TorqueLimits.of(machine, None if kinematics is None else kinematics.dynamics)
    if limits is None:
        return 1.0
    low, high = setpoint.copy(), setpoint.copy()
    velocity, acceleration = np.zeros_like(setpoint), np.zeros_like(setpoint)
    for column in columns:
        axis = machine.axes[column]
        least, most = (
            own if each is None else each[column]
            for own, each in zip((axis.min_position, axis.max_position), bounds, strict=True)
        )
        low[column], high[column] = min(low[column], least), max(high[column], most)
        velocity[column], acceleration[column] = axis.max_velocity, axis.max_acceleration
    box = TorqueBox(limits, low, high, velocity, acceleration)
    if not box.moves:
        return 1.0
    share, column = box.share()
    if share < LEAST_TORQUE_SHARE:
        index = machine.axes[column].index
        raise Refused(
            "MC600",
            f"somewhere between the bounds, axis {index} needs nearly all of its max_torque to be held still",
            "let the axes go less far: a narrower low and high of open_servo; or carry less",
            axis=index,
        )
    return share


def put_targets(service: MachineService, program: Program, message: TargetMessage) -> None:
    """Process a message of targets for a program in servo mode, and count it."""
    if program.targets is None:
        return
    if not program.targets.answering:
        program.targets.answering = True
        asyncio.get_running_loop().call_later(ANSWER_S, _answer, service, program)
    if program.slot is None or program.over:
        return
    snapshot = service.port.snapshot()
    now = Now(snapshot.time)
    if message.tool is not None:
        setpoint = [
            snapshot.setpoint[service.machine.column_of(axis)]
            for axis in streamed(service.machine, program.axes)
        ]
        now = Now(snapshot.time, np.array(setpoint), min(1.0, program.override))
    targets = program.targets.take(message, now)
    if targets is not None:
        service.port.targets(program.slot).put(targets)


def _answer(service: MachineService, program: Program) -> None:
    assert program.targets is not None
    program.targets.answering = False
    service.acks.acknowledge(program)


def close_targets(service: MachineService, program: Program) -> None:
    """End a program in servo mode at its last targets; other programs are not affected."""
    if program.targets is not None and program.slot is not None:
        service.port.targets(program.slot).close()
