"""Scale of a drive: what its objects say, and what a measured move says, as lines of the machine file."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mcserver.canopen.cycle_samples import WRAP
from mcserver.canopen.desk import Desk
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.errors import UsageFault
from mcserver.machine.axis import Axis

ENCODER, GEAR, FEED = 0x608F, 0x6091, 0x6092
# A move that is measured worse than this proves nothing; one that fits as well is taken for right [1].
ACCURACY = 0.01
LEAST_COUNTS = 100
Ratio = tuple[int, int]


@dataclass(frozen=True)
class DriveScale:
    """608Fh, 6091h and 6092h; None: the drive does not have the object, or it holds 0.

    Attributes:
        encoder: increments, motor turns. gear: motor turns, shaft turns. feed: position units, shaft turns.
    """

    encoder: Ratio | None
    gear: Ratio | None
    feed: Ratio | None

    @property
    def units_per_motor_turn(self) -> float | None:
        """What 6064h counts in a turn of the motor (IEC 61800-7-201, 7.3.5); None where that is unknown."""
        if self.feed is not None:
            motor, shaft = self.gear or (1, 1)
            return self.feed[0] / self.feed[1] * shaft / motor
        return None if self.encoder is None else self.encoder[0] / self.encoder[1]


def scale_of(desk: Desk) -> DriveScale:
    """Ask a drive for its scale.

    Raises:
        DriveError: MC554. RuntimeFault: MC560.
    """

    def ratio(index: int) -> Ratio | None:
        first, second = (desk.read_number(index + desk.drive.offset, subindex) for subindex in (1, 2))
        return (first, second) if first and second else None

    return DriveScale(ratio(ENCODER), ratio(GEAR), ratio(FEED))


def proposed_lines(scale: DriveScale, pitch: float | None) -> list[str]:
    """Lines of the machine file that the drive's objects and a pitch give.

    Args:
        pitch: mm or degrees of the axis for a turn of the shaft; None: not known.
    """
    lines = []
    motor, shaft = scale.gear or (1, 1)
    if pitch is not None:
        lines.append(
            f"units_per_motor_rev = {pitch * shaft / motor:.9g}   # in [[axis]]: from the pitch {pitch:g}"
        )
    if scale.encoder is not None:
        lines.append(f"encoder = [{scale.encoder[0]}, {scale.encoder[1]}]   # in [axis.drive]: 608Fh")
    if scale.gear is not None:
        lines.append(f"gear = [{motor}, {shaft}]   # in [axis.drive]: 6091h")
    return lines


@dataclass(frozen=True)
class MeasuredScale:
    """What a move says of the machine file's scale.

    Attributes:
        motor_turns: that the drive counted. shown: the same by the machine file [mm or deg].
        per_turn: measured travel a turn of the motor, per_turn_of_file: that of the file; both without sign.
        reversed: the motor turns against what the file says.
    """

    motor_turns: float
    shown: float
    per_turn: float
    per_turn_of_file: float
    reversed: bool

    @property
    def error(self) -> float:
        """By how much the file's scale is too great [1]."""
        return self.per_turn_of_file / self.per_turn - 1.0

    @property
    def fits(self) -> bool:
        return not self.reversed and abs(self.error) <= ACCURACY


def counted(before: int, after: int) -> float:
    """Return by how many counts 6064h has changed, the shorter way round its 32 bits."""
    return (after - before + WRAP / 2) % WRAP - WRAP / 2


def measured_scale(axis: Axis, counts: float, units_per_motor_turn: float, moved: float) -> MeasuredScale:
    """Compare a measured move with the machine file.

    Args:
        counts: that 6064h has changed by. units_per_motor_turn: of 6064h. moved: as measured [mm or deg].

    Raises:
        UsageFault: MC017 a move that says nothing.
    """
    drive = cia402_drive(axis)
    if not math.isfinite(moved) or moved == 0.0 or abs(counts) < LEAST_COUNTS:
        raise UsageFault(
            "MC017",
            f"a move of {moved:g} that is {counts:g} counts says nothing of the scale",
            f"move the axis by at least {LEAST_COUNTS} counts, and measure how far it went",
        )
    turns = counts / units_per_motor_turn
    per_turn_of_file = axis.travel_per_motor_turn / axis.type.si_per_unit
    return compared(turns, turns * per_turn_of_file * (-1.0 if drive.invert else 1.0), moved)


def compared(motor_turns: float, shown: float, moved: float) -> MeasuredScale:
    """Compare what a machine shows of a move, neither 0, with what was measured [mm or deg]."""
    per_turn, per_turn_of_file = abs(moved / motor_turns), abs(shown / motor_turns)
    return MeasuredScale(motor_turns, shown, per_turn, per_turn_of_file, shown * moved < 0.0)


def corrected_lines(axis: Axis, found: MeasuredScale) -> list[str]:
    """Lines of the machine file that would make it fit; empty where it does."""
    lines = []
    if abs(found.error) > ACCURACY:
        was = f"{found.per_turn_of_file:.6g}"
        lines.append(f"units_per_motor_rev = {found.per_turn:.6g}   # in [[axis]]: the file has {was}")
    if found.reversed:
        lines.append(f"invert = {str(not cia402_drive(axis).invert).lower()}   # in [axis.drive]")
    return lines
