"""What nobody asked for does not move, and what was asked for goes there directly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from mcbenchmark.motion_record import Array, MotionRecord
from mcbenchmark.path_check import Followed
from mcbenchmark.tasks import Expectation, Leg

# What rests moves no more, however loose the tolerance of what moves is [mm or deg].
RESTS = 0.05


def stray_motion(record: MotionRecord, expect: Expectation, followed: Sequence[Followed]) -> Iterator[str]:
    """Find motion that a task does not ask for, in sentences.

    A coordinate that no leg names rests all the time; named by some legs, it rests in the others. One that
    only ``end`` names goes there without a way back. So do those of a leg without a form, unless it may make
    a detour. ``free`` ones move as they like.

    Args:
        followed: the legs that were followed, one after the other from the first cycle on.

    Raises:
        Refused: MC331 the machine has no such axis or tool.
    """
    one = record.one_name
    by_leg = [{one(name) for name in (*leg.to, *leg.center)} for leg in expect.path]
    in_legs = set[str]().union(*by_leg)
    ends, turning = {one(name) for name in expect.end}, {one(name) for name in expect.speeds}
    free = {one(name) for name in expect.free}
    for name in record.judged([*in_legs, *ends, *turning, *free]):
        if name in free:
            continue
        path, shown = record.path([name])[:, 0], name if "." in name else f"axis {name}"
        if name in in_legs:
            for number, (leg, names, part) in enumerate(zip(expect.path, by_leg, followed, strict=True), 1):
                if name not in names:
                    yield from _resting(record, path, part, leg.tolerance, f"leg {number}: {shown}")
                elif leg.by == "any" and not leg.detour:
                    yield from _direct(path[part.start : part.arrival + 1], leg, f"leg {number}: {shown}")
        elif name in ends:
            yield from _direct(path, Leg({}, tolerance=expect.tolerance), shown)
        elif name not in turning:
            whole = Followed(0, len(path) - 1, len(path) - 1)
            yield from _resting(record, path, whole, expect.tolerance, shown)


def _resting(record: MotionRecord, path: Array, part: Followed, tolerance: float, name: str) -> Iterator[str]:
    off, allowed = np.abs(path[part.start : part.end + 1] - path[part.start]), min(tolerance, RESTS)
    if off.max() > allowed:
        when = record.time_s[part.start + int(np.argmax(off > allowed))]
        yield f"{name} is not to move, and does at {when:.3f} s, by {off.max():.6g}"


def _direct(path: Array, leg: Leg, name: str) -> Iterator[str]:
    way, distance = float(np.abs(np.diff(path)).sum()), abs(float(path[-1] - path[0]))
    if way > distance + 2 * leg.tolerance:
        yield f"{name} goes {way:.6g} for {distance:.6g}: there and back"
