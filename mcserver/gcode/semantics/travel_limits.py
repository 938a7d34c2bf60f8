"""Check curves against the axes' travel (D-28)."""

from __future__ import annotations

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import motor_rpm, shown_number, shown_position
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.gcode.text.syntax import Command
from mcserver.gcode.text.words import Word
from mcserver.machine.axis import Axis

ROUNDING = 1e-9  # m or rad: a converted unit may miss its limit in the last bits


def travel_of(block: BlockState, axis: Axis) -> tuple[float, float]:
    """Return the range to which programs may now move an axis [m or rad].

    For an axis with superimposed motion (D-142) the whole window of that motion is kept free.
    """
    low, high = axis.min_position, axis.max_position
    besides = block.superimposed(axis.index)
    if besides is not None:
        low, high = low - besides.low, high - besides.high
    return low, high


def check_speed(
    block: BlockState, axis: Axis, speed: float, what: str, source: Word | ProfileWord | Action
) -> None:
    """Report a speed beyond the axis's limit [m/s or rad/s] (MC202); ``what``: what drives it there."""
    if abs(speed) > axis.max_velocity * (1.0 + 1e-9):
        most = shown_number(motor_rpm(axis.max_velocity, axis.travel_per_motor_turn))
        block.faults.add(
            "MC202",
            f"{what} beyond its max_velocity",
            block.span(source),
            f"its motor may turn at {most} RPM at most",
            axis=axis.index,
        )


def check_travel(
    block: BlockState,
    axis: Axis,
    start: float,
    low: float,
    high: float,
    end: float,
    source: Word | Command | ProfileWord | Action,
) -> None:
    """Report a curve that leaves the axis's travel.

    An axis outside its travel (moved by hand) may move back in.

    Args:
        start, end: of the curve. low, high: smallest and largest position on it [m or rad].
    """
    lowest, highest = travel_of(block, axis)
    least, greatest = lowest - ROUNDING, highest + ROUNDING
    if low >= least and high <= greatest:
        return
    inch = block.modal.inch
    if end < least or low < min(least, start):
        beyond, limit, name = min(low, end), lowest, "min_position"
    elif end > greatest or high > max(greatest, start):
        beyond, limit, name = max(high, end), highest, "max_position"
    else:
        return
    where = "goes to" if beyond == end else "passes"
    shift = (block.modal.shift or {}).get(axis.index, 0.0)
    behind = ""
    if shift:
        zero = shown_position(shift, axis.type, inch)
        behind = f" of the machine, where the program's zero lies at {zero} (work offset and tool length)"
    if (lowest, highest) != (axis.min_position, axis.max_position):
        name += ", less the window of what it follows,"
    block.faults.add(
        "MC201",
        f"axis {axis.index} {where} {shown_position(beyond, axis.type, inch)}, beyond its {name} "
        f"of {shown_position(limit, axis.type, inch)}",
        block.span(source),
        f"stay within {shown_position(lowest, axis.type, inch)} … "
        f"{shown_position(highest, axis.type, inch)}{behind}",
        axis=axis.index,
    )
