"""Time-optimal speed along a path of changing curvature, with acceleration wherever the limits leave it.

With b = v² as a function of the path coordinate σ, v̇ = b'/2 and v̈ = √b·b''/2, and an axis needs
|q''|·b + |q'|·|b'|/2 of its acceleration and √b·(|q'''|·b + 3/2·|q''|·|b'| + |q'|·|b''|/2) of its jerk. b is
found at nodes by an interior-point method: Newton's on ∫ dσ/√b with a logarithmic barrier for each limit,
which is banded, as a node's limits involve its neighbours only. Speed and acceleration at both ends are
given. The result is turned into phases of constant jerk, and these are checked against all limits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.node_phases import BEND, SLOPE, STEP, TWIST, exceed_limits, to_phases
from mcserver.motion.kernels.phases import PHASE
from mcserver.motion.kernels.sample_limits import Run

# Node spacing as a share of the shortest rise of acceleration, and its bounds [s]: wider spacing is farther
# from the optimum, and each node takes some 10 µs.
NODE_SHARE, NODES_APART = 0.2, (1e-3, 8e-3)
# Share of the speed limit that nodes may take: between nodes speed is higher.
NODE_SPEED = 0.9985
# Where phases exceed a limit between nodes, the limits of the nodes next to them are lowered by as much,
# times this,
LESS = 0.995
# at most so many times,
TIGHTENED = 8
# and the search starts again from the speeds found, lowered by this share.
LOWERED = 0.03
# Nodes from an end, which may be at its speed limit, over which the margin of `NODE_SPEED` grows.
MARGIN_NODES = 10.0
# Weight of the barrier, as a share of the time / the number of limits: the first one, its factor per round,
# and the last one, which bounds the distance to the optimum.
FIRST_WEIGHT, WEIGHT_FALL, LAST_WEIGHT = 4.0, 0.2, 0.004
# Newton steps of a round, halvings of one step, and steps in all.
STEPS, HALVINGS, MOST_STEPS = 3, 30, 60
# Limits are eased at first so that the start is feasible, by this factor beyond what it needs,
EASE = 1.05
# until all demands are below this share of the true limits,
WITHIN = 0.9999
# for at most so many steps.
MOST_EASED = 20
# A step that changes no speed by more than this share ends its round.
SETTLED = 1e-4
# A group with at least so many samples may be an arc of more than a turn, sampled on one turn only.
WHOLE_TURNS = 129
# A path is not solved again where its time is within this factor of the time at its speed limits.
WORTH = 1.005


class _Nodes(NamedTuple):
    """Nodes of a path, and the limits of b there.

    Attributes:
        places: along σ, shape (m,). demand: greatest |q'|, |q''|, |q'''| and steps of q'' around each node,
            shape (m, 4, K). cap: greatest b, shape (m,).
        limits: of the axes, shape (3, K). room: shares of the limits of speed, acceleration and jerk that
            each node may take, shape (m, 3). step_jerk: jerk that a step of acceleration within a cycle is
            equivalent to at the cycle rate, see `free_at` [1/s].
        first, second: finite differences for b' and b'': weights of b at the nodes before, at and after each
            one, and a constant, shape (m, 4).
    """

    places: Array
    demand: Array
    cap: Array
    limits: Array
    room: Array
    step_jerk: float
    first: Array
    second: Array


@compiled
def _gather(
    run: Run,
    edges: Array,
    spans: Array,
    feed: Array,
    left: int,
    right: int,
    nodes: Array,
    demand: Array,
    cap: Array,
    fed: Array,
) -> bool:
    """Write the greatest demand around each node, up to the nodes next to it.

    Args:
        spans: positions of samples, shape (n, 4): σ of the first one, distance along σ to the last, number of
            evenly spaced ones, 0 where all samples count for the whole group, and 1 where a vertex at the
            start has its sample after them. feed: the groups' speeds by F, shape (n,).
        nodes: along σ, shape (m,), from the edge ``left`` to the edge ``right``.
        demand: written, shape (m, 4, K), |q'|, |q''|, |q'''| and steps of q''. cap: written, the greatest
            b, shape (m,). fed: written, the speed by F, shape (m,).

    Returns:
        False where there is a vertex, which this method does not handle.
    """
    width = run.limits.shape[1]
    demand[:] = 0.0
    cap[:] = math.inf
    fed[:] = math.inf
    node = 0
    for group in range(left, right):
        low, high = edges[group], edges[group + 1]
        # the nodes whose surroundings touch the group
        while node > 0 and nodes[node] >= low:
            node -= 1
        first = node
        while node < len(nodes) - 1 and nodes[node] <= high:
            node += 1
        for at in range(first, node + 1):
            fed[at] = min(fed[at], feed[group])
        count = run.offset[group + 1] - run.offset[group]
        start, length, own = spans[group, 0], spans[group, 1], int(spans[group, 2])
        spread = 1 < own < WHOLE_TURNS
        for i in range(count):
            row = run.rows[run.offset[group] + i]
            begin, end = first, node
            if spread:
                # a sample counts for all nodes up to the samples next to it, and the nodes beyond; that of a
                # vertex for the nodes at its end of the group
                before = start + length * max(i - 1, 0) / (own - 1)
                behind = start + length * min(i + 1, own - 1) / (own - 1)
                if i >= own:
                    before = behind = low if i - own < spans[group, 3] else high
                elif before >= high or behind <= low:
                    # on a part that was trimmed away
                    continue
                while begin < node and nodes[begin + 1] < before:
                    begin += 1
                while end > begin and nodes[end - 1] > behind:
                    end -= 1
            top = min(run.sample_vmax[run.offset[group] + i], run.segment_vmax[group]) ** 2
            for at in range(begin, end + 1):
                cap[at] = min(cap[at], top)
                for k in range(width):
                    if row[3 * width + k] > 0.0:
                        return False
                    demand[at, 0, k] = max(demand[at, 0, k], row[k])
                    demand[at, 1, k] = max(demand[at, 1, k], row[width + k])
                    demand[at, 2, k] = max(demand[at, 2, k], row[2 * width + k])
                    demand[at, 3, k] = max(demand[at, 3, k], row[4 * width + k])
    for at in range(len(nodes)):
        cap[at] = min(cap[at], fed[at] ** 2)
    return True


@compiled
def _stencils(nodes: Array, steepness: tuple[float, float], first: Array, second: Array) -> None:
    """Write `_Nodes.first` and ``second``.

    Args:
        steepness: b' at both ends, which is given.
    """
    last = len(nodes) - 1
    first[:], second[:] = 0.0, 0.0
    for i in range(1, last):
        before, after = nodes[i] - nodes[i - 1], nodes[i + 1] - nodes[i]
        both = before + after
        first[i, 0], first[i, 2] = -after / (before * both), before / (after * both)
        first[i, 1] = -first[i, 0] - first[i, 2]
        second[i, 0], second[i, 2] = 2.0 / (before * both), 2.0 / (after * both)
        second[i, 1] = -second[i, 0] - second[i, 2]
    # at an end, the parabola through the two nodes with the given slope
    start, end = nodes[1] - nodes[0], nodes[last] - nodes[last - 1]
    first[0, 3], first[last, 3] = steepness[0], steepness[1]
    second[0, 2], second[last, 0] = 2.0 / start**2, 2.0 / end**2
    second[0, 1], second[last, 1] = -second[0, 2], -second[last, 0]
    second[0, 3], second[last, 3] = -2.0 * steepness[0] / start, 2.0 * steepness[1] / end


@compiled
def _derivative(weights: Array, b: Array, i: int) -> float:
    """Return b' or b'' at a node."""
    low, high = b[max(i - 1, 0)], b[min(i + 1, len(b) - 1)]
    return float(weights[i, 0] * low + weights[i, 1] * b[i] + weights[i, 2] * high + weights[i, 3])


