"""How far and how fast the axes and tools of a simulated run go: every cycle of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from mckinematics.solver import MachineKinematics
from numpy.typing import NDArray

from mcserver.executor.entries import Array
from mcserver.executor.envelope_bounds import Envelope, TipEnvelope
from mcserver.machine.machine_file import Machine
from mcserver.motion.kernels.envelope import tip_positions


class EnvelopeMeter:
    """Is shown every cycle's setpoints.

    Args:
        kinematics: of the machine's tools; None: it has none. axes: of the program; tools that any of these
            moves are followed.
    """

    def __init__(self, machine: Machine, kinematics: MachineKinematics | None, axes: tuple[int, ...]) -> None:
        self._cycle = machine.cycle_s
        self._shaping = machine.shaping
        start = np.array([axis.initial_position for axis in machine.axes])
        self._low, self._high = start.copy(), start.copy()
        self._step = np.zeros(len(start))
        self._last: Array | None = None
        tools = () if kinematics is None else kinematics.tools
        self._tips = [
            _TipMeter(machine, kinematics, tool, start)
            for tool in tools
            if kinematics is not None and set(axes) & set(kinematics.axes(tool))
        ]

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:  # noqa: ARG002
        """Look at cycles in order: setpoints (n, K) [SI]."""
        np.minimum(self._low, setpoint.min(axis=0), out=self._low)
        np.maximum(self._high, setpoint.max(axis=0), out=self._high)
        before = setpoint[:1] if self._last is None else self._last[None]
        followed = np.concatenate((before, setpoint))
        np.maximum(self._step, np.abs(np.diff(followed, axis=0)).max(axis=0), out=self._step)
        for tip in self._tips:
            tip.take(followed)
        self._last = setpoint[-1].copy()

    def envelope(self, seconds: float, turned: Mapping[int, float]) -> Envelope:
        """Return the extents and speeds so far, without tolerances.

        Args:
            turned: columns that were commanded a speed → the greatest. A run that takes longer, as under a
                lower override, reaches it also where this one did not.

        Of shaped axes they are those that could have been ordered: what is ordered is judged.
        """
        shaping = self._shaping
        beyond, faster = (0.0, 0.0) if shaping is None else (shaping.deviations, shaping.speed_changes)
        speed = self._step / self._cycle
        for column, commanded in turned.items():
            speed[column] = max(speed[column], commanded)
        return Envelope(
            low=tuple((self._low - beyond).tolist()),
            high=tuple((self._high + beyond).tolist()),
            speed=tuple((speed + faster).tolist()),
            seconds=seconds,
            turning=sum(1 << column for column in turned),
            tips=tuple(tip.envelope(self._cycle) for tip in self._tips),
        )


class _TipMeter:
    """The tip of one tool."""

    def __init__(self, machine: Machine, kinematics: MachineKinematics, tool: int, start: Array) -> None:
        chain = kinematics.tool(tool).chain
        self._tool = tool
        self._columns = tuple(machine.column_of(axis) for axis in kinematics.axes(tool))
        self._turning = np.array(chain.revolute, np.bool_)
        self._steps = np.ascontiguousarray(chain.steps[:, :3, :])
        self._reach = float(chain.reach)
        tip = self._positions(start[None])[0]
        self._low, self._high = tip.copy(), tip.copy()
        self._step = 0.0

    def take(self, setpoint: Array) -> None:
        tips = self._positions(setpoint)
        np.minimum(self._low, tips.min(axis=0), out=self._low)
        np.maximum(self._high, tips.max(axis=0), out=self._high)
        self._step = max(self._step, float(np.linalg.norm(np.diff(tips, axis=0), axis=1).max(initial=0.0)))

    def envelope(self, cycle_s: float) -> TipEnvelope:
        return TipEnvelope(
            tool=self._tool,
            columns=self._columns,
            turning=tuple(self._turning.tolist()),
            steps=tuple(self._steps.ravel().tolist()),
            reach=self._reach,
            low=tuple(self._low.tolist()),
            high=tuple(self._high.tolist()),
            speed=self._step / cycle_s,
        )

    def _positions(self, setpoint: Array) -> Array:
        joints = np.ascontiguousarray(setpoint[:, self._columns])
        found: Array = tip_positions(self._steps, self._turning, joints)
        return found
