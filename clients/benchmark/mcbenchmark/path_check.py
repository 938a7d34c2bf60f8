"""Compare the path of a run with the legs that a task asks for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec
import numpy as np

from mcbenchmark.motion_record import Array, MotionRecord
from mcbenchmark.tasks import Box, Leg, Place, Range

# Below this speed the coordinates rest [mm/s or deg/s]: rounding, and the tail of a jerk-limited stop.
RESTING = 0.5
# For speeding up and slowing down a leg has so much more time than its length takes at its speed [s].
RAMPS_S = 0.15
DETOUR_CORNERS = 4
# Nobody asked for a rest at the end of a leg, or on it: exact stops settle, drives get their power [s].
REST_S = 0.25
HESITATION_S = 0.1
# A straight leg may be longer than its chord by rounding only; more is a way back and forth.
_LENGTH_SHARE = 1.001


class PathMismatch(Exception):
    """The path is not the one that was asked for; the text says where and by how much."""


class Followed(msgspec.Struct, frozen=True):
    """The cycles of one leg: of its start, its arrival, and the end of the rest behind that."""

    start: int
    arrival: int
    end: int


def follow(record: MotionRecord, legs: Sequence[Leg], speed: Range | None = None) -> list[Followed]:
    """Follow a path leg by leg, each to the first time that its place is reached.

    Args:
        speed: of the legs that say none.

    Returns:
        The cycles of each leg; the last one lasts as long as the run.

    Raises:
        PathMismatch: the first leg that does not fit, numbered from 1.
        Refused: MC331 a leg names what the machine lacks.
    """
    found: list[Followed] = []
    at = 0
    for number, leg in enumerate(legs, 1):
        try:
            part = _follow_leg(record, leg, at, leg.speed or speed)
            at = part.end
            if number == len(legs):
                _check_stay(record, leg, at)
                part = Followed(part.start, part.arrival, len(record.time_s) - 1)
            found.append(part)
        except PathMismatch as error:
            raise PathMismatch(f"leg {number}, to {shown(leg.to)}: {error}") from None
    return found


def enters(record: MotionRecord, box: Box) -> float | None:
    """Return the time at which a path enters a box, between two cycles too, or None [s]."""
    path = record.path(box)
    low = np.array([bounds[0] for bounds in box.values()])
    high = np.array([bounds[1] for bounds in box.values()])
    start, end = path[:-1], path[1:]
    if len(path) == 1:
        start = end = path
    # the share of each step that lies between each pair of planes (slab method)
    step = end - start
    still = np.abs(step) < 1e-12
    over = np.where(still, 1.0, step)
    near, far = (low - start) / over, (high - start) / over
    inside = (start > low) & (start < high)
    first = np.where(still, np.where(inside, -np.inf, np.inf), np.minimum(near, far)).max(axis=1)
    last = np.where(still, np.where(inside, np.inf, -np.inf), np.maximum(near, far)).min(axis=1)
    hits = np.flatnonzero((np.maximum(first, 0.0) < np.minimum(last, 1.0)) | inside.all(axis=1))
    return float(record.time_s[hits[0]]) if len(hits) else None


def shown(place: Place) -> str:
    """Write a place as messages show it."""
    return " ".join(f"{name}={value:.6g}" for name, value in place.items())


def _follow_leg(record: MotionRecord, leg: Leg, at: int, allowed: Range | None) -> Followed:
    """Follow a leg that starts in cycle ``at``, at an allowed speed."""
    path = record.path(leg.to)
    target = np.array(list(leg.to.values()))
    arrival = _check_arc(record, leg, at) if leg.by == "arc" else _arrival(path, target, at, leg.tolerance)
    if leg.by == "line":
        _check_line(path[at : arrival + 1], target, leg.tolerance)
    speed = _speeds(path, record.time_s)
    end = arrival
    while end < len(speed) and speed[end] <= RESTING:
        end += 1
    travel = speed[at:arrival]
    _check_range("takes", record.time_s[arrival] - record.time_s[at], leg.duration_s, "s")
    cycle_s = float(record.time_s[1] - record.time_s[0]) if len(speed) else 0.0
    _check_range("has a top speed of", float(travel.max()) if len(travel) else 0.0, allowed, "per second")
    if allowed is not None and allowed[0] > 0:
        # a detour has corners, where it may stop
        most = float(travel.sum()) * cycle_s / allowed[0] + RAMPS_S * (DETOUR_CORNERS if leg.detour else 1)
        _check_range("moves for", float((travel > RESTING).sum()) * cycle_s, (0.0, most), "s")
    _check_range("hesitates for", float((travel <= RESTING).sum()) * cycle_s, (0.0, HESITATION_S), "s")
    _check_range("rests for", record.time_s[end] - record.time_s[arrival], leg.rest_s or (0.0, REST_S), "s")
    if leg.stops is not None and leg.stops != _stops(path, speed, arrival, target, leg.tolerance):
        raise PathMismatch("passes without a stop" if leg.stops else "stops where it should pass")
    return Followed(at, arrival, end)


def _arrival(path: Array, target: Array, at: int, tolerance: float) -> int:
    """Return the cycle that is nearest to the target when the path first comes within the tolerance."""
    distance = _distance_to_steps(path[at:], target)
    hits = np.flatnonzero(distance <= tolerance)
    if not len(hits):
        nearest = int(np.argmin(distance))
        raise PathMismatch(f"is not reached; the nearest it comes is {distance[nearest]:.6g}")
    here = np.abs(path[at:] - target).max(axis=1)
    found = int(hits[0])
    while found + 1 < len(here) and here[found + 1] < here[found] - 1e-9:
        found += 1
    return at + found


def _distance_to_steps(path: Array, target: Array) -> Array:
    """Return the distance of a point from each step between two cycles, shape (n,)."""
    step = np.diff(path, axis=0, append=path[-1:])
    square = np.einsum("ij,ij->i", step, step)
    share = np.einsum("ij,ij->i", target - path, step) / np.where(square > 0, square, 1.0)
    nearest = path + np.clip(share, 0.0, 1.0)[:, None] * step
    return np.asarray(np.linalg.norm(nearest - target, axis=1))


def _check_line(path: Array, target: Array, tolerance: float) -> None:
    start = path[0]
    chord = target - start
    length = float(np.linalg.norm(chord))
    share = (path - start) @ chord / length**2 if length > 0 else np.zeros(len(path))
    off = np.linalg.norm(path - (start + np.clip(share, 0.0, 1.0)[:, None] * chord), axis=1)
    if off.max() > tolerance:
        raise PathMismatch(f"is {off.max():.6g} off the straight line, {tolerance:g} is allowed")
    travelled = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
    if travelled > length * _LENGTH_SHARE + 2 * tolerance:
        raise PathMismatch(f"is reached after {travelled:.6g}, the straight line is {length:.6g} long")


def _check_arc(record: MotionRecord, leg: Leg, at: int) -> int:
    """Follow an arc by the angle that it has turned; return the cycle of its end."""
    center = np.array(list(leg.center.values()))
    offset = record.path(leg.center)[at:] - center
    radius = np.hypot(offset[:, 0], offset[:, 1])
    if radius[0] <= leg.tolerance:
        raise PathMismatch("starts in the center of the arc")
    turned = np.degrees(np.unwrap(np.arctan2(offset[:, 1], offset[:, 0])))
    turned = (turned - turned[0]) * math.copysign(1.0, leg.turn)
    whole = abs(leg.turn)
    slack = math.degrees(leg.tolerance / radius[0])
    ends = np.flatnonzero(turned >= whole - slack)
    if not len(ends):
        raise PathMismatch(f"turns {abs(turned.max()):.4g}° of {whole:g}° about {shown(leg.center)}")
    end = int(ends[0])
    # on to where the turn is complete, as near as the path comes to it
    while end + 1 < len(turned) and abs(turned[end + 1] - whole) < abs(turned[end] - whole) - 1e-9:
        end += 1
    off = np.abs(radius[: end + 1] - radius[0]).max()
    if off > leg.tolerance:
        raise PathMismatch(f"is {off:.6g} off its radius of {radius[0]:.6g}, {leg.tolerance:g} is allowed")
    share = turned[: end + 1] / whole
    for name, value in leg.to.items():
        path = record.path([name])[at : at + end + 1, 0]
        if name not in leg.center:
            off = np.abs(path - (path[0] + share * (value - path[0]))).max()
            if off > leg.tolerance:
                raise PathMismatch(f"is {off:.6g} off {name}, which goes linearly with the angle")
        elif abs(path[-1] - value) > leg.tolerance + _last_step(record, name, at + end):
            raise PathMismatch(f"ends at {name}={path[-1]:.6g}")
    return at + end


def _last_step(record: MotionRecord, name: str, at: int) -> float:
    """Return how far a coordinate moves in the cycle behind: where an arc is passed, its end lies between."""
    path = record.path([name])[:, 0]
    return abs(float(path[min(at + 1, len(path) - 1)] - path[at])) if at else 0.0


def _speeds(path: Array, time_s: Array) -> Array:
    """Return the speed of each step between two cycles, shape (N - 1,)."""
    step: Array = np.linalg.norm(np.diff(path, axis=0), axis=1)
    return step / np.diff(time_s)


def _stops(path: Array, speed: Array, at: int, target: Array, tolerance: float) -> bool:
    """Return True if the path comes to rest near a place at which it is in cycle ``at``."""
    first = last = at
    while first > 0 and np.abs(path[first - 1] - target).max() <= tolerance:
        first -= 1
    while last < len(speed) and np.abs(path[last] - target).max() <= tolerance:
        last += 1
    near = speed[first : max(last, at + 1)]
    return not len(near) or float(near.min()) <= RESTING


def _check_stay(record: MotionRecord, leg: Leg, at: int) -> None:
    path = record.path(leg.to)[at:]
    off = np.abs(path - np.array(list(leg.to.values()))).max(axis=1)
    if off.max() > leg.tolerance:
        when = record.time_s[at + int(np.argmax(off > leg.tolerance))]
        raise PathMismatch(f"is left again at {when:.3f} s, and by {off.max():.6g}")


def _check_range(what: str, value: float, allowed: tuple[float, float] | None, unit: str) -> None:
    if allowed is not None and not allowed[0] <= value <= allowed[1]:
        raise PathMismatch(f"{what} {value:.6g} {unit}, not {allowed[0]:g} to {allowed[1]:g}")
