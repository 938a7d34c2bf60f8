"""Where the axes are now: the newest samples, and the bridge's own time of each."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Sequence

import numpy as np
from mcclient.telemetry import Samples
from numpy.typing import NDArray

from mcserver.ros.joints import Joint, units_of

Array = NDArray[np.float64]

# How fast the clocks of server and bridge may drift apart [1].
DRIFT = 1e-3


class AxisStates:
    """The newest cycle of all joints, in m and rad.

    Attributes:
        at: when it was, by the clock here, as far as the quickest sample so far tells.
        setpoint, position, velocity: shape (n,).
    """

    def __init__(self, joints: Sequence[Joint], clock: Callable[[], float]) -> None:
        self._units = units_of(joints)
        self._columns = {joint.axis: column for column, joint in enumerate(joints)}
        self._clock = clock
        self._offset = math.inf
        self._seen = 0.0
        self.at = -math.inf
        self._came = asyncio.Event()
        self.setpoint: Array = np.zeros(len(joints))
        self.position: Array = np.zeros(len(joints))
        self.velocity: Array = np.zeros(len(joints))

    async def until_known(self) -> None:
        """Wait for the first sample."""
        await self._came.wait()

    def take(self, samples: Samples) -> None:
        """Take the last of some cycles."""
        now, then = self._clock(), float(samples.time_s[-1])
        self._offset = min(self._offset + DRIFT * (now - self._seen), now - then)
        self._seen = now
        self.at = then + self._offset
        self._came.set()
        self.setpoint = samples.setpoint[-1] * self._units
        self.position = samples.actual[-1] * self._units
        self.velocity = samples.velocity[-1] * self._units

    def columns(self, joints: Sequence[Joint]) -> NDArray[np.intp]:
        """Return the places of some joints in the arrays."""
        return np.array([self._columns[joint.axis] for joint in joints], np.intp)
