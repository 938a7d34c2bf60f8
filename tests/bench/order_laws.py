"""The laws of a motion that is played under random orders: holds, overrides and stops."""

from __future__ import annotations

import numpy as np

from tests.bench.shaped_machines import broken_by_shapers
from tests.executor.rig import Rig
from tests.executor.test_overrides_of_programs import rig_of
from tests.motion.measure import (
    ACCELERATION_SLACK,
    JERK_SLACK,
    VELOCITY_SLACK,
    acceleration_ratio,
    bow_of,
    exact_vertices,
    from_polyline,
    jerk_of_vertices,
    velocity_ratio,
    weights_of,
)
from tests.motion.support import Motion

# Overrides that are given; below 0: a hold or its end.
RATES = (-1.0, -1.0, 0.0, 0.3, 0.5, 0.77, 0.97, 1.0, 1.4, 1.7, 2.0)
# Times the jerk of an exact path's vertices where an axis accelerates beside them: rows do not tell where
# between them velocity steps then.
BETWEEN_ROWS = 1.2
# Longer motions are not played under orders: the ring takes them as a whole.
MOST_ROWS = 3500
# Feed scales that rows are said to be planned for in half of the programs, so many rows each.
SCALES, SCALED = (1.0, 1.0, 1.4, 2.0), 170
# What rounding may take away from a path [m].
EXACT = 1e-9
# Cycles that an emergency stop may take longer than an abort in the same one: it ends between two.
LATER = 3


def broken_under_orders(motion: Motion, seed: int) -> list[str]:
    """Play a motion under random orders; name the laws that its setpoints break."""
    rng = np.random.default_rng((seed, 1))
    rig = _rig_of(motion, seed, rng)
    mailbox, often = rig.executor.mailbox, rng.random() < 0.4
    for _ in range(int(rng.integers(1, 60 if often else 12))):
        rig.step(int(rng.integers(1, 10 if often else 300)))
        if rig.machine.shaping is not None and rng.random() < 0.3:
            rig.executor.executor.mount(int(rng.integers(0, 3)))
        rate = float(rng.choice(RATES))
        if rate >= 0.0:
            mailbox.set_override(rate, 0)
        elif rng.random() < 0.5:
            mailbox.set_hold(True, 0)
        else:
            mailbox.resume(0)
    mailbox.resume(0)
    mailbox.set_override(float(rng.choice([1.0, 1.3, 2.0])), 0)
    rig.run(60_000)
    broken = [f"{passed} under orders" for passed in _limits_passed(rig, motion)]
    if not np.array_equal(rig.setpoint[-1], motion.position[-1]):
        broken.append("the end is missed under orders")
    return broken + broken_by_shapers(rig)


def broken_by_stops(motion: Motion, seed: int) -> list[str]:
    """Play a motion under random overrides and abort it in some cycle, then the same with an emergency stop;
    name the laws that its setpoints break.

    Both keep the path and all limits, but for the jerk in an emergency, which takes no longer.
    """
    aborted, ordered = _stopped(motion, seed, urgent=False)
    broken = _broken_by_stop(motion, aborted, ordered, urgent=False)
    stopped, _ = _stopped(motion, seed, urgent=True)
    broken += _broken_by_stop(motion, stopped, ordered, urgent=True)
    if len(stopped.setpoints) > len(aborted.setpoints) + LATER:
        took = len(stopped.setpoints) - ordered, len(aborted.setpoints) - ordered
        broken.append(f"an emergency stop takes {took[0]} cycles, an abort {took[1]}")
    return broken


def _stopped(motion: Motion, seed: int, *, urgent: bool) -> tuple[Rig, int]:
    """Stop a motion under random overrides, now and then amid a hold; return the cycle of the order, too."""
    rng = np.random.default_rng((seed, 8))
    rig = _rig_of(motion, seed, rng)
    mailbox, rates = rig.executor.mailbox, [rate for rate in RATES if rate > 0.0]
    rig.step(int(rng.integers(1, 1 + len(motion.position))))
    for _ in range(int(rng.integers(0, 4))):
        mailbox.set_override(float(rng.choice(rates)), 0)
        rig.step(int(rng.integers(1, 100)))
    if rng.random() < 0.3:
        mailbox.set_hold(True, 0)
        rig.step(int(rng.integers(1, 40)))
    if urgent:
        mailbox.emergency_stop()
    else:
        mailbox.abort(0)
    ordered = len(rig.setpoints)
    rig.run()
    return rig, ordered


def _broken_by_stop(motion: Motion, rig: Rig, ordered: int, *, urgent: bool) -> list[str]:
    what = "in an emergency stop" if urgent else "in an abort"
    broken = [f"{passed} {what}" for passed in _limits_passed(rig, motion, jerk=not urgent)]
    weights, bow = weights_of(motion.machine), bow_of(motion)
    beside = from_polyline(rig.ordered[ordered:] * weights, motion.rested * weights)
    if not beside <= bow + EXACT:
        broken.append(f"beside the path by {beside:.6g} > {bow:.6g} {what}")
    return broken + broken_by_shapers(rig)


def _rig_of(motion: Motion, seed: int, rng: np.random.Generator) -> Rig:
    """Return a motion that is ready to be played; with odd seeds its rows are said to be planned for other
    overrides, a stretch each, and are played at their shares.
    """
    scales = np.ones(MOST_ROWS // SCALED + 2)
    if seed % 2:
        scales = rng.choice(SCALES, len(scales))
    return rig_of(motion.machine, motion, lambda u: float(scales[u // SCALED]))


def _limits_passed(rig: Rig, motion: Motion, *, jerk: bool = True) -> list[str]:
    """Name the limits that setpoints pass, each with its figure; what rows do themselves is allowed.

    At the vertices of an exact path (D-36) the jerk is allowed that the path itself has there, wherever the
    cycles fall.
    """
    points, machine = rig.setpoint, motion.machine
    points = np.concatenate((np.tile(points[:1], (3, 1)), points, np.tile(points[-1:], (3, 1))))
    allowed = [
        ("velocity", max(VELOCITY_SLACK, velocity_ratio(motion))),
        ("acceleration", max(ACCELERATION_SLACK, acceleration_ratio(motion))),
    ]
    if jerk:
        at_vertices = jerk_of_vertices(motion, exact_vertices(motion))
        allowed.append(("jerk", JERK_SLACK if at_vertices <= JERK_SLACK else BETWEEN_ROWS * at_vertices))
    broken = []
    for order, (name, most) in enumerate(allowed, start=1):
        limit = np.array([getattr(axis, f"max_{name}") for axis in machine.axes])
        value = float((np.abs(np.diff(points, order, axis=0)) / machine.cycle_s**order / limit).max())
        if not value <= most:
            broken.append(f"{name} {value:.6g} > {most:.6g}")
    return broken
