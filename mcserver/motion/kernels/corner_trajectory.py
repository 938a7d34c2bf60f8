"""Trajectories of the axes around a corner: states by time, and deviation from the programmed path."""

from __future__ import annotations

import math

import numpy as np

from mcserver.motion.geometry.curves import Array
from mcserver.motion.kernels.compiled import compiled
from mcserver.motion.kernels.straight_corner import max_distance_to_polyline

# Evenly spaced times at which positions are checked.
SAMPLES = 65
# Evenly spaced times at which speeds are checked.
SPEED_SAMPLES = 257
# Margin for the greatest distance of a line, which may be between its points.
POINTS = 1.001
# Tolerances for rounding: of a speed [1], and of a position [m].
FASTER = 1.0 + 1e-6
SLACK = 1e-9
# Steps into which each of two straight lines is divided to measure distances.
STEPS_PER_LINE = 12


@compiled
def evaluate_trajectories(trajectories: Array, times: Array, found: Array) -> None:
    """Write position and its first three derivatives by time at given times [s].

    Args:
        trajectories: phases of constant jerk of K axes: when they begin, position, velocity, acceleration and
            jerk then, shape (K, n, 5). times: shape (m,). found: shape (4, m, K).
    """
    for k in range(len(trajectories)):
        for i in range(len(times)):
            phase = 0
            for n in range(1, trajectories.shape[1]):
                if trajectories[k, n, 0] <= times[i]:
                    phase = n
            x = times[i] - trajectories[k, phase, 0]
            p, v = trajectories[k, phase, 1], trajectories[k, phase, 2]
            a, j = trajectories[k, phase, 3], trajectories[k, phase, 4]
            found[0, i, k] = p + x * (v + x * (a / 2.0 + x * j / 6.0))
            found[1, i, k] = v + x * (a + x * j / 2.0)
            found[2, i, k] = a + x * j
            found[3, i, k] = j


@compiled
def _distance(position: Array, place: Array, weights: Array) -> float:
    total = 0.0
    for k in range(len(place)):
        total += ((position[k] - place[k]) * weights[k]) ** 2
    return math.sqrt(total)


@compiled
def _extent(phases: Array, duration: float) -> tuple[float, float, float]:
    """Return the least and greatest position of one axis, and its greatest speed in either direction.

    Args:
        phases: of `evaluate_trajectories`, shape (n, 5).
    """
    low, high, fastest = math.inf, -math.inf, 0.0
    turns = np.empty(5)
    for n in range(len(phases)):
        start, p, v = phases[n, 0], phases[n, 1], phases[n, 2]
        a, j = phases[n, 3], phases[n, 4]
        last = (phases[n + 1, 0] if n + 1 < len(phases) else duration) - start
        # extremes of speed are at an end or where acceleration is 0, those of position where speed is 0
        turns[0], turns[1], turns[2:] = 0.0, last, -1.0
        if j != 0.0:
            turns[2] = -a / j
            root = a * a - 2.0 * j * v
            if root >= 0.0:
                turns[3], turns[4] = (-a + math.sqrt(root)) / j, (-a - math.sqrt(root)) / j
        elif a != 0.0:
            turns[3] = -v / a
        for x in turns:
            if 0.0 <= x <= last:
                place = p + x * (v + x * (a / 2.0 + x * j / 6.0))
                low, high = min(low, place), max(high, place)
                fastest = max(fastest, abs(v + x * (a + x * j / 2.0)))
    return low, high, fastest


@compiled
def _max_acceleration(trajectories: Array, weights: Array) -> float:
    """Return an upper bound of the weighted acceleration of all axes together."""
    square = 0.0
    for k in range(len(trajectories)):
        most = 0.0
        for n in range(trajectories.shape[1]):
            most = max(most, abs(trajectories[k, n, 3]))
            if n + 1 < trajectories.shape[1]:
                most = max(
                    most,
                    abs(
                        trajectories[k, n, 3]
                        + trajectories[k, n, 4] * (trajectories[k, n + 1, 0] - trajectories[k, n, 0])
                    ),
                )
        square += (most * weights[k]) ** 2
    return math.sqrt(square)


