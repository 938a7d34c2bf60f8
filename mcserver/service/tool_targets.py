"""Targets of a robot's tool, poses and twists, as targets of the axes that carry it.

A pose is solved from where the last one left the joints, by the solver of tool paths, so that the chain never
changes over to another configuration. A twist becomes rates of the joints where they are, all slowed together
where one of them would be too fast (near a singular position) or comes to the end of its travel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from mckinematics.next_pose import joint_rates, solve_along_line, solve_near
from mckinematics.pose import Pose
from mckinematics.tool import Targets, ToolModel, pose_difference
from numpy.typing import NDArray

from mcserver.machine.machine_file import Axis

if TYPE_CHECKING:
    # a machine without tools starts without its solvers
    from mckinematics.solver import MachineKinematics

Array = NDArray[np.float64]

# A pose is too far off above this share of what the tool goes at the top speed of its joints.
REACH = 2.0
# Least time between two poses that are looked for along a line to them: that takes milliseconds [s].
LINE_EVERY_S = 0.05
# Share of the axes' acceleration with which rates change and axes come to the end of their travel.
CHANGE_SHARE, ENDING_SHARE = 0.5, 0.25
# Where joints are so many times as fast as the tool a singular position may be near (lengths over the reach);
# a twist towards it comes to rest at the latter.
CLEAR_GAIN, LARGEST_GAIN = 5.0, 100.0


class _Solved(NamedTuple):
    number: int
    target: Targets
    joints: Array


class ToolTargets:
    """Tools of one program.

    Args:
        kinematics: of the machine; None: it has no tools. axes: of the program, in order.
    """

    def __init__(self, kinematics: MachineKinematics | None, axes: Sequence[Axis]) -> None:
        self._kinematics = kinematics
        self._places = {axis.index: place for place, axis in enumerate(axes)}
        self._top = np.array([axis.max_velocity for axis in axes])
        self._acceleration = np.array([axis.max_acceleration for axis in axes])
        self._low = np.array([axis.min_position for axis in axes])
        self._high = np.array([axis.max_position for axis in axes])
        # the last pose that counts, and one too far off until the next one confirms it
        self._last: _Solved | None = None
        self._doubtful: tuple[int, Targets] | None = None
        self._lined = -np.inf
        # rates of the program's axes as of the last twist
        self._rates: Array | None = None

    def rows(self, number: int) -> int:
        """Numbers that a pose of a tool has: 6 or 3; 0: it is none of the program's."""
        found = self._model(number)
        return 0 if found is None else found.rows

    def forget(self) -> None:
        """Begin anew where the axes are: they were led otherwise."""
        self._last = self._doubtful = self._rates = None

    def poses(
        self, number: int, rows: Array, *, near: tuple[Array, Array], gap: float | None, now: float
    ) -> Array | Literal["jumped", "refused"]:
        """Return positions of the program's axes, shape (m, n), at poses of a tool, shape (m, rows).

        Args:
            near: where the axes are, and where those that do not carry the tool stay, shape (n,) each.
            gap: since the last pose [s]; None: it is not doubted.
        """
        model = self._model(number)
        assert model is not None
        here, rest = near
        columns = self._columns(model)
        last = self._last
        joints = here[columns] if last is None or last.number != number else last.joints
        places = np.tile(rest, (len(rows), 1))
        for place, row in zip(places, rows, strict=True):
            pose = _pose(row)
            target = model.target(pose)
            found = solve_near(model, target, joints)
            if gap is not None:
                # what is near for the joints is near for the tool
                close = (
                    found is not None and (np.abs(found - joints) <= REACH * gap * self._top[columns]).all()
                )
                if not close and self._is_doubtful(model, target, joints, gap):
                    return "jumped"
            if found is None and now - self._lined >= LINE_EVERY_S:
                self._lined = now
                found = solve_along_line(model, pose, joints)
            if found is None:
                return "refused"
            self._doubtful = None
            joints = place[columns] = found
        self._last, self._rates = _Solved(number, target, joints), None
        return places

    def rates_at(self, number: int, places: Array, twists: Array, *, in_tool: bool) -> Array:
        """Return rates of the program's axes, shape (m, n), behind poses that are passed at twists."""
        model = self._model(number)
        assert model is not None
        columns = self._columns(model)
        rates = np.zeros_like(places)
        for rate, place, twist in zip(rates, places, twists, strict=True):
            rate[columns] = _joint_rates(model, place[columns], twist, in_tool=in_tool)[0]
        return rates

    def twists(
        self, number: int, rows: Array, steps: Array, *, here: Array, share: float, in_tool: bool
    ) -> tuple[Array, bool]:
        """Return rates of the program's axes, shape (m, n), for twists of a tool, and whether it is slower.

        Args:
            rows: shape (m, rows). steps: time from each to the next one, shape (m,) [s]. here: shape (n,).
            share: of the axes' top speed that is left.
        """
        model = self._model(number)
        assert model is not None
        columns = self._columns(model)
        self._last = self._doubtful = None
        rates = np.zeros(len(here)) if self._rates is None else self._rates
        made, slowed, place = [], False, here
        low, high = self._low.copy(), self._high.copy()
        # the joints' own limits may be nearer
        low[columns], high[columns] = model.chain.lower, model.chain.upper
        for twist, step in zip(rows, steps, strict=True):
            # as they are to be where the axes will be then
            place = place + step * rates
            wanted = np.zeros(len(here))
            wanted[columns], gain = _joint_rates(model, place[columns], twist, in_tool=in_tool)
            fit = _share(wanted, share * self._top)
            left = _time_left(fit * wanted, place, low, high)
            if gain > CLEAR_GAIN:
                ahead = place[columns] + step * fit * wanted[columns]
                nearer = 1.0 / gain - 1.0 / _joint_rates(model, ahead, twist, in_tool=in_tool)[1]
                if gain == np.inf or nearer > 0.0:
                    # on the way to a singular position; the way back is free
                    left = min(left, step * max(1.0 / gain - 1.0 / LARGEST_GAIN, 0.0) / max(nearer, 1e-300))
            # of all axes together, so that the tool stays on its way
            stop_s = float((np.abs(fit * wanted) / (ENDING_SHARE * self._acceleration)).max())
            if 2.0 * left < stop_s:
                fit *= math.sqrt(2.0 * left / stop_s)
            slowed |= fit < 1.0
            change = fit * wanted - rates
            rates = rates + _share(change, CHANGE_SHARE * self._acceleration * step) * change
            made.append(rates)
        self._rates = rates
        return np.array(made), slowed

    def time_to(self, places: Array, here: Array, share: float) -> Array:
        """Return what the axes take from each place to the next at their top speed, shape (m,) [s]."""
        way = np.abs(np.diff(places, axis=0, prepend=here[None]))
        taken: Array = (way / (share * self._top)).max(axis=1)
        return taken

    def _model(self, number: int) -> ToolModel | None:
        """Return a tool whose axes are all of the program."""
        if self._kinematics is None or number not in self._kinematics.tools:
            return None
        model = self._kinematics.tool(number)
        return model if all(axis in self._places for axis in model.chain.axes) else None

    def _columns(self, model: ToolModel) -> list[int]:
        return [self._places[axis] for axis in model.chain.axes]

    def _is_doubtful(self, model: ToolModel, target: Targets, joints: Array, gap: float) -> bool:
        """Return whether a pose is too far from the last one, and none before it was there either."""
        number = model.number
        known = [] if self._last is None else [(self._last.number, self._last.target)]
        known += [] if self._doubtful is None else [self._doubtful]
        seen = [other for of, other in known if of == number]
        columns = np.abs(model.chain.single.linearise(joints.tolist()).columns)[:, : model.rows]
        reach = REACH * gap * (self._top[self._columns(model)] @ columns)
        near = not seen or any(
            bool((np.abs(pose_difference(target, other)) <= reach).all()) for other in seen
        )
        self._doubtful = None if near else (number, target)
        return not near


def _joint_rates(model: ToolModel, joints: Array, twist: Array, *, in_tool: bool) -> tuple[Array, float]:
    if in_tool:
        turned = model.chain.forward(joints[None])[1][0]
        twist = (twist.reshape(-1, 3) @ turned.T).ravel()
    return joint_rates(model, joints, twist)


def _time_left(rates: Array, place: Array, low: Array, high: Array) -> float:
    """Return after which time the first axis is at the end of its travel [s]."""
    left = np.where(rates > 0.0, high - place, place - low)
    moving = np.abs(rates) > 0.0
    return float((np.maximum(left[moving], 0.0) / np.abs(rates[moving])).min(initial=np.inf))


def _share(values: Array, most: Array) -> float:
    """Return the share of all values with which none passes its bound."""
    moving = np.abs(values) > most
    return float((most[moving] / np.abs(values[moving])).min(initial=1.0))


def _pose(row: Array) -> Pose:
    x, y, z, *angles = row.tolist()
    a, b, c = angles or (0.0, 0.0, 0.0)
    return Pose((x, y, z), (a, b, c))