@compiled
def _merit(b: Array, nodes: _Nodes, ease: float, weight: float) -> tuple[float, float]:
    """Return the time plus its barrier, infinite beyond a limit, and the greatest share of a limit."""
    places, demand, cap, limits, room, step_jerk, first, second = nodes
    total, worst = 0.0, 0.0
    last = len(b) - 1
    width = limits.shape[1]
    for i in range(last + 1):
        if not b[i] > 0.0:
            return math.inf, math.inf
        root = math.sqrt(b[i])
        if i > 0:
            total += 2.0 * (places[i] - places[i - 1]) / (root + math.sqrt(b[i - 1]))
        slope, bend = abs(_derivative(first, b, i)), abs(_derivative(second, b, i))
        product = 1.0
        if 0 < i < last:
            share = b[i] / cap[i]
            worst = max(worst, share)
            if share >= ease:
                return math.inf, math.inf
            product *= ease - share
        for k in range(width):
            d1, d2 = demand[i, SLOPE, k], demand[i, BEND, k]
            if d1 == 0.0 and d2 == 0.0:
                continue
            most = limits[1, k] * room[i, 1]
            taken, change = d2 * b[i] / most, 0.5 * d1 * slope / most
            worst = max(worst, taken + change)
            if taken + change >= ease:
                return math.inf, math.inf
            product *= (ease - taken - change) * (ease - taken + change)
            unit = root / (limits[2, k] * room[i, 2])
            own = unit * b[i] * (demand[i, TWIST, k] + demand[i, STEP, k] * step_jerk / root)
            turn, push = 1.5 * unit * d2 * slope, 0.5 * unit * d1 * bend
            worst = max(worst, own + turn + push)
            if own + turn + push >= ease:
                return math.inf, math.inf
            product *= (ease - own - turn - push) * (ease - own - turn + push)
            product *= (ease - own + turn - push) * (ease - own + turn + push)
            if weight > 0.0:
                total -= weight * math.log(product)
            product = 1.0
        if weight > 0.0:
            total -= weight * math.log(product)
    return total, worst


