"""Convert targets of a robot's tool, poses and twists, to targets of the axes that carry it.

A pose is solved from the joints of the last one, by the solver of tool paths, so that the chain never changes
its configuration. A twist is converted to joint rates at the joints' positions, all slowed together if one
would be too fast (near a singularity) or reach the end of its travel.
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

from mcserver.machine.axis import Axis

if TYPE_CHECKING:
    # do not load the solvers for a machine without tools
    from mckinematics.solver import MachineKinematics

Array = NDArray[np.float64]

# A pose is too far away beyond this multiple of the distance that the tool moves at the joints' top speed.
REACH = 2.0
# Least time between two solutions along a line to a pose, which take milliseconds [s].
LINE_EVERY_S = 0.05
# Share of the axes' acceleration for changes of rates.
CHANGE_SHARE = 0.5
# Share of the axes' acceleration for stopping at the end of travel.
ENDING_SHARE = 0.25
# Ratio of joint speed to tool speed above which a singularity may be near (lengths over the reach).
CLEAR_GAIN = 5.0
# Ratio at which a twist towards a singularity comes to rest.
LARGEST_GAIN = 100.0


class _Carried(NamedTuple):
    """A tool that the program's axes carry.

    Attributes:
        columns: of the axes that carry it, among the program's n.
        low, high: travel of the program's axes, where they carry it within the joints' limits, shape (n,)
            [m or rad].
    """

    model: ToolModel
    columns: NDArray[np.intp]
    low: Array
    high: Array


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
        self._top = np.array([axis.max_velocity for axis in axes])
        self._acceleration = np.array([axis.max_acceleration for axis in axes])
        self._tools: dict[int, _Carried] = {}
        places = {axis.index: place for place, axis in enumerate(axes)}
        models = () if kinematics is None else map(kinematics.tool, kinematics.tools)
        for model in models:
            if all(axis in places for axis in model.chain.axes):
                self._tools[model.number] = _carried(model, axes, places)
        # last pose that counts, and one too far away until the next one confirms it
        self._last: _Solved | None = None
        self._doubtful: tuple[int, Targets] | None = None
        self._lined = -np.inf
        # rates of the program's axes after the last twist
        self._rates: Array | None = None

    def rows(self, number: int) -> int:
        """Return the count of numbers in a pose of a tool, 6 or 3; 0 if it is not one of the program's."""
        found = self._tools.get(number)
        return 0 if found is None else found.model.rows

    def forget(self) -> None:
        """Restart from the axes' positions, after they were moved otherwise."""
        self._last = self._doubtful = self._rates = None

    def poses(
        self, number: int, rows: Array, *, near: tuple[Array, Array], gap: float | None, now: float
    ) -> Array | Literal["jumped", "refused"]:
        """Return positions of the program's axes, shape (m, n), at poses of a tool, shape (m, rows).

        Args:
            near: positions of the axes, and positions to keep for those that do not carry the tool, shape
                (n,).
            gap: since the last pose [s]; None: do not test its distance.
        """
        model, columns, *_ = self._tools[number]
        here, rest = near
        last = self._last
        joints = here[columns] if last is None or last.number != number else last.joints
        places = np.tile(rest, (len(rows), 1))
        for place, row in zip(places, rows, strict=True):
            pose = _pose(row)
            target = model.target(pose)
            found = solve_near(model, target, joints)
            if gap is not None:
                # near in joints implies near for the tool
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
        """Return rates of the program's axes, shape (m, n), at poses that are passed with twists."""
        model, columns, *_ = self._tools[number]
        rates = np.zeros_like(places)
        for rate, place, twist in zip(rates, places, twists, strict=True):
            rate[columns] = _joint_rates(model, place[columns], twist, in_tool=in_tool)[0]
        return rates

    def twists(
        self, number: int, rows: Array, steps: Array, *, here: Array, share: float, in_tool: bool
    ) -> tuple[Array, bool]:
        """Return rates of the program's axes, shape (m, n), for twists of a tool, and whether it is slowed.

        Args:
            rows: shape (m, rows). steps: time to each from the one before, shape (m,) [s]. here: shape (n,).
            share: of the axes' top speed that is available.
        """
        model, columns, low, high = self._tools[number]
        self._last = self._doubtful = None
        rates = np.zeros(len(here)) if self._rates is None else self._rates
        made, slowed, place = [], False, here
        for twist, step in zip(rows, steps.tolist(), strict=True):
            # at the positions that the axes will have then
            place = place + step * rates
            wanted = np.zeros(len(here))
            wanted[columns], gain = _joint_rates(model, place[columns], twist, in_tool=in_tool)
            fit = min(_least(share * self._top, wanted), 1.0)
            room = np.where(wanted > 0.0, high - place, place - low)
            left = _least(np.maximum(room, 0.0), fit * wanted)
            if gain > CLEAR_GAIN:
                ahead = place[columns] + step * fit * wanted[columns]
                nearer = 1.0 / gain - 1.0 / _joint_rates(model, ahead, twist, in_tool=in_tool)[1]
                if gain == np.inf or nearer > 0.0:
                    # towards a singularity; the way back is free
                    left = min(left, step * max(1.0 / gain - 1.0 / LARGEST_GAIN, 0.0) / max(nearer, 1e-300))
            # one factor for all axes, so that the tool keeps its direction
            stop_s = 1.0 / _least(ENDING_SHARE * self._acceleration, fit * wanted)
            if 2.0 * left < stop_s:
                fit *= math.sqrt(2.0 * left / stop_s)
            slowed |= fit < 1.0
            change = fit * wanted - rates
            rates = rates + min(_least(CHANGE_SHARE * self._acceleration * step, change), 1.0) * change
            made.append(rates)
        self._rates = rates
        return np.array(made), slowed

    def time_to(self, places: Array, here: Array, share: float) -> Array:
        """Return the time from each place to the next at the axes' top speed, shape (m,) [s]."""
        way = np.abs(np.diff(places, axis=0, prepend=here[None]))
        taken: Array = (way / (share * self._top)).max(axis=1)
        return taken

    def _is_doubtful(self, model: ToolModel, target: Targets, joints: Array, gap: float) -> bool:
        """Return whether a pose is too far from the last one, and from a doubtful one before it."""
        number = model.number
        known = [] if self._last is None else [(self._last.number, self._last.target)]
        known += [] if self._doubtful is None else [self._doubtful]
        seen = [other for of, other in known if of == number]
        moved = np.abs(model.chain.single.linearise(joints.tolist()).columns)[:, : model.rows]
        reach = REACH * gap * (self._top[self._tools[number].columns] @ moved)
        near = not seen or any(
            bool((np.abs(pose_difference(target, other)) <= reach).all()) for other in seen
        )
        self._doubtful = None if near else (number, target)
        return not near


