"""The process data that master and drive agree on: written into the drives at boot-up, packed in every cycle.

An axis takes one RPDO and one TPDO a cycle: RPDO1 in position mode, RPDO2 in velocity and torque mode (both
in the cycle of a change of mode, since only RPDO1 has the mode). TPDO2 comes with every `SLOW_SYNCS`-th SYNC.
"""

from __future__ import annotations

import enum
import struct
from collections.abc import Iterable
from dataclasses import dataclass

from mcserver.can.pdo import MappedObject


@dataclass(frozen=True)
class Pdo:
    """One PDO.

    Attributes:
        number: 1 … 4, of the predefined connection set. objects: in order. packing: the same as a `struct`.
        transmission: type (1400h:2, 1800h:2): n = at every n-th SYNC.
    """

    number: int
    objects: tuple[MappedObject, ...]
    packing: struct.Struct
    transmission: int


class Mode(enum.IntEnum):
    """Modes of operation, 6060h and 6061h."""

    NONE = 0
    PROFILE_POSITION = 1
    PROFILE_VELOCITY = 3
    HOMING = 6
    INTERPOLATED_POSITION = 7
    CYCLIC_POSITION = 8
    CYCLIC_VELOCITY = 9
    CYCLIC_TORQUE = 10


SLOW_SYNCS = 10

CONTROLWORD = MappedObject(0x6040, 0, 16)
STATUSWORD = MappedObject(0x6041, 0, 16)
MODE = MappedObject(0x6060, 0, 8)
MODE_DISPLAY = MappedObject(0x6061, 0, 8)
POSITION_ACTUAL = MappedObject(0x6064, 0, 32)
VELOCITY_ACTUAL = MappedObject(0x606C, 0, 32)
TARGET_TORQUE = MappedObject(0x6071, 0, 16)
TORQUE_ACTUAL = MappedObject(0x6077, 0, 16)
TARGET_POSITION = MappedObject(0x607A, 0, 32)
TARGET_VELOCITY = MappedObject(0x60FF, 0, 32)

RPDO1 = Pdo(1, (CONTROLWORD, MODE, TARGET_POSITION), struct.Struct("<Hbi"), 1)
RPDO2 = Pdo(2, (CONTROLWORD, TARGET_VELOCITY, TARGET_TORQUE), struct.Struct("<Hih"), 1)
TPDO1 = Pdo(1, (STATUSWORD, MODE_DISPLAY, POSITION_ACTUAL), struct.Struct("<Hbi"), 1)
TPDO2 = Pdo(2, (VELOCITY_ACTUAL, TORQUE_ACTUAL), struct.Struct("<ih"), SLOW_SYNCS)


def rpdo1_cycles(timeouts_ms: Iterable[float], cycle_s: float) -> int:
    """Return every how many cycles RPDO1 goes out besides RPDO2: three times in the shortest time-out."""
    return max(1, min(SLOW_SYNCS, *(int(timeout / 3e3 / cycle_s) for timeout in timeouts_ms), SLOW_SYNCS))
