"""A machine whose simulated drives stand elsewhere than its file says."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from mcserver.machine.machine_file import Machine


def starting_at(machine: Machine, positions: Mapping[int, float]) -> Machine:
    """Return the machine with its axes at other positions [m or rad], within their travel."""
    axes = tuple(
        msgspec.structs.replace(axis, initial_position=positions.get(axis.index, axis.initial_position))
        for axis in machine.axes
    )
    return msgspec.structs.replace(machine, axes=axes)
