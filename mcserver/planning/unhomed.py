"""The machine's limits for planning while some axes are not homed."""

from __future__ import annotations

import math
from collections.abc import Container

import msgspec

from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine


def machine_for(machine: Machine, homed: Container[int], *, moves_unhomed: bool) -> Machine:
    """Return the machine with its present limits.

    An axis that is not homed has no travel limits, and a program that may move it all the same (a jog) does
    so slowly. An axis that has to be homed before programs move it keeps its limits, which then apply.

    Args:
        homed: numbers of the homed axes.
        moves_unhomed: the program may move the others.
    """
    if all(axis.index in homed for axis in machine.axes):
        return machine
    axes = tuple(
        axis if axis.index in homed else _unhomed(axis, moves=moves_unhomed) for axis in machine.axes
    )
    return msgspec.structs.replace(machine, axes=axes)


def _unhomed(axis: Axis, *, moves: bool) -> Axis:
    homing = axis.homing
    if homing is None or (homing.required and not moves):
        return axis
    speed = min(axis.max_velocity, homing.jog_velocity) if moves else axis.max_velocity
    return msgspec.structs.replace(axis, min_position=-math.inf, max_position=math.inf, max_velocity=speed)
