"""Frames of Servosila's drives (public device reference 0xA020192): commands and telemetry, little-endian."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from types import MappingProxyType

from mcserver.can.cob import Function

# Function codes of the predefined connection set, used with another meaning.
COMMAND = Function.RPDO1
STATUS = Function.TPDO1
POSITION = Function.TPDO2

COMMAND_PACKING = struct.Struct("<B3xf")
STATUS_PACKING = struct.Struct("<Hhf")
POSITION_PACKING = struct.Struct("<ff")
LENGTH = 8
# The reference's FLOAT16 is a signed 16-bit number, linear over ±128.
FLOAT16_UNIT = 128.0 / 32767.0

# Bits of the word "Fault Bits" (reference, page 39; also 4000h:03).
FAULT_BITS = MappingProxyType(
    {
        0x0001: "driver chip fault",
        0x0002: "driver chip overheating",
        0x0004: "overheating protection",
        0x0008: "overcurrent protection",
        0x0010: "thermistor overheating",
        0x0020: "Hall sensors fault",
        0x0040: "quadrature encoder fault",
        0x0080: "SSI encoder fault",
        0x0100: "SPI encoder fault",
        0x0200: "PWM encoder fault",
        0x4000: "emergency stop",
        0x8000: "activation key is missing",
    }
)


@dataclass(frozen=True)
class Status:
    """Telemetry 180h: fault bits, 0 without a fault; DC bus voltage [V]; electrical speed [Hz]."""

    fault_bits: int
    dc_bus_volts: float
    electrical_hz: float


@dataclass(frozen=True)
class Reading:
    """Telemetry 280h: electrical position [rad], count of the multi-turn work zone."""

    electrical: float
    work_zone: float


def unpack_status(payload: bytes) -> Status | None:
    """Decode telemetry 180h; None where the payload has another length."""
    if len(payload) != LENGTH:
        return None
    bits, volts, hertz = STATUS_PACKING.unpack(payload)
    return Status(bits, volts * FLOAT16_UNIT, hertz)


def unpack_reading(payload: bytes) -> Reading | None:
    """Decode telemetry 280h; None where the payload has another length."""
    return Reading(*POSITION_PACKING.unpack(payload)) if len(payload) == LENGTH else None


def fault_bits_text(bits: int) -> str:
    """Name the fault bits: ``0104h: overheating protection, SPI encoder fault``."""
    names = [name for bit, name in FAULT_BITS.items() if bits & bit]
    unnamed = bits & ~sum(FAULT_BITS)
    if unnamed:
        names.append(f"bits {unnamed:04X}h without a name in the reference")
    return f"{bits:04X}h: {', '.join(names)}" if names else f"{bits:04X}h"