def _carried(model: ToolModel, axes: Sequence[Axis], places: dict[int, int]) -> _Carried:
    columns = np.array([places[axis] for axis in model.chain.axes], np.intp)
    low = np.array([axis.min_position for axis in axes])
    high = np.array([axis.max_position for axis in axes])
    low[columns] = np.maximum(low[columns], model.chain.lower)
    high[columns] = np.minimum(high[columns], model.chain.upper)
    return _Carried(model, columns, low, high)


def _joint_rates(model: ToolModel, joints: Array, twist: Array, *, in_tool: bool) -> tuple[Array, float]:
    if in_tool:
        turned = model.chain.forward(joints[None])[1][0]
        twist = (twist.reshape(-1, 3) @ turned.T).ravel()
    return joint_rates(model, joints, twist)


def _least(rooms: Array, values: Array) -> float:
    """Return the least ratio of rooms to absolute values, both shape (n,); infinite if all values are 0."""
    # for a few numbers Python floats are faster than numpy's calls
    pairs = zip(rooms.tolist(), values.tolist(), strict=True)
    return min((room / abs(value) for room, value in pairs if value), default=math.inf)


def _pose(row: Array) -> Pose:
    x, y, z, *angles = row.tolist()
    a, b, c = angles or (0.0, 0.0, 0.0)
    return Pose((x, y, z), (a, b, c))