@compiled
def _add_barrier(
    i: int, slack: float, weight: float, by0: float, by1: float, by2: float, gradient: Array, band: Array
) -> None:
    """Add -w·log(slack) to the model at node i, given how slack falls with b at the nodes around i."""
    pull = weight / slack
    curve = pull / slack
    last = len(gradient) - 1
    gradient[i] += pull * by1
    band[i, 0] += curve * by1 * by1
    if i > 0:
        gradient[i - 1] += pull * by0
        band[i - 1, 0] += curve * by0 * by0
        band[i - 1, 1] += curve * by0 * by1
    if i < last:
        gradient[i + 1] += pull * by2
        band[i + 1, 0] += curve * by2 * by2
        band[i, 1] += curve * by1 * by2
    if 0 < i < last:
        band[i - 1, 2] += curve * by0 * by2


@compiled
def _model(b: Array, nodes: _Nodes, ease: float, weight: float, gradient: Array, band: Array) -> None:
    """Write gradient (m,) and Hessian, as its three diagonals (m, 3), of `_merit`."""
    places, demand, cap, limits, room, step_jerk, first, second = nodes
    gradient[:] = 0.0
    band[:] = 0.0
    last = len(b) - 1
    width = limits.shape[1]
    for i in range(last + 1):
        root = math.sqrt(b[i])
        if 0 < i < last:
            # the node's part of the integral ∫ dσ/√b
            apart = 0.5 * (places[i + 1] - places[i - 1])
            gradient[i] -= 0.5 * apart / (b[i] * root)
            band[i, 0] += 0.75 * apart / (b[i] * b[i] * root)
            _add_barrier(i, ease - b[i] / cap[i], weight, 0.0, 1.0 / cap[i], 0.0, gradient, band)
        slope, bend = _derivative(first, b, i), _derivative(second, b, i)
        for k in range(width):
            d1, d2 = demand[i, SLOPE, k], demand[i, BEND, k]
            if d1 == 0.0 and d2 == 0.0:
                continue
            most = limits[1, k] * room[i, 1]
            for sign in (1.0, -1.0):
                part = sign * 0.5 * d1 / most
                slack = ease - d2 * b[i] / most - part * slope
                _add_barrier(
                    i,
                    slack,
                    weight,
                    part * first[i, 0],
                    d2 / most + part * first[i, 1],
                    part * first[i, 2],
                    gradient,
                    band,
                )
            unit = root / (limits[2, k] * room[i, 2])
            own = unit * b[i] * (demand[i, TWIST, k] + demand[i, STEP, k] * step_jerk / root)
            rise = unit * (1.5 * demand[i, TWIST, k] + demand[i, STEP, k] * step_jerk / root)
            for sign in (1.0, -1.0):
                for other in (1.0, -1.0):
                    turn, push = sign * 1.5 * unit * d2, other * 0.5 * unit * d1
                    change = turn * slope + push * bend
                    _add_barrier(
                        i,
                        ease - own - change,
                        weight,
                        turn * first[i, 0] + push * second[i, 0],
                        rise + 0.5 * change / b[i] + turn * first[i, 1] + push * second[i, 1],
                        turn * first[i, 2] + push * second[i, 2],
                        gradient,
                        band,
                    )


@compiled
def _solve_band(band: Array, right: Array) -> bool:
    """Solve a symmetric pentadiagonal system in place, without its first and last row.

    Args:
        band: the diagonal and two beside it, shape (m, 3); overwritten. right: right side, shape (m,);
            overwritten by the solution.

    Returns:
        False where the matrix is not positive definite.
    """
    last = len(right) - 2
    # L·D·Lᵀ, rows from 1 to last
    for i in range(1, last + 1):
        if i >= 2:
            band[i, 0] -= band[i - 1, 1] ** 2 * band[i - 1, 0]
            if i < last:
                band[i, 1] -= band[i - 1, 1] * band[i - 1, 0] * band[i - 1, 2]
            right[i] -= band[i - 1, 1] * right[i - 1]
        if i >= 3:
            band[i, 0] -= band[i - 2, 2] ** 2 * band[i - 2, 0]
            right[i] -= band[i - 2, 2] * right[i - 2]
        if not band[i, 0] > 0.0:
            return False
        band[i, 1] = band[i, 1] / band[i, 0] if i < last else 0.0
        band[i, 2] = band[i, 2] / band[i, 0] if i < last - 1 else 0.0
    for i in range(last, 0, -1):
        right[i] /= band[i, 0]
        if i < last:
            right[i] -= band[i, 1] * right[i + 1]
        if i < last - 1:
            right[i] -= band[i, 2] * right[i + 2]
    return True


