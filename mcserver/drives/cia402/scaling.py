"""SI ↔ the numbers of a CiA 402 drive. On the wire a position is a count of encoder increments, always.

A count is 32 bits and wraps; an axis without limits turns on past the wrap. `PositionTracker` follows it with
differences modulo 2³², so a position is right as long as an axis moves less than 2³¹ counts between readings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mcserver.drives.cia402.drive import Cia402Drive, cia402_drive
from mcserver.machine.axis import Axis
from mcserver.machine.drive import CanDrive

Array = NDArray[np.float64]

PERMILLE = 1000.0
TORQUE_LIMIT = 32767.0


@dataclass(frozen=True)
class Scaling:
    """Factors of one axis; negative where the motor turns against the axis.

    Attributes:
        counts_per_si: increments of the encoder per m or rad of the axis.
        velocity_per_si: of 60FFh and 606Ch per m/s or rad/s.
        permille_per_nm: of 6071h and 6077h per N·m; 0 where the rated torque is not known.
    """

    counts_per_si: float
    velocity_per_si: float
    permille_per_nm: float

    @classmethod
    def of(cls, axis: Axis) -> Scaling:
        """Of an axis of a `Machine`, whose drive's section is filled in."""
        drive = axis.drive
        if not isinstance(drive, CanDrive) or drive.encoder is None:
            raise ValueError(f"axis {axis.index} has no encoder: it is not on a bus")
        counts_per_turn = drive.encoder[0] / drive.encoder[1]
        sign = -1.0 if drive.invert else 1.0
        turns_per_si = sign / axis.travel_per_motor_turn
        velocity_per_turn = drive.velocity_counts_per_motor_rev or counts_per_turn
        torque = sign * PERMILLE / drive.rated_torque if drive.rated_torque > 0.0 else 0.0
        return cls(counts_per_turn * turns_per_si, velocity_per_turn * turns_per_si, torque)


def scaling_objects(drive: Cia402Drive) -> tuple[tuple[int, int, int], ...]:
    """(index, subindex, value) for 608Fh, 6091h and 6092h so that the drive's unit of position is one
    increment of its encoder; empty where the machine file leaves them to the drive.

    6092h gets the increments of a turn of the shaft: encoder × gear (IEC 61800-7-201, 7.3.5.10).
    """
    if drive.encoder is None or drive.gear is None:
        return ()
    (increments, revolutions), (motor, shaft) = drive.encoder, drive.gear
    return (
        (0x608F, 1, increments),
        (0x608F, 2, revolutions),
        (0x6091, 1, motor),
        (0x6091, 2, shaft),
        (0x6092, 1, increments * motor),
        (0x6092, 2, revolutions * shaft),
    )


def homing_objects(axis: Axis) -> tuple[tuple[int, int, int], ...]:
    """(index, subindex, value) for the drive's own homing, in increments; empty where it has none.

    6098h method, 6099h speeds, 609Ah acceleration, 607Ch home offset: after homing the drive shows this
    count at the home position.
    """
    drive = cia402_drive(axis)
    homing = drive.homing
    if homing is None:
        return ()
    scale = Scaling.of(axis)
    unit = axis.type.si_per_unit
    speed = abs(scale.velocity_per_si) * unit
    home = (homing.position - drive.zero_offset) * unit * scale.counts_per_si
    return (
        (0x6098, 0, homing.method),
        (0x6099, 1, max(1, round(homing.speed_switch * speed))),
        (0x6099, 2, max(1, round(homing.speed_zero * speed))),
        (0x609A, 0, max(1, round(homing.acceleration * abs(scale.counts_per_si) * unit))),
        (0x607C, 0, round(home)),
    )


def profile_objects(axis: Axis) -> tuple[tuple[int, int, int], ...]:
    """(index, subindex, value) for the drive's own profiles: the axis's limits, rounded down; empty where it
    does not make any.

    6081h velocity, 6083h acceleration, 6084h deceleration, 6086h trapezoids, 605Dh a halt by a ramp. With
    mode = "cst" 6072h is the greatest torque, where the machine file says it.
    """
    drive = cia402_drive(axis)
    if drive.mode == "cst" and drive.max_torque > 0.0:
        return ((0x6072, 0, math.floor(drive.max_torque / drive.rated_torque * PERMILLE)),)
    if not axis.profiled:
        return ()
    scale = Scaling.of(axis)
    acceleration = max(1, math.floor(axis.max_acceleration * abs(scale.counts_per_si)))
    return (
        (0x6081, 0, max(1, math.floor(axis.max_velocity * abs(scale.velocity_per_si)))),
        (0x6083, 0, acceleration),
        (0x6084, 0, acceleration),
        (0x6086, 0, 0),
        (0x605D, 0, 1),
    )


def wrapped(counts: Array) -> NDArray[np.int32]:
    """Whole numbers as 32-bit ones, modulo 2³²; shape as given."""
    return counts.astype(np.int64).astype(np.int32)


class PositionTracker:
    """Counts beyond 32 bits of n axes, from 32-bit readings.

    Attributes:
        counts: shape (n,), what has been counted; modulo 2³² it is the latest reading.
    """

    def __init__(self, axes: int) -> None:
        self.counts = np.zeros(axes, np.int64)
        self._last = np.zeros(axes, np.int32)
        self._change = np.zeros(axes, np.int32)

    def restart(self, index: int, reading: int) -> None:
        """An axis begins with this reading, as after its drive was switched on."""
        self._last[index] = reading
        self.counts[index] = reading

    def follow(self, readings: NDArray[np.int32]) -> None:
        """The next readings; shape (n,)."""
        np.subtract(readings, self._last, out=self._change)
        self._last[:] = readings
        self.counts += self._change
