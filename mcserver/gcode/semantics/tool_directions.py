"""Find positions of two rotary axes at which the tool points in a direction (D-111, D-140)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from mckinematics.chain import Chain
from mckinematics.errors import JointLimit, Unreachable
from mckinematics.pose import Array
from mckinematics.tip_control import TipControl
from mckinematics.tool_direction import turns_towards

from mcserver.units import DEGREE, TURN

# distances closer than this are equal; a position farther than this beyond a limit is refused [rad]
_EQUAL = 1e-9
_HINT = "clamp the work piece otherwise, or mill it from another side"

Pair = tuple[float, float]


def turns_along(control: TipControl, direction: Array, near: Array) -> Array:
    """Return the positions of the rotary axes that Fanuc's controllers choose, within the travel.

    They minimize the distance, first of the axis that carries the other, and of the table before the head;
    then the distance to whole turns, in the same order; of equal ones, the larger angle.

    Args:
        direction: shape (3,), of the tool's Z in the chain's base; of any length.
        near: shape (2,), present positions of the axes [rad].

    Returns:
        Shape (2,), in the chain's order [rad].

    Raises:
        KinematicsError: there are none, or the tool does not have two rotary axes that are not parallel.
    """
    chain = control.tool.chain
    pairs = turns_towards(chain, direction / np.linalg.norm(direction), near)
    if not pairs:
        raise Unreachable("no position of the rotary axes has the tool point there", _HINT)
    turning = [int(column) for column in control.turning]
    order = (1, 0) if all(column < chain.carried for column in turning) else (0, 1)
    lower, upper = chain.lower[turning] - _EQUAL, chain.upper[turning] + _EQUAL
    found = [
        (pair[0] + (first + a) * TURN, pair[1] + (second + b) * TURN)
        for pair in pairs
        for first, second in [np.rint((near - pair) / TURN).tolist()]
        for a, b in itertools.product((0, -1, 1), repeat=2)
    ]
    inside = [pair for pair in found if bool(np.all((lower <= pair) & (pair <= upper)))]
    if not inside:
        raise _beyond(chain, turning, pairs)

    def rank(pair: Pair) -> tuple[int, ...]:
        ways = [abs(pair[at] - near[at]) for at in order]
        angles = [abs(pair[at] - TURN * round(pair[at] / TURN)) for at in order]
        return tuple(round(each / _EQUAL) for each in (*ways, *angles, *(-pair[at] for at in order)))

    return np.array(min(inside, key=rank))


def _beyond(chain: Chain, turning: Sequence[int], pairs: Sequence[Pair]) -> JointLimit:
    """Return the refusal of positions that are all beyond the travel, naming the axes."""
    places: dict[str, int] = {}
    for pair in pairs:
        for column, turn in zip(turning, pair, strict=True):
            least, most = float(chain.lower[column]), float(chain.upper[column])
            if any(least - _EQUAL <= turn + each * TURN <= most + _EQUAL for each in (-1, 0, 1)):
                continue
            limit, axis = (least if turn < least else most) / DEGREE, chain.axes[column]
            places[f"axis {axis} at {turn / DEGREE:.3f}°, whose limit is {limit:.3f}°"] = axis
    shown = f"the tool points there with rotary axes beyond their travel alone: {' or '.join(places)}"
    return JointLimit(shown, _HINT, axis=next(iter(places.values())))