@compiled
def _exceeds(
    trajectories: Array,
    times: Array,
    near: int,
    programmed: Array,
    fastest: Array,
    speed_caps: Array,
    feed_columns: Array,
    slack: float,
) -> bool:
    """Return whether trajectories leave the allowed span or exceed a speed.

    Each axis has to stay in the span of the programmed points and below ``fastest``, the path below the speed
    cap of its part: before or after the time of index ``near``.
    """
    duration = times[-1]
    for k in range(len(fastest)):
        low, high, speed = _extent(trajectories[k], duration)
        if low < programmed[:, k].min() - slack or high > programmed[:, k].max() + slack:
            return True
        if speed > fastest[k] * FASTER + SLACK:
            return True
    # without jerk the path is fastest where an acceleration changes; with jerk, densely spaced times suffice
    places = np.linspace(0.0, duration, SPEED_SAMPLES)
    moments = np.concatenate((places, times[near : near + 1], trajectories[:, :, 0].copy().reshape(-1)))
    found = np.empty((4, len(moments), len(fastest)))
    evaluate_trajectories(trajectories, moments, found)
    for i in range(len(moments)):
        # the time between the two parts belongs to both
        for part in range(2):
            if moments[i] > times[near] if part == 0 else moments[i] < times[near]:
                continue
            square = counted = 0.0
            for k in range(len(fastest)):
                square += found[1, i, k] ** 2
                counted += feed_columns[part, k] * found[1, i, k] ** 2
            if math.sqrt(square) > speed_caps[part, 0] * FASTER + SLACK:
                return True
            if math.sqrt(counted) > speed_caps[part, 1] * FASTER + SLACK:
                return True
    return False


@compiled
def path_deviation_of(
    trajectories: Array,
    duration: float,
    programmed: Array,
    chord_error: float,
    weights: Array,
    fastest: Array,
    speed_caps: Array,
    feed_columns: Array,
    cycle: float,
) -> tuple[float, float]:
    """Return the path deviation of trajectories, and the share of their time when the vertex is nearest.

    The deviation [m] is the greatest of the distances between the two paths in either direction and of that
    from the vertex to the nearest setpoint; infinite where the trajectories are not allowed.

    Args:
        programmed: points of the path with the vertex in the middle, shape (m, K); for two straight lines the
            ends and the vertex. chord_error: of a polyline through them [m]. weights: of the columns in the
            distance, shape (K,).
        fastest: greatest speeds of the columns, shape (K,). speed_caps: of all columns together, and of those
            that the path speed counts, on the parts before and after the vertex, shape (2, 2).
        feed_columns: 1 for columns that the path speed of a part counts, 0 for others, shape (2, K).
        cycle: between two setpoints [s].
    """
    count, middle = len(weights), len(programmed) // 2
    times = np.empty(SAMPLES)
    for i in range(SAMPLES):
        times[i] = duration * i / (SAMPLES - 1)
    found = np.empty((4, SAMPLES, count))
    evaluate_trajectories(trajectories, times, found)
    vertex = programmed[middle]
    near = 1
    for i in range(2, SAMPLES - 1):
        if _distance(found[0, i], vertex, weights) < _distance(found[0, near], vertex, weights):
            near = i
    if _exceeds(
        trajectories, times, near, programmed, fastest, speed_caps, feed_columns, SLACK + 2.0 * chord_error
    ):
        return math.inf, 0.5
    # there is a setpoint within half a cycle of the point nearest to the vertex
    rows = np.empty(2)
    rows[0] = max(times[near] - 0.5 * cycle, 0.0)
    rows[1] = min(times[near] + 0.5 * cycle, duration)
    beside = np.empty((4, 2, count))
    evaluate_trajectories(trajectories, rows, beside)
    worst = max(_distance(beside[0, 0], vertex, weights), _distance(beside[0, 1], vertex, weights))
    path, way = programmed * weights, found[0] * weights
    # trajectories leave their chords by a·dt²/8
    between = _max_acceleration(trajectories, weights) * (duration / (SAMPLES - 1)) ** 2 / 8.0
    # measure each part against its own line: lines may lie close to each other
    for part in range(2):
        line = path[: middle + 1] if part == 0 else path[middle:]
        own = way[: near + 1] if part == 0 else way[near:]
        points = line
        if len(line) == 2:
            points = np.empty((STEPS_PER_LINE + 1, count))
            for i in range(STEPS_PER_LINE + 1):
                points[i] = line[0] + (line[1] - line[0]) * (i / STEPS_PER_LINE)
        worst = max(
            worst,
            max(max_distance_to_polyline(own, line), max_distance_to_polyline(points, own)) * POINTS
            + between
            + chord_error,
        )
    return worst, times[near] / duration
