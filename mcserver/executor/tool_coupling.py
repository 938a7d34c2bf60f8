"""A tool whose tip goes along with a leader, as that of an arm over a conveyor does (D-142, D-145).

The joints that are ordered give a pose, which is shifted along the follower's direction by the offset and
solved, from the last cycle's joints on. A joint is there where its own limits and travel allow, and it could
stop within them from there; else it goes after it as an axis of servo mode does (`follow_targets`). So it
keeps them whatever comes, and never jumps.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from mckinematics.beside import ROUNDING, Miss, goal_beside, places_beside
from mckinematics.next_pose import solve_goal
from mckinematics.single import Floats, small_turn
from mckinematics.tool import ToolModel
from mckinematics.trace import Goal

from mcserver.executor.axes import AxisBank
from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.superimposed import SuperimposedCoupling
from mcserver.machine.coupled_errors import Limits
from mcserver.machine.machine_file import Machine
from mcserver.machine.tool_section import Tool
from mcserver.motion.kernels.target_tracking import (
    HIGHEST,
    LOWEST,
    MAX_JERK,
    POSITION,
    VELOCITY,
    follow_targets,
)

# Until the joints' part of the offset is known, which is at rest so long.
_NOT_KNOWN = Limits(1.0, 1.0, 1.0)
# A joint is where it is wanted within this share of what its jerk moves in a cycle.
NEAR = 0.3


class ToolCoupling(SuperimposedCoupling):
    """A tool that programs move, and whose tip follows besides.

    Before it begins its window is looked at from where it stands, one place a cycle. By what the joints turn
    for the tip there, their shares give the offset its limits.

    Args:
        noted: as of `SuperimposedCoupling`.
    """

    def __init__(
        self,
        machine: Machine,
        bank: AxisBank,
        tool: Tool,
        model: ToolModel,
        slot: int,
        generation: int,
        noted: deque[float] | None,
    ) -> None:
        follow = tool.follow
        assert follow is not None
        assert follow.superimposed is not None
        columns = [machine.column_of(index) for index in tool.axes]
        super().__init__(machine, bank, follow, columns, slot, generation, noted, _NOT_KNOWN)
        self._columns, self._model, self._direction = np.array(columns), model, follow.direction
        places = bank.row.ordered[self._columns]
        shares, limits = [], []
        for column in columns:
            axis = machine.axes[column]
            assert axis.reserved is not None
            shares.append(axis.reserved)
            limits.append([one + other for one, other in zip(axis.limits, axis.reserved, strict=True)])
        self._shares: Array = np.array(shares)
        low, high = np.minimum(model.chain.lower, places), np.maximum(model.chain.upper, places)
        self._joint_limits: Array = np.column_stack([limits, low, high])
        # behind the last cycle, and where they were to be
        self._joints: Array = np.zeros((len(columns), 3))
        self._joints[:, POSITION] = places
        self._wanted = self._joints.copy()
        # places of the latest cycles, the newest first
        self._last: Array = np.tile(places, (3, 1))
        # which were where they were wanted
        self._on = np.ones(len(columns), np.bool_)
        self._goal: Goal | None = None
        self._inputs: Floats = ()
        window = (follow.superimposed.low, follow.superimposed.high)
        self._window = places_beside(model, places.tolist(), self._direction, window)
        self._slopes: list[Floats] = []
        self._looks = self.waits = True
        # joints come to rest by themselves
        self._alone = False
        self._beyond = (0.0, 0.0)

    def shift(self, column: int, distance: float) -> None:
        super().shift(column, distance)
        at = self._columns == column
        for each in (self._joints[:, :1], self._wanted[:, :1], self._joint_limits[:, LOWEST:], self._last.T):
            each[at] += distance

    def _move(self) -> None:
        if self._looks and not self.ending:
            # its speed has to be known by then
            self.leader.look()
            self._look_at_window()
        else:
            super()._move()

    def _look_at_window(self) -> None:
        """Look at the next place of the window; behind the last one the offset has its limits."""
        found = next(self._window, None)
        if isinstance(found, Miss):
            self._fail(found.column, found.value)
        elif found is not None:
            self._slopes.append(found)
        else:
            with np.errstate(divide="ignore", over="ignore"):
                self._limits[:, :3] = (self._shares / np.abs(self._slopes).max(axis=0)[:, None]).min(axis=0)
            self._looks, self.waits = False, self._noted is not None

    def _fail(self, joint: int = -1, value: float = 0.0) -> None:
        """Let the joints come to rest by themselves; ``joint``: it would be beyond its travel, at a value."""
        self.failed = self._alone = True
        if joint >= 0:
            low, high = self._joint_limits[joint, LOWEST:].tolist()
            self.column, self._beyond = int(self._columns[joint]), (value, high if value > high else low)

    def step(self) -> None:
        was = self.in_step
        super().step()
        # its joints have to be, too
        self.in_step &= was or self.error <= self.tolerance

    def _add(self) -> None:
        row, columns, joints = self._row, self._columns, self._joints
        ordered, rates = row.setpoint[columns], row.velocity[columns]
        if not self._alone:
            self._solve(ordered.tolist(), rates.tolist())
        # what is wanted is bounded in place
        targets, share = self._wanted.copy(), 0.0 if self._alone else 1.0
        follow_targets(joints, targets, self._joint_limits, share, self._cycle_s, False)
        if not self._alone:
            self._be_there()
            self._compare()
        self._last[1:] = self._last[:-1]
        self._last[0] = joints[:, POSITION]
        self._shaper.added[columns] = joints[:, POSITION] - ordered
        self._shaper.added_velocity[columns] = joints[:, VELOCITY] - rates

    def _solve(self, ordered: list[float], rates: list[float]) -> None:
        """Set where the joints are to be for what they are ordered and the offset."""
        place, speed, _ = self.state.tolist()
        inputs, wanted, cycle = (*ordered, place), self._wanted, self._cycle_s
        if inputs == self._inputs:
            # exactly at rest
            wanted[:, VELOCITY:] = 0.0
            return
        self._inputs = inputs
        self._goal = goal = goal_beside(self._model, ordered, rates, self._direction, place, speed)
        before, was, change = wanted.T.copy()
        found = solve_goal(self._model, (before + cycle * (was + 0.5 * cycle * change)).tolist(), goal)
        if found is None:
            self._fail()
            return
        joints, slope = np.array(found)
        # at the end of a cycle of constant jerk
        change = (4.0 * slope + 2.0 * was - 6.0 * (joints - before) / cycle) / cycle
        wanted.T[:] = joints, slope, change
        beyond = np.maximum(self._joint_limits[:, LOWEST] - joints, joints - self._joint_limits[:, HIGHEST])
        joint = int(np.argmax(beyond))
        if beyond[joint] > ROUNDING:
            self._fail(joint, float(joints[joint]))

    def _be_there(self) -> None:
        """Let the joints that were, and may be, where they are wanted be there.

        A state is that of the cubic through the latest four places: whatever jerk comes next, differences of
        setpoints are means of what was and what comes.
        """
        cycle, place = self._cycle_s, self._wanted[:, POSITION]
        (one, two, three), (top, most, jerk, low, high) = self._last, self._joint_limits.T
        step, bend = place - one, place - 2.0 * one + two
        third = (bend - (one - 2.0 * two + three)) / cycle**3
        before = bend / cycle**2
        change = before + cycle * third
        speed = step / cycle + cycle * (0.5 * change - cycle * third / 6.0)
        # what a stop takes at the most: the acceleration taken back first, then braking
        way = np.copysign(1.0, speed)
        ahead = np.maximum(change * way, 0.0)
        peak = np.abs(speed) + 0.5 * ahead**2 / jerk
        end = place + way * peak * (ahead / jerk + 0.5 * (peak / most + most / jerk))
        allowed = (
            (peak <= top) & (np.maximum(np.abs(before), np.abs(change)) <= most) & (np.abs(third) <= jerk)
        )
        allowed &= (low <= np.minimum(place, end)) & (np.maximum(place, end) <= high)
        allowed &= self._on
        np.copyto(self._joints.T, (place, speed, change), where=allowed)
        # one that has come back is so near
        near = np.abs(self._joints[:, POSITION] - place) <= NEAR * np.minimum(jerk, most / cycle) * cycle**3
        self._on = allowed | near

    def _compare(self) -> None:
        """Add to the error how far the tip is from where it was wanted, a turn at the chain's reach."""
        goal = self._goal
        if goal is None or self.waits or self.ending:
            return
        if (self._joints[:, POSITION] == self._wanted[:, POSITION]).all():
            return
        here = self._model.chain.single.linearise(self._joints[:, POSITION].tolist())
        off = math.dist(here.position, goal.position)
        if goal.rotation is not None:
            turn = small_turn(goal.rotation, here.rotation)
            off += math.inf if turn is None else self._model.chain.reach * math.hypot(*turn)
        self.error += off

    def brake(self, *, urgent: bool) -> None:
        super().brake(urgent=urgent)
        if urgent:
            self._joint_limits[:, MAX_JERK] = np.inf

    def rest(self) -> None:
        super().rest()
        self._joints[:, VELOCITY:] = self._wanted[:, VELOCITY:] = 0.0
        self._last[:] = self._joints[:, POSITION]

    def lose(self) -> None:
        self._alone = True

    @property
    def rests(self) -> bool:
        """Whether the joints stand where they were wanted, and nothing that is ordered moves them on."""
        on = self._alone or bool((self._joints[:, POSITION] == self._wanted[:, POSITION]).all())
        still = super().rests and not self._joints[:, VELOCITY:].any()
        return on and still and not self._shaper.unsettled[self._columns].any()

    def out_of_step(self) -> tuple[FaultCode, tuple[float, float]]:
        if self.failed:
            return FaultCode.TOOL_BEYOND, self._beyond
        if not abs(float(self.state[POSITION] - self._target[POSITION])) <= self.tolerance:
            return super().out_of_step()
        # the joint that is furthest from where it was wanted
        behind = np.abs(self._joints[:, POSITION] - self._wanted[:, POSITION]) / self._model.unit
        joint = int(np.argmax(behind))
        self.column = int(self._columns[joint])
        place, speed, _ = self._wanted[joint].tolist()
        _, most, jerk, low, high = self._joint_limits[joint].tolist()
        # it brakes before an end that is not passed yet
        rest = place + 0.5 * speed * (abs(speed) / most + most / jerk)
        if not low <= rest <= high:
            return FaultCode.TOOL_BEYOND, (rest, high if rest > high else low)
        return FaultCode.OUT_OF_STEP, (self.error, self.tolerance)
