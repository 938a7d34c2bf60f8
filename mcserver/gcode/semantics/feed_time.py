"""Compute the duration or speed of a group (D-30, D-31)."""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence

import msgspec

from mcserver.gcode.profiles.surface_speed import turns_at
from mcserver.gcode.semantics.block_state import ASSUMED_FEED, BlockState
from mcserver.gcode.semantics.modal import Feed
from mcserver.gcode.semantics.program_units import move_duration, turning_speed
from mcserver.gcode.text.profile_words import Action
from mcserver.gcode.text.syntax import Command
from mcserver.motion.canonical import FeedGroup
from mcserver.motion.geometry.curves import Curve
from mcserver.units import TURN, AxisType

NO_TRAVEL = 1e-12  # m or rad


class FeedBasis(enum.Enum):
    """What F measures for a command under G94."""

    PATH = "path"  # a length: 1 to 3 linear axes, an arc, a tool's path
    TURN = "turn"  # an angle: one rotary axis, a tool that only turns
    NONE = "none"  # nothing: G93 is needed


class FeedMove(msgspec.Struct, frozen=True):
    """One of G01-G03, with the feed in force."""

    command: Command | Action
    curve: Curve
    measure: FeedBasis
    inverse_time: bool
    feed: Feed | None


def feed_basis(linear: int, rotary: int) -> FeedBasis:
    """Return what F measures for these counts of named linear and rotary axes (D-30)."""
    if rotary == 0:
        return FeedBasis.PATH if 1 <= linear <= 3 else FeedBasis.NONE
    return FeedBasis.TURN if rotary == 1 and linear == 0 else FeedBasis.NONE


def feed_class(axis: int, *, linear: bool) -> int:
    """Return an axis's rank for F in the profiles: X Y Z, other linear axes, rotary axes."""
    return 2 if not linear else int(axis > 2)


def profile_feed_basis(
    types: Sequence[AxisType], axes: Sequence[int], displacements: Sequence[float]
) -> tuple[FeedBasis, float]:
    """Return what F measures in the profiles, and its length [m or rad], by RS-274's rule (D-66).

    F is the speed along X Y Z; if none of them moves, along the other linear axes together; if these do not
    either, of the rotary axes together. The other axes of the line follow in proportion.
    """
    classes: tuple[list[float], list[float], list[float]] = ([], [], [])
    for kind, axis, displacement in zip(types, axes, displacements, strict=True):
        classes[feed_class(axis, linear=kind is AxisType.LINEAR)].append(displacement)
    for order, group in enumerate(classes):
        length = math.hypot(*group)
        if length > NO_TRAVEL:
            return (FeedBasis.TURN if order == 2 else FeedBasis.PATH), length
    return (FeedBasis.PATH if classes[0] or classes[1] else FeedBasis.TURN), 0.0


def feed_group(block: BlockState, moves: list[FeedMove]) -> FeedGroup | None:
    """Build the group of moves with a common duration, which its first command sets (D-31).

    Faults: MC121 no feed in force, MC122 the first command has no speed under G94, MC128 no turns for G95.
    """
    first = moves[0]
    if first.feed is None:
        inch = feed_unit(block)
        unit = "moves per minute" if first.inverse_time else f"{inch}, or deg{inch[2:]} for a rotary axis"
        block.faults.add(
            "MC121",
            "the move has no feed rate: no F has been given since the program's start or the last change "
            "between G93, G94 and G95",
            block.span(first.command),
            f"give F in {unit}",
        )
        block.change(feed=ASSUMED_FEED)
        return None
    curves = tuple(move.curve for move in moves)
    if first.inverse_time:
        duration = move_duration(first.feed.number)
        return FeedGroup(curves=curves, requested=duration, duration=duration, carried=block.modal.carried)
    if first.measure is FeedBasis.NONE:
        _no_speed(block, first)
        return None
    reference = 0
    if len(moves) > 1 and first.curve.length <= NO_TRAVEL:
        found = _longest_other(block, moves)
        if found is None:
            return None
        reference = found
    turns = turns_of_feed(block, first.command)
    if turns is None:
        return None
    if block.modal.per_turn and block.frame.surface is not None:
        # the spindle's speed varies along the line, which is split by it
        turns = 1.0
    speed = turns * _speed(moves[reference])
    requested = moves[reference].curve.length / speed
    return FeedGroup(
        curves=curves,
        requested=requested,
        speed=speed,
        reference=reference,
        carried=block.modal.carried,
    )


def feed_unit(block: BlockState) -> str:
    """Return the unit of F along a path, for messages."""
    return f"{'in' if block.modal.inch else 'mm'}/{'turn' if block.modal.per_turn else 'min'}"


def turns_of_feed(block: BlockState, source: Command | Action, *, starts: bool = False) -> float | None:
    """Return the factor of F per minute: 1 under G94, the spindle's commanded rpm under G95 (D-105).

    None after a fault (MC128).

    Args:
        starts: the spindle may be stopped, and is about to turn.
    """
    if not block.modal.per_turn:
        return 1.0
    dialect, frame = block.setup.machine.dialect, block.frame
    if frame.surface is not None and frame.direction:
        return turns_at(block, frame.surface)
    turns = frame.spindle_rpm * (1 if starts else abs(frame.direction))
    spindle = None if dialect.spindle is None else block.setup.axes.get(dialect.spindle)
    if spindle is not None:
        turns *= abs(spindle.travel_per_motor_turn) / TURN if spindle.type is AxisType.ROTARY else 1.0
    elif all(each.value is not None for code in ("M3", "M4") for each in dialect.outputs.get(code, ())):
        block.faults.add(
            "MC128",
            "F is in force per turn of the spindle (G95), and S reaches no spindle of this machine",
            block.span(source),
            "write G94, or give the machine file a spindle: spindle_axis, or an output that M3 sets to S",
        )
        return None
    if turns == 0.0:
        block.faults.add(
            "MC128",
            "F is in force per turn of the spindle (G95), which does not turn here",
            block.span(source),
            "write S and M3 or M4 before it, or G94",
        )
        return None
    return turns


def _longest_other(block: BlockState, moves: list[FeedMove]) -> int | None:
    """Return the index of the command with the longest T, if the first has no travel (D-31)."""
    best, longest = 0, 0.0
    for index, move in enumerate(moves[1:], start=1):
        if move.measure is FeedBasis.NONE or move.feed is None or move.inverse_time:
            continue
        own = move.curve.length / _speed(move)
        if own > longest:
            best, longest = index, own
    if best == 0:
        for move in moves[1:]:
            if move.measure is FeedBasis.NONE and _travels(move.curve):
                _no_speed(block, move)
                return None
    return best


def _travels(curve: Curve) -> bool:
    low, high = curve.bounds()
    return bool((high - low).max() > NO_TRAVEL)


def _speed(move: FeedMove) -> float:
    assert move.feed is not None
    return turning_speed(move.feed.number) if move.measure is FeedBasis.TURN else move.feed.speed


def _no_speed(block: BlockState, move: FeedMove) -> None:
    axes = move.curve.axes
    rotary = sum(1 for axis in axes if block.setup.axes[axis].type.value == "rotary")
    if rotary == 0:
        what = f"{len(axes)} linear axes together"
    elif rotary == len(axes):
        what = f"{rotary} rotary axes together"
    else:
        what = "linear and rotary axes together"
    block.faults.add(
        "MC122",
        f"under G94 a speed of {what} is not defined",
        block.span(move.command),
        "use G93 (F in moves per minute), or move a tool by T",
    )
