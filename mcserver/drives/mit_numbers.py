"""Numbers in the frames of motors in MIT mode: unsigned, and linear over a range."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Feedback:
    """What a motor answers to every command.

    Attributes:
        status: as its protocol has it. position, velocity, torque: of the output shaft [rad, rad/s, N·m].
        mos_celsius, coil_celsius: temperatures [°C].
    """

    status: int
    position: float
    velocity: float
    torque: float
    mos_celsius: float = 25
    coil_celsius: float = 25


def encode(value: float, greatest: float, bits: int) -> int:
    """Return the number of a value within ±``greatest``; what lies beyond becomes the range's end."""
    most = (1 << bits) - 1
    return round((min(max(value, -greatest), greatest) + greatest) * most / (2.0 * greatest))


def decode(number: int, greatest: float, bits: int) -> float:
    """Return the value of a number within ±``greatest``."""
    return number * 2.0 * greatest / ((1 << bits) - 1) - greatest


def encode_share(value: float, greatest: float, bits: int) -> int:
    """Return the number of a value from 0 to ``greatest``; what lies beyond becomes the range's end."""
    return encode(2.0 * value - greatest, greatest, bits)


def decode_share(number: int, greatest: float, bits: int) -> float:
    """Return the value of a number from 0 to ``greatest``."""
    return (decode(number, greatest, bits) + greatest) / 2.0


def about_zero(number: int, greatest: float, bits: int) -> float:
    """As `decode`; the two in the middle, which are as near to 0 as they can be, are 0."""
    middle = 1 << bits - 1
    return 0.0 if number in (middle - 1, middle) else decode(number, greatest, bits)


def step(greatest: float, bits: int) -> float:
    """Return the step of numbers within ±``greatest``."""
    return 2.0 * greatest / ((1 << bits) - 1)
