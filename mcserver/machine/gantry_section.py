"""``gantry`` of an axis: a second drive that gets the setpoint of its leader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import msgspec

from mcserver.machine.constraints import Positive
from mcserver.machine.homing_section import Homing
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.clearance_section import Body
    from mcserver.machine.tool_section import Tool

# Homing methods in which two sides square each other, or nothing moves.
SQUARING = ("switch", "absolute")


class GantrySection(msgspec.Struct, frozen=True):
    """``gantry`` as written.

    Attributes:
        leader: number of the axis that programs name.
        max_skew: greatest difference of the two sides [mm, deg].
    """

    leader: int
    max_skew: Positive


class Gantry(msgspec.Struct, frozen=True):
    """`GantrySection` in SI: the leader's number, and the greatest skew [m or rad]."""

    leader: int
    max_skew: float


def check_gantries(
    axes: Mapping[Path, Axis],
    tools: Sequence[Tool],
    bodies: Sequence[Body | None],
    mistakes: Mistakes,
) -> None:
    """Report second drives that cannot follow (MC090), and pairs that cannot be homed together (MC091).

    Args:
        axes: by the paths of their sections.
    """
    numbers = {axis.index: axis for axis in axes.values()}
    followers = {axis.index for axis in axes.values() if axis.gantry is not None}
    led: set[int] = set()
    for path, axis in axes.items():
        if axis.gantry is None:
            continue
        leader = numbers.get(axis.gantry.leader)
        if leader is None or leader.index in followers or leader.index in led:
            mistakes.add(
                (*path, "gantry", "leader"),
                f"axis {axis.gantry.leader} is not there, follows another one, or has a second drive already",
                "name an [[axis]] of this file that programs move; a pair has two drives",
                "MC090",
            )
            continue
        led.add(leader.index)
        for key, hint in _differences(axis, leader):
            mistakes.add((*path, key), f"does not fit axis {leader.index}, which it follows", hint, "MC090")
        if axis.index in {each for tool in tools for each in tool.axes}:
            mistakes.add((*path, "gantry"), "a [[tool]] names it", f"name axis {leader.index} there", "MC090")
        if any(body is not None and axis.index in body.carried_by for body in bodies):
            hint = f"let axis {leader.index} carry it"
            mistakes.add((*path, "gantry"), "a [[body]] is carried by it", hint, "MC090")
        what = _wrong_homing(axis.homing, leader.homing)
        if what is not None:
            mistakes.add((*path, "homing"), *what)


def _differences(axis: Axis, leader: Axis) -> list[tuple[str, str]]:
    """Return keys of an axis that prevent it from following its leader, each with a remedy."""
    found = []
    if axis.type is not leader.type:
        found.append(("type", f'use "{leader.type.value}"'))
    for key in ("max_velocity", "max_acceleration", "max_jerk"):
        if getattr(axis, key) < getattr(leader, key):
            found.append((key, "the pair is planned by the leader's limits: give no less than these"))
    for key, limited in (("min_position", axis.min_position), ("max_position", axis.max_position)):
        if abs(limited) != float("inf"):
            found.append((key, "leave it out: the leader's travel counts"))
    for key in ("shaper", "tool_shapers"):
        if getattr(axis, key) != getattr(leader, key):
            found.append((key, "give both drives the same"))
    if axis.profiled or leader.profiled:
        found.append(("drive", 'use csp or ip for both: mode = "pp" goes to points'))
    if axis.initial_position != leader.initial_position:
        found.append(("drive", "let both start at the same initial_position"))
    return found


def _wrong_homing(homing: Homing | None, leader: Homing | None) -> tuple[str, str, str] | None:
    """Return a fault in the homing of a pair, its remedy and code; None without one."""
    if homing is None or leader is None:
        if homing is leader:
            return None
        return "one side is homed, the other is not", "give both [axis.homing], or none", "MC091"
    if homing.index:
        return "the two indices are not at one place", "leave index out: each side's switch counts", "MC091"
    if homing.method not in SQUARING:
        return f'method = "{homing.method}" does not square a pair', f"use {', '.join(SQUARING)}", "MC091"
    # each side has its own switch and position
    same = msgspec.structs.replace(
        homing,
        position=leader.position,
        input=leader.input,
        invert=leader.invert,
        travel=leader.travel,
        release_travel=leader.release_travel,
    )
    if same != leader:
        return (
            "the two sides are not homed alike",
            "give both the same keys but position, input, invert, travel and release_travel",
            "MC091",
        )
    return None
