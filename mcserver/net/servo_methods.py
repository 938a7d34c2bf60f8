"""The remote method ``open_servo``, and the messages of targets streamed to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.machine.machine_file import Machine
from mcserver.net import servo_messages as wire
from mcserver.service import servo
from mcserver.service.axes_of_requests import positions_in_si
from mcserver.service.program import Program
from mcserver.service.service import MachineService
from mcserver.service.target_stream import TargetMessage
from mcserver.units import DEGREE, MM

Array = NDArray[np.float64]

# Scales to SI of X Y Z A B C, and of their rates.
POSE_SCALE: Array = np.array([MM] * 3 + [DEGREE] * 3)
POSE_SCALE.setflags(write=False)


class ServoMethods:
    """Handles the method for one machine's service."""

    def __init__(self, service: MachineService) -> None:
        self._service = service

    async def open_servo(self, client: str, request: wire.ServoRequest) -> wire.ServoReply:
        within = bounds_asked(self._service.machine, request)
        program = await servo.open_servo(self._service, client, request.axes, request.name, within)
        shown = " ".join(str(axis) for axis in program.axes)
        self._service.record_command(client, "open_servo", program.program, f"axis {shown}")
        return wire.ServoReply(program.program, servo.streamed(self._service.machine, program.axes))


def bounds_asked(machine: Machine, request: wire.ServoRequest) -> servo.Sides | None:
    """Return the bounds of axes in a request; None without any.

    Raises:
        ServiceError: MC507 no such axis.
    """
    if request.low is None and request.high is None:
        return None
    return positions_in_si(machine, request.low or {}), positions_in_si(machine, request.high or {})


def targets_in_si(program: Program, message: wire.StreamTargets) -> TargetMessage:
    """Convert a message of targets to SI; rows of different lengths become arrays that match no axes."""
    scale = np.ones(0) if program.targets is None else program.targets.si_per_unit
    if message.tool is not None:
        # a tool without orientation only has X Y Z
        scale = POSE_SCALE[: len((message.positions or message.velocities or [[]])[0])]
    return TargetMessage(
        message.seq,
        message.sent,
        message.counts_s,
        _rows(message.positions, scale),
        _rows(message.velocities, scale),
        None if message.times is None else np.array(message.times, np.float64),
        message.tool,
        message.frame == "tool",
    )


def _rows(rows: Sequence[Sequence[float]] | None, scale: Array) -> Array | None:
    if rows is None:
        return None
    if any(len(row) != len(scale) for row in rows):
        return np.empty((0, 0))
    return np.array(rows, np.float64) * scale
