"""Frames of Damiao's motors (public manuals of the DM-J series): MIT commands, feedback, registers.

The numbers of a command and of feedback are unsigned and linear over a symmetric range, which the motor has
in its registers: ±PMAX [rad], ±VMAX [rad/s], ±TMAX [N·m], all at the output shaft. None can say exactly 0.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from mcserver.drives.mit_numbers import Feedback, about_zero, decode, decode_share, encode, encode_share

LENGTH = 8
# Stiffness and damping of a command run from 0 to these [N·m/rad, N·m·s/rad].
GREATEST_KP = 500.0
GREATEST_KD = 5.0
# Identifier of requests to registers, of all motors of a bus.
REGISTERS = 0x7FF
READ, WRITE, REFRESH = 0x33, 0x55, 0xCC
# Unit of the register TIMEOUT [s].
TIMEOUT_UNIT = 50e-6
MIT_MODE = 1

_COMMAND = struct.Struct(">Q")
_NUMBER = struct.Struct("<I")
_REAL = struct.Struct("<f")


class Order(enum.IntEnum):
    """Last byte of a frame whose other seven are FFh."""

    CLEAR_FAULT = 0xFB
    ENABLE = 0xFC
    DISABLE = 0xFD

    @property
    def payload(self) -> bytes:
        return b"\xff" * 7 + bytes([self])


class Register(enum.IntEnum):
    """Registers that are read or written here."""

    TIMEOUT = 9  # silence of the master that disables the motor, in `TIMEOUT_UNIT`; 0: never
    CTRL_MODE = 10
    PMAX = 21
    VMAX = 22
    TMAX = 23

    @property
    def is_real(self) -> bool:
        """Whether its value is a floating-point number."""
        return self >= Register.PMAX


class Status(enum.IntEnum):
    """Upper half of the first byte of feedback; from 8 on a fault, which disables the motor."""

    DISABLED = 0
    ENABLED = 1
    OVER_VOLTAGE = 8
    UNDER_VOLTAGE = 9
    OVER_CURRENT = 10
    MOS_OVER_TEMPERATURE = 11
    COIL_OVER_TEMPERATURE = 12
    COMMUNICATION_LOST = 13
    OVERLOAD = 14


FIRST_FAULT = Status.OVER_VOLTAGE
FAULTS: Mapping[int, str] = MappingProxyType(
    {int(status): status.name.lower().replace("_", " ") for status in Status if status >= FIRST_FAULT}
)


@dataclass(frozen=True)
class Ranges:
    """Greatest magnitudes that a frame can say: position [rad], velocity [rad/s], torque [N·m]."""

    position: float
    velocity: float
    torque: float

    def command(self, position: float, velocity: float, kp: float, kd: float, torque: float) -> bytes:
        """Encode a MIT command: the motor's torque is kp · (position - p) + kd · (velocity - v) + torque.

        What lies beyond its range becomes the range's end.
        """
        bits = encode(position, self.position, 16)
        bits = bits << 12 | encode(velocity, self.velocity, 12)
        bits = bits << 12 | encode_share(kp, GREATEST_KP, 12)
        bits = bits << 12 | encode_share(kd, GREATEST_KD, 12)
        return _COMMAND.pack(bits << 12 | encode(torque, self.torque, 12))

    def decode_command(self, payload: bytes) -> tuple[float, float, float, float, float]:
        """Return position, velocity, kp, kd, torque of a MIT command."""
        (bits,) = _COMMAND.unpack(payload)
        return (
            decode(bits >> 48, self.position, 16),
            decode(bits >> 36 & 0xFFF, self.velocity, 12),
            decode_share(bits >> 24 & 0xFFF, GREATEST_KP, 12),
            decode_share(bits >> 12 & 0xFFF, GREATEST_KD, 12),
            decode(bits & 0xFFF, self.torque, 12),
        )

    def feedback(self, node: int, feedback: Feedback) -> bytes:
        """Encode what a motor answers."""
        bits = encode(feedback.position, self.position, 16) << 12 | encode(
            feedback.velocity, self.velocity, 12
        )
        bits = bits << 12 | encode(feedback.torque, self.torque, 12)
        head = bytes([(node & 0xF) | feedback.status << 4])
        return (
            head
            + bits.to_bytes(5, "big")
            + bytes([round(feedback.mos_celsius), round(feedback.coil_celsius)])
        )

    def decode_feedback(self, node: int, payload: bytes) -> Feedback | None:
        """Decode feedback; None where it is none of this motor."""
        if len(payload) != LENGTH or payload[0] & 0xF != node & 0xF or not is_status(payload[0] >> 4):
            return None
        bits = int.from_bytes(payload[1:6], "big")
        return Feedback(
            payload[0] >> 4,
            decode(bits >> 24, self.position, 16),
            about_zero(bits >> 12 & 0xFFF, self.velocity, 12),
            about_zero(bits & 0xFFF, self.torque, 12),
            payload[6],
            payload[7],
        )


def is_status(status: int) -> bool:
    """Return whether a motor can report this."""
    return status in Status._value2member_map_


def register_request(node: int, register: Register, value: float | None = None) -> bytes:
    """Encode the request to read a register, or with a value to write it until power goes."""
    head = bytes([node & 0xFF, node >> 8, READ if value is None else WRITE, register])
    if value is None:
        return head + bytes(4)
    return head + (_REAL.pack(value) if register.is_real else _NUMBER.pack(round(value)))


def refresh_request(node: int) -> bytes:
    """Encode the request for feedback, which changes nothing."""
    return bytes([node & 0xFF, node >> 8, REFRESH]) + bytes(5)


def register_answer(node: int, payload: bytes) -> tuple[Register, float] | None:
    """Decode what a motor answers to `register_request`; None where this is no such answer."""
    own = len(payload) == LENGTH and payload[0] == node & 0xFF and payload[1] == node >> 8
    if not own or payload[2] not in (READ, WRITE) or payload[3] not in Register._value2member_map_:
        return None
    register = Register(payload[3])
    (value,) = (_REAL if register.is_real else _NUMBER).unpack_from(payload, 4)
    return register, float(value)
