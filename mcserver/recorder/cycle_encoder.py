"""Rows of the executor's feedback as messages: cycles of all axes, and now and then the tools' poses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.shm.feedback import (
    CYCLE,
    ESTOP,
    INTERLOCK,
    LATE,
    LINE,
    SLOT_RATE,
    SLOT_STATE,
    TIME,
    FeedbackRing,
)
from mcserver.machine.machine_file import Machine
from mcserver.recorder.channels import CYCLES, FIRST_TOOL, cycle_fields_of, pose_fields
from mcserver.recorder.chunks import Times
from mcserver.recorder.fixed_records import FixedRecords
from mcserver.simulation.tool_poses import ToolPoses

Array = NDArray[np.float64]

# Poses of tools a second: enough for the eye; every cycle's follow from the positions.
POSES_HZ = 50.0
# Positions are rounded to 2⁻²⁴ mm or degrees: the bits below say nothing, and noise does not compress.
POSITION_STEPS = 2.0**24


class CycleEncoder:
    """Encodes rows of one machine's feedback ring, block after block.

    Args:
        machine: the columns. ring: says where in a row things stand.
        epoch: Unix time of executor time 0 [s]. poses: of the tools.
    """

    def __init__(self, machine: Machine, ring: FeedbackRing, epoch: float, poses: ToolPoses) -> None:
        self._ring = ring
        self._epoch_ns = round(epoch * 1e9)
        self._scale = np.array([1.0 / axis.type.si_per_unit for axis in machine.axes])
        self._cycles = FixedRecords(CYCLES, cycle_fields_of(machine))
        self._poses = poses
        self._tools = {
            tool: FixedRecords(FIRST_TOOL + at, pose_fields()) for at, tool in enumerate(poses.numbers)
        }
        self._pose_step = max(1, round(machine.cycle_hz / POSES_HZ))
        self._encoded = 0

    def log_time(self, time_s: Array) -> Times:
        """Unix times of executor times [ns], shape as given."""
        times: Times = (self._epoch_ns + np.round(time_s * 1e9)).astype(np.uint64)
        return times

    def blocks(self, rows: Array) -> Iterator[tuple[int, Times, bytes]]:
        """Channel, times and message records of some rows, shape (n, width of the ring's row)."""
        if not len(rows):
            return
        ring, scale = self._ring, self._scale
        times = self.log_time(rows[:, TIME])
        setpoint, position = ring.block(rows, "setpoint"), ring.block(rows, "actual")
        slots = ring.slots_of(rows)
        inputs, outputs = ring.io_of(rows)
        values: dict[str, NDArray[np.generic]] = {
            "cycle": rows[:, CYCLE].astype(np.uint64),
            "time": rows[:, TIME],
            "line": rows[:, LINE].astype(np.uint32),
            "late_cycles": rows[:, LATE].astype(np.uint32),
            "estop": (rows[:, ESTOP] != 0.0).astype(np.uint8),
            "setpoint": _rounded(setpoint * scale),
            "position": _rounded(position * scale),
            "velocity": ring.block(rows, "actual_velocity") * scale,
            "torque": ring.block(rows, "torque"),
            "following_error": (setpoint - position) * scale,
            "commanded_velocity": ring.block(rows, "velocity") * scale,
            "condition": ring.block(rows, "condition").astype(np.uint8),
            "rate": slots[:, :, SLOT_RATE],
            "program_state": slots[:, :, SLOT_STATE].astype(np.uint8),
            "input": inputs,
            "output": outputs,
            "interlock": (rows[:, INTERLOCK] != 0.0).astype(np.uint8),
        }
        # a drive may report nonsense: more than a float holds becomes infinite, and is recorded as that
        with np.errstate(over="ignore", invalid="ignore"):
            records_of_cycles = self._cycles.encode(times, self._encoded, values)
        yield CYCLES, times, records_of_cycles
        first = -self._encoded % self._pose_step
        self._encoded += len(rows)
        chosen = slice(first, None, self._pose_step)
        if not self._tools or first >= len(rows):
            return
        for tool, records in self._tools.items():
            poses = self._poses.of(tool, position[chosen])
            columns: dict[str, NDArray[np.generic]] = dict(zip("xyzabc", poses.T, strict=True))
            columns["time"] = rows[chosen, TIME]
            channel = FIRST_TOOL + list(self._tools).index(tool)
            yield channel, times[chosen], records.encode(times[chosen], 0, columns)


def _rounded(positions: Array) -> Array:
    rounded: Array = np.round(positions * POSITION_STEPS) / POSITION_STEPS
    return rounded
