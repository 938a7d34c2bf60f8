"""Convert program units to SI, and back for messages: mm or inches, degrees, minutes (D-11, D-13)."""

from __future__ import annotations

from typing import TypeVar

from mcserver.motion.geometry.curves import Array
from mcserver.units import DEGREE, INCH, MINUTE, MM, AxisType

Number = TypeVar("Number", float, Array)  # one value, or a column of them


def length_scale(inch: bool) -> float:
    """Return the length of one program unit [m]."""
    return INCH if inch else MM


def axis_scale(axis_type: AxisType, inch: bool) -> float:
    """Return one program unit of an axis [m or rad]; rotary axes are in degrees under G20 too (D-13)."""
    return length_scale(inch) if axis_type is AxisType.LINEAR else DEGREE


def path_speed(number: Number, inch: bool) -> Number:
    """Convert F under G94 to a speed along a path [m/s]."""
    return number * length_scale(inch) / MINUTE


def turning_speed(number: Number) -> Number:
    """Convert F under G94 for a rotary move to [rad/s]: degrees per minute under G20 and G21 alike (D-11)."""
    return number * DEGREE / MINUTE


def move_duration(number: Number) -> Number:
    """Convert F under G93 to a duration [s]."""
    return MINUTE / number


def motor_speed(rpm: float, travel_per_turn: float) -> float:
    """Convert motor rpm and travel per motor turn [m or rad] to the axis's speed [m/s or rad/s]."""
    return rpm * travel_per_turn / MINUTE


def motor_rpm(speed: float, travel_per_turn: float) -> float:
    """Convert an axis's speed [m/s or rad/s] to motor rpm."""
    return speed * MINUTE / travel_per_turn


def shown_number(value: float) -> str:
    """Format a number for messages: up to six decimals, no exponent, no trailing zeros."""
    text = f"{value:.6f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def shown_length(metres: float, inch: bool) -> str:
    """Format a length for messages in program units, such as ``100 mm``."""
    return f"{shown_number(metres / length_scale(inch))} {'in' if inch else 'mm'}"


def shown_position(value: float, axis_type: AxisType, inch: bool) -> str:
    """Format an axis's position for messages, in the unit of its words."""
    if axis_type is AxisType.LINEAR:
        return shown_length(value, inch)
    return f"{shown_number(value / DEGREE)} deg"