@compiled
def _minimize(b: Array, nodes: _Nodes) -> bool:
    """Change b to the fastest one within the limits; return False where none was found."""
    count, width = len(b), nodes.limits.shape[1]
    gradient, band = np.empty(count), np.empty((count, 3))
    trial = b.copy()
    huge = 1e30
    merit, worst = _merit(b, nodes, huge, 0.0)
    share = merit / (count * (6 * width + 1))
    ease = max(1.0, EASE * worst)
    weight = FIRST_WEIGHT
    for step in range(MOST_STEPS):
        barrier = weight * share
        merit, _ = _merit(b, nodes, ease, barrier)
        _model(b, nodes, ease, barrier, gradient, band)
        if not _solve_band(band, gradient):
            return False
        length, moved = 1.0, 0.0
        for _ in range(HALVINGS):
            moved = 0.0
            for i in range(1, count - 1):
                trial[i] = b[i] - length * gradient[i]
                moved = max(moved, abs(trial[i] - b[i]) / b[i])
            now, most = _merit(trial, nodes, ease, barrier)
            if now < merit:
                b[:] = trial
                worst = most
                break
            length *= 0.5
        if ease > 1.0:
            # the barrier moves b away from the eased limits until it is within the true ones
            if worst < WITHIN:
                ease = 1.0
            elif step > MOST_EASED:
                return False
            continue
        if moved < SETTLED or length < 0.5**HALVINGS * 1.5 or step % STEPS == STEPS - 1:
            if weight <= LAST_WEIGHT:
                return bool(worst <= 1.0)
            weight = max(weight * WEIGHT_FALL, LAST_WEIGHT)
    return False


@compiled
def quicker_phases(
    run: Run,
    edges: Array,
    spans: Array,
    feed: Array,
    left: int,
    right: int,
    nodes: Array,
    speeds: Array,
    accelerations: tuple[float, float],
) -> tuple[Array, bool]:
    """Return phases from the edge ``left`` to the edge ``right`` that take less time than those given.

    Args:
        spans, feed: see `_gather`. nodes, speeds: places along σ from edge to edge and initial speeds there,
            shape (m,), m ≥ 5; speeds above 0.

    Returns:
        Rows of `mcserver.motion.kernels.phases`, none where no faster profile within all limits was found;
        and whether one was searched for, which it is not with a vertex or next to nothing to gain.
    """
    count, width = len(nodes), run.limits.shape[1]
    demand, cap, fed = np.empty((count, 4, width)), np.empty(count), np.empty(count)
    nothing = np.empty((0, PHASE))
    if not _gather(run, edges, spans, feed, left, right, nodes, demand, cap, fed):
        return nothing, False
    if demand[:, BEND].max() == 0.0:
        # a straight line has constant limits
        return nothing, False
    time = least = 0.0
    for i in range(count - 1):
        apart = nodes[i + 1] - nodes[i]
        time += 2.0 * apart / (speeds[i] + speeds[i + 1])
        least += apart / math.sqrt(min(cap[i], cap[i + 1]))
    if not time > least * WORTH:
        return nothing, False
    first, second = np.empty((count, 4)), np.empty((count, 4))
    _stencils(nodes, (2.0 * accelerations[0], 2.0 * accelerations[1]), first, second)
    step_jerk = 0.75 / run.cycle
    phases, lower = np.empty((count - 1, PHASE)), np.empty(count)
    over, room = np.empty((count - 1, 3)), np.ones((count, 3))
    bounded = _Nodes(nodes, demand, lower, run.limits, room, step_jerk, first, second)
    b = speeds * speeds
    for _ in range(TIGHTENED):
        for i in range(count):
            # an end may be at its speed limit: the margin grows gradually from there
            part = min(1.0, (min(i, count - 1 - i) / MARGIN_NODES) ** 2)
            lower[i] = cap[i] * (1.0 - (1.0 - (NODE_SPEED * room[i, 0]) ** 2) * part)
        found = _minimize(b, bounded)
        if not found or not to_phases(nodes, b, accelerations, phases) or not phases[:, 0].sum() < time:
            break
        if not exceed_limits(phases, demand, cap, fed, run.limits, step_jerk, over):
            return phases, True
        for i in range(count):
            for which in range(3):
                share = max(over[max(i - 1, 0), which], over[min(i, count - 2), which])
                if share > 1.0:
                    room[i, which] *= LESS / share
            b[i] *= 1.0 - LOWERED * min(1.0, (min(i, count - 1 - i) / MARGIN_NODES) ** 2)
    return nothing, True
