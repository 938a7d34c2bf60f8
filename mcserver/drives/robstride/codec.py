"""Frames of RobStride's private protocol (public manuals of RS00 to RS06, "Driver protocol").

Identifiers have 29 bits: the kind of the frame, 16 bits that depend on it, and whom it is for. The numbers of
a command and of feedback are unsigned, have 16 bits, and are linear over a range that depends on the model of
the motor and is in none of its parameters.
"""

from __future__ import annotations

import enum
import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

from mcserver.can.port import EXTENDED
from mcserver.drives.mit_numbers import Feedback, about_zero, decode, decode_share, encode, encode_share

LENGTH = 8
BITS = 16
# Whom motors answer: the number of the master.
HOST = 0xFD
# Range of positions of all models, as the manuals round 4π [rad].
USUAL_P_MAX = 12.57
# Unit of the parameter CAN_TIMEOUT [s].
TIMEOUT_UNIT = 50e-6
OPERATION_MODE = 0
CLEAR_FAULT = b"\x01" + bytes(7)

_NUMBERS = struct.Struct(">4H")
_PARAMETER = struct.Struct("<HH4s")
_NUMBER = struct.Struct("<I")
_REAL = struct.Struct("<f")


class Kind(enum.IntEnum):
    """Kinds of frames that are used here."""

    COMMAND = 1
    FEEDBACK = 2
    ENABLE = 3
    STOP = 4
    READ = 17
    WRITE = 18


class Parameter(enum.IntEnum):
    """Parameters that are read or written here; what is written is lost with the motor's power."""

    RUN_MODE = 0x7005
    LIMIT_TORQUE = 0x700B  # [N·m]
    MECH_POS = 0x7019  # of the output shaft [rad]
    CAN_TIMEOUT = 0x7028  # silence of the master that ends its motion, in `TIMEOUT_UNIT`; 0: never

    @property
    def is_real(self) -> bool:
        """Whether its value is a floating-point number."""
        return self in (Parameter.LIMIT_TORQUE, Parameter.MECH_POS)


class Mode(enum.IntEnum):
    """What a motor is doing, in the identifier of feedback."""

    RESET = 0
    CALIBRATION = 1
    RUN = 2


class FaultBit(enum.IntFlag):
    """Faults in the identifier of feedback."""

    UNDER_VOLTAGE = 1
    OVER_CURRENT = 2
    OVER_TEMPERATURE = 4
    ENCODER = 8
    STALL = 16
    NOT_CALIBRATED = 32


ALL_FAULTS = 63
FAULTS: Mapping[int, str] = MappingProxyType(
    {int(bit): str(bit.name).lower().replace("_", " ") for bit in FaultBit}
)


class State(NamedTuple):
    """What the identifier of feedback says; ``mode``: of `Mode`. ``faults``: of `FaultBit`."""

    mode: int
    faults: int


def identifier(kind: Kind, middle: int, to: int) -> int:
    """Return an identifier; ``middle``: its 16 bits between. ``to``: whom the frame is for."""
    return EXTENDED | kind << 24 | middle << 8 | to


def to_motor(kind: Kind, node: int) -> int:
    """Return the identifier of an order or a request."""
    return identifier(kind, HOST, node)


def feedback_identifiers(node: int) -> dict[int, State]:
    """Return all identifiers by which a motor's feedback may come."""
    states = [State(mode, faults) for mode in range(4) for faults in range(ALL_FAULTS + 1)]
    return {feedback_identifier(node, state): state for state in states}


def feedback_identifier(node: int, state: State) -> int:
    """Return the identifier of a motor's feedback."""
    return identifier(Kind.FEEDBACK, (state.mode << 6 | state.faults) << 8 | node, HOST)


def answer_identifier(node: int, *, refused: bool = False) -> int:
    """Return the identifier of a motor's answer to a request for a parameter."""
    return identifier(Kind.READ, int(refused) << 8 | node, HOST)


@dataclass(frozen=True)
class Ranges:
    """Greatest magnitudes that a frame can say: position [rad], velocity [rad/s], torque [N·m], and the
    greatest stiffness and damping [N·m/rad, N·m·s/rad].
    """

    position: float
    velocity: float
    torque: float
    kp: float
    kd: float

    def command(
        self, node: int, position: float, velocity: float, kp: float, kd: float, torque: float
    ) -> tuple[int, bytes]:
        """Return identifier and payload of a command.

        The motor's torque is kp · (position - p) + kd · (velocity - v) + torque. What lies beyond its range
        becomes the range's end.
        """
        payload = _NUMBERS.pack(
            encode(position, self.position, BITS),
            encode(velocity, self.velocity, BITS),
            encode_share(kp, self.kp, BITS),
            encode_share(kd, self.kd, BITS),
        )
        return identifier(Kind.COMMAND, encode(torque, self.torque, BITS), node), payload

    def decode_command(self, whole: int, payload: bytes) -> tuple[float, float, float, float, float]:
        """Return position, velocity, kp, kd, torque of a command with this identifier."""
        position, velocity, kp, kd = _NUMBERS.unpack(payload)
        return (
            decode(position, self.position, BITS),
            decode(velocity, self.velocity, BITS),
            decode_share(kp, self.kp, BITS),
            decode_share(kd, self.kd, BITS),
            decode(whole >> 8 & 0xFFFF, self.torque, BITS),
        )

    def feedback(self, feedback: Feedback) -> bytes:
        """Encode what a motor answers; its state is in the identifier."""
        return _NUMBERS.pack(
            encode(feedback.position, self.position, BITS),
            encode(feedback.velocity, self.velocity, BITS),
            encode(feedback.torque, self.torque, BITS),
            round(10.0 * feedback.coil_celsius),
        )

    def decode_feedback(self, payload: bytes) -> Feedback | None:
        """Decode feedback, whose ``status`` is 0; None where it has another length."""
        if len(payload) != LENGTH:
            return None
        position, velocity, torque, temperature = _NUMBERS.unpack(payload)
        return Feedback(
            0,
            decode(position, self.position, BITS),
            about_zero(velocity, self.velocity, BITS),
            about_zero(torque, self.torque, BITS),
            math.nan,
            0.1 * temperature,
        )


def parameter_payload(parameter: int, value: float | None = None) -> bytes:
    """Encode the request for a parameter, or with a value its answer and the order to write it."""
    if value is None:
        return _PARAMETER.pack(parameter, 0, bytes(4))
    real = Parameter(parameter).is_real
    return _PARAMETER.pack(parameter, 0, _REAL.pack(value) if real else _NUMBER.pack(round(value)))


def parameter_of(payload: bytes) -> tuple[Parameter, float] | None:
    """Decode parameter and value; None where they are none that is used here."""
    if len(payload) != LENGTH:
        return None
    index, _, value = _PARAMETER.unpack(payload)
    if index not in Parameter._value2member_map_:
        return None
    parameter = Parameter(index)
    if parameter is Parameter.RUN_MODE:
        # it has one byte, and the others are not said to be 0
        return parameter, float(value[0])
    (number,) = (_REAL if parameter.is_real else _NUMBER).unpack(value)
    return parameter, float(number)
