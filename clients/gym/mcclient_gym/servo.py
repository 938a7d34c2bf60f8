"""A machine in servo mode as an environment: actions are its targets, limits are kept at every cycle."""

from __future__ import annotations

from typing import Any, Literal

import gymnasium
import numpy as np
from mckinematics.single import Linearised
from mckinematics.solver import MachineKinematics
from numpy.typing import NDArray

from mcserver.executor.target_follower import TargetFollower
from mcserver.machine.machine_file import load_machine
from mcserver.motion.kernels.target_tracking import POSITION, VELOCITY
from mcserver.motion.limits.torque_in_box import followed_axis
from mcserver.service.reports import ServoStatus
from mcserver.service.servo import torque_share
from mcserver.service.target_stream import Now, TargetMessage, TargetStream

Array = NDArray[np.float64]
Actions = Literal["velocities", "positions", "twist"]

# What an action of 1 is for a tool [m/s, rad/s].
TIP_SPEED, TURN_SPEED = 0.5, 1.5
# Of an observed position without limits [m or rad], and for rounding.
FARTHEST, ROUNDED = 1e6, 1e-6
# A message counts for so many periods.
COUNTS = 5.0


class ServoEnv(gymnasium.Env[Array, Array]):
    """The machine's axes follow one message of targets each step, as its server lets them.

    The filter of targets, the inverse kinematics and the limits of every cycle are the server's own code; the
    axes are where their setpoints are, as with ideal drives. Give a reward by overriding `judge`, and more to
    see by overriding `observe`.

    Args:
        machine: a built-in machine or a TOML file.
        actions: ``velocities``: shares of the axes' top speeds; ``positions``: of their travel, -1 and 1 its
            ends; ``twist``: of the tool, in the base's frame, shares of 0.5 m/s and 1.5 rad/s.
        tool: whose pose is observed, and which a twist moves; None: none.
        period_s: between actions [s], a multiple of the machine's cycle.

    Observations: positions and velocities of the axes [m or rad, per s]; of a tool its point [m] and, with
    orientation, the first two columns of its rotation. Info has ``servo``, the counts of `ServoStatus`.

    Raises:
        ValueError: ``positions`` of an axis without limits of travel, ``twist`` without a tool.
    """

    def __init__(
        self,
        machine: str = "arm6",
        *,
        actions: Actions = "velocities",
        tool: int | None = None,
        period_s: float = 0.02,
    ) -> None:
        self.machine = load_machine(machine)
        self.cycles = max(1, round(period_s / self.machine.cycle_s))
        self.kinematics = MachineKinematics(self.machine)
        self._actions = actions
        self._number = tool
        self._tool = None if tool is None else self.kinematics.tool(tool)
        carrying = () if self._tool is None else self._tool.chain.axes
        self._columns = [self.machine.column_of(axis) for axis in carrying]
        axes = self.machine.axes
        self.start: Array = np.array([axis.initial_position for axis in axes])
        share = torque_share(self.machine, self.kinematics, range(len(axes)), self.start)
        self._led = [followed_axis(axis, share) for axis in axes]
        self._low = np.array([axis.min_position for axis in axes])
        self._high = np.array([axis.max_position for axis in axes])
        self._top = np.array([axis.max_velocity for axis in axes])
        if actions == "positions" and not (np.isfinite(self._low) & np.isfinite(self._high)).all():
            raise ValueError("an axis has no limits of travel: use actions='velocities'")
        if actions == "twist" and self._tool is None:
            raise ValueError("a twist needs the number of a tool")
        width = len(axes)
        if actions == "twist" and self._tool is not None:
            width = self._tool.rows
        self._tip = np.array([TIP_SPEED] * 3 + [TURN_SPEED] * 3)[:width]
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (width,), np.float64)
        most = self.most_observed()
        self.observation_space = gymnasium.spaces.Box(-most, most, dtype=np.float64)
        self._time = 0.0
        # where the tool is, once it has been asked for in a step
        self._tip_seen: Linearised | None = None
        self._begin(self.start)

    @property
    def positions(self) -> Array:
        """Where the axes are, shape (n,) [m or rad]."""
        return self._follower.states[:, POSITION]

    @property
    def velocities(self) -> Array:
        """Shape (n,) [m/s or rad/s]."""
        return self._follower.states[:, VELOCITY]

    @property
    def point(self) -> Array:
        """Where the tool's point is, shape (3,) [m]."""
        return np.array(self._tip_now().position)

    @property
    def servo(self) -> ServoStatus:
        """What became of the targets of this episode."""
        return self._stream.status

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin at rest; ``options["positions"]``: where the axes are, shape (n,) [m or rad]."""
        super().reset(seed=seed)
        places = (
            self.start if options is None else np.asarray(options.get("positions", self.start), np.float64)
        )
        self._begin(np.clip(places, self._low, self._high))
        return self.observe(), self._info()

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Send the action's targets and let a period pass; what truncates an episode are wrappers."""
        self._seq += 1
        given = np.asarray(action, np.float64)[None]
        positions, velocities, tool = None, None, None
        match self._actions:
            case "velocities":
                velocities = given * self._top
            case "positions":
                positions = 0.5 * ((1.0 + given) * self._high + (1.0 - given) * self._low)
            case "twist":
                velocities, tool = given * self._tip, self._number
        cycle_s = self.machine.cycle_s
        message = TargetMessage(
            self._seq, self._time, COUNTS * self.cycles * cycle_s, positions, velocities, None, tool
        )
        targets = self._stream.take(message, Now(self._time, self.positions.copy()))
        if targets is not None:
            self._follower.take(targets)
        newest = self._follower.newest
        times = np.asarray(self._time + cycle_s * np.arange(1, self.cycles + 1), np.float64)
        self._time = float(times[-1])
        # messages count for whole periods
        counts = newest is not None and self._time < newest.until + 0.5 * cycle_s
        self._follower.step(times, 1.0 if counts else 0.0)
        self._tip_seen = None
        reward, terminated = self.judge()
        return self.observe(), reward, terminated, False, self._info()

    def observe(self) -> Array:
        """Return what the agent sees, shape (m,)."""
        seen = [self.positions, self.velocities]
        if self._tool is not None:
            tip = self._tip_now()
            seen.append(np.array(tip.position))
            if self._tool.orientation:
                seen.append(np.array(tip.rotation).reshape(3, 3)[:, :2].ravel())
        return np.concatenate(seen)

    def most_observed(self) -> Array:
        """Return bounds of what the agent sees, shape (m,), as great below 0 as above."""
        travel = np.maximum(np.abs(self._low), np.abs(self._high))
        most = [np.where(np.isfinite(travel), travel, FARTHEST) + ROUNDED, self._top + ROUNDED]
        if self._tool is not None:
            most.append(np.full(3, self.tip_reach))
            if self._tool.orientation:
                most.append(np.full(6, 1.0 + ROUNDED))
        return np.concatenate(most)

    @property
    def tip_reach(self) -> float:
        """How far from the base's origin the tool's point may be [m]."""
        assert self._tool is not None
        chain = self._tool.chain
        return chain.reach + float(np.abs(chain.points).max())

    def judge(self) -> tuple[float, bool]:
        """Return the reward of a step, and whether the episode has ended."""
        return 0.0, False

    def tip(self, positions: Array) -> Array:
        """Return where the tool's point is with the axes at positions, shape (3,) [m]."""
        return np.array(self._linearise(positions).position)

    def _linearise(self, positions: Array) -> Linearised:
        assert self._tool is not None
        return self._tool.chain.single.linearise(positions[self._columns].tolist())

    def _tip_now(self) -> Linearised:
        if self._tip_seen is None:
            self._tip_seen = self._linearise(self.positions)
        return self._tip_seen

    def _begin(self, places: Array) -> None:
        axes, cycle_s = self._led, self.machine.cycle_s
        self._time, self._seq = 0.0, 0
        self._tip_seen = None
        self._stream = TargetStream(axes, cycle_s, self.kinematics)
        self._follower = TargetFollower(axes, places, at=0.0, cycle_s=cycle_s)

    def _info(self) -> dict[str, Any]:
        return {"servo": self.servo}
