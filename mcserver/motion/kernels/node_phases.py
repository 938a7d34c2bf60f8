"""Turn speeds at nodes of a path into phases of constant jerk, and check that these keep all limits."""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.sample_limits import TINY

# Tolerances of phases: shares of F, and of the axes' acceleration and jerk. Samples of an arc miss the
# greatest speed of an axis by up to 0.0003.
PHASE_LIMITS = (1.0006, 1.003, 1.035)
# Share of the speed limits by curvature, which leave a margin for acceleration.
PHASE_SPEED = 1.01
# Fewest and most Newton steps for the time from node to node, and their tolerance as a share of the distance.
NEWTON, SAME_PLACE = (4, 30), 1e-12
# Most corrections of the speed at the end, and their tolerance as a share of the speed.
SPREADS, SAME_SPEED = 12, 1e-12

# Columns of a node's demand for each axis: |q'|, |q''|, |q'''| and steps of q''.
SLOPE, BEND, TWIST, STEP = range(4)


@compiled
def _drive(nodes: Array, acceleration: Array, speed: float, phases: Array) -> float:
    """Write phases from node to node, with acceleration linear in time; return the speed at the end.

    NaN where a node is not reached.
    """
    for i in range(len(nodes) - 1):
        far, a0, a1 = nodes[i + 1] - nodes[i], acceleration[i], acceleration[i + 1]
        t = far / max(speed, TINY)
        for step in range(NEWTON[1] + 1):
            beyond = t * (speed + t * (2.0 * a0 + a1) / 6.0) - far
            if step >= NEWTON[0] and abs(beyond) <= SAME_PLACE * far:
                break
            t -= beyond / max(speed + t * (2.0 * a0 + a1) / 3.0, TINY)
        else:
            return math.nan
        phases[i, 0], phases[i, 1], phases[i, 2] = t, nodes[i], speed
        phases[i, 3], phases[i, 4] = a0, (a1 - a0) / t
        speed += 0.5 * t * (a0 + a1)
    return speed


@compiled
def to_phases(nodes: Array, b: Array, accelerations: tuple[float, float], phases: Array) -> bool:
    """Write phases of constant jerk from node to node.

    The accelerations at inner nodes are those of b, those at both ends are given. The small error of the
    speed at the end is spread over all phases.

    Returns:
        False where that does not converge.
    """
    count = len(b)
    last = count - 1
    acceleration, spread = np.zeros(count), np.zeros(count)
    acceleration[0], acceleration[last] = accelerations
    for i in range(1, last):
        # weighted so that the sum over intervals is the change of b
        acceleration[i] = 0.5 * (b[i + 1] - b[i - 1]) / (nodes[i + 1] - nodes[i - 1])
        share = i / last
        spread[i] = share * share * (1.0 - share) * (1.0 - share)
    start, end = math.sqrt(b[0]), math.sqrt(b[last])
    lacks = end - _drive(nodes, acceleration, start, phases)
    part = lacks / (spread.sum() * phases[:, 0].mean())
    for _ in range(SPREADS):
        for i in range(1, last):
            acceleration[i] += part * spread[i]
        before, lacks = lacks, end - _drive(nodes, acceleration, start, phases)
        if abs(lacks) <= SAME_SPEED * end:
            return True
        if before == lacks or math.isnan(lacks):
            return False
        part *= lacks / (before - lacks)
    return False


@compiled
def exceed_limits(
    phases: Array, demand: Array, cap: Array, fed: Array, limits: Array, step_jerk: float, over: Array
) -> bool:
    """Return whether phases exceed a limit: at either end, in the middle, or where speed turns inside.

    Args:
        over: written, the greatest shares of its limits of speed, acceleration and jerk that each phase
            takes, shape (n, 3); more than 1 exceeds the limit.
    """
    over[:] = 0.0
    for i in range(len(phases)):
        duration, jerk = phases[i, 0], abs(phases[i, 4])
        # each node's demand covers the path up to the nodes next to it
        top = min(PHASE_SPEED * math.sqrt(max(cap[i], cap[i + 1])), PHASE_LIMITS[0] * max(fed[i], fed[i + 1]))
        # speed has an extreme where acceleration passes zero
        turn = phases[i, 3] / -phases[i, 4] if jerk > TINY else 0.0
        for x in (0.0, 0.5 * duration, duration, min(max(turn, 0.0), duration)):
            v = phases[i, 2] + x * (phases[i, 3] + 0.5 * x * phases[i, 4])
            a = abs(phases[i, 3] + x * phases[i, 4])
            if not v > 0.0:
                return True
            over[i, 0] = max(over[i, 0], v / top)
            for k in range(limits.shape[1]):
                d1 = min(demand[i, SLOPE, k], demand[i + 1, SLOPE, k])
                d2 = min(demand[i, BEND, k], demand[i + 1, BEND, k])
                d3 = min(demand[i, TWIST, k], demand[i + 1, TWIST, k])
                step = min(demand[i, STEP, k], demand[i + 1, STEP, k])
                over[i, 0] = max(over[i, 0], d1 * v / (PHASE_LIMITS[0] * limits[0, k]))
                over[i, 1] = max(over[i, 1], (d1 * a + d2 * v * v) / (PHASE_LIMITS[1] * limits[1, k]))
                asked = d1 * jerk + 3.0 * d2 * v * a + d3 * v * v * v + step * step_jerk * v * v
                over[i, 2] = max(over[i, 2], asked / (PHASE_LIMITS[2] * limits[2, k]))
    return bool(over.max() > 1.0)
