"""Frames of Servosila's drives (public device reference): commands and telemetry, little-endian."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from mcserver.can.cob import Function

# Function codes of the predefined connection set, used with another meaning.
COMMAND = Function.RPDO1
STATUS = Function.TPDO1
POSITION = Function.TPDO2
CURRENTS = Function.TPDO3

COMMAND_PACKING = struct.Struct("<B3xf")
STATUS_PACKING = struct.Struct("<H2xf")
POSITION_PACKING = struct.Struct("<ff")
LENGTH = 8


@dataclass(frozen=True)
class Status:
    """Telemetry 180h: fault bits, 0 without a fault; electrical speed [Hz]."""

    fault_bits: int
    electrical_hz: float


@dataclass(frozen=True)
class Reading:
    """Telemetry 280h: electrical position [its own unit], count of the multi-turn work zone."""

    electrical: float
    work_zone: float


def unpack_status(payload: bytes) -> Status | None:
    """None: the payload is none of a status."""
    return Status(*STATUS_PACKING.unpack(payload)) if len(payload) == LENGTH else None


def unpack_reading(payload: bytes) -> Reading | None:
    """None: the payload is none of a reading."""
    return Reading(*POSITION_PACKING.unpack(payload)) if len(payload) == LENGTH else None
