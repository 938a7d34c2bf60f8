"""What ``[axis.drive]`` of motors in MIT mode has in common."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, Self

import msgspec

from mcserver.can.port import MAX_PAYLOAD
from mcserver.drives.mit_numbers import step
from mcserver.drives.streamed import StreamedDrive
from mcserver.machine.bus_load import Share, frame_bits
from mcserver.machine.constraints import NotNegative
from mcserver.machine.drive import Refusal

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.sections import AxisSection

# Steps of the position that the travel stays away from the ends of ±p_max, where readings stand still.
SPARE_STEPS = 16
GAINS: Mapping[str, str] = MappingProxyType({"kp": "such as 20 and 1", "kd": "such as 20 and 1"})


class MitDrive(StreamedDrive, frozen=True, tag="mit"):
    """A motor that follows position, velocity, stiffness, damping and torque of one frame.

    Attributes:
        position_bits, velocity_bits: of the numbers in its frames. extended: these have identifiers of 29
            bits. needed: keys that are above 0, and for people what to give there.
        p_max, v_max, t_max: greatest magnitudes that a frame can say [rad, rad/s, N·m].
        kp, kd: stiffness [N·m/rad] and damping [N·m·s/rad] while it follows positions; damping alone while it
            follows a velocity or stops.
        torque_feed_forward: the torque that the motion needs by the machine's model goes with positions.
    """

    position_bits: ClassVar[int] = 16
    velocity_bits: ClassVar[int] = 16
    extended: ClassVar[bool] = False
    needed: ClassVar[Mapping[str, str]] = GAINS
    p_max: NotNegative = 0.0
    v_max: NotNegative = 0.0
    t_max: NotNegative = 0.0
    kp: NotNegative = 0.0
    kd: NotNegative = 0.0
    torque_feed_forward: bool = False

    @property
    def takes_torques(self) -> bool:
        return self.torque_feed_forward

    @property
    def position_step(self) -> float:
        """Step of positions in its frames [rad]."""
        return step(self.p_max, self.position_bits)

    @property
    def velocity_step(self) -> float:
        """Step of velocities in its frames [rad/s]."""
        return step(self.v_max, self.velocity_bits)

    @classmethod
    def shares(cls, axes: Sequence[Axis], cycle_hz: float) -> list[Share]:  # noqa: ARG003
        count, bits = float(len(axes)), frame_bits(MAX_PAYLOAD, extended=cls.extended)
        return [Share("commands", count, bits), Share("feedback", count, bits)]

    def complete(self, axis: AxisSection, cycle_s: float, bad: Refusal) -> tuple[Self, float | None]:
        for key, hint in self.needed.items():
            if getattr(self, key) <= 0.0:
                bad(key, "is missing", f"give {key} = {hint}")
                return self, axis.units_per_motor_rev
        # counts are the steps of the frame: the motor says radians of its output shaft
        steps = round(2.0 * math.pi / self.position_step)
        drive = msgspec.structs.replace(self, counts_per_motor_rev=steps)
        completed, per_turn = StreamedDrive.complete(drive, axis, cycle_s, bad)
        if per_turn is not None:
            self._check_ranges(axis, per_turn, bad)
        return completed, per_turn

    def _check_ranges(self, axis: AxisSection, per_turn: float, bad: Refusal) -> None:
        """Refuse motion that the motor's frames cannot say.

        Args:
            per_turn: travel of the axis by a turn of the output shaft [mm, deg].
        """
        reach = (self.p_max - SPARE_STEPS * self.position_step) / (2.0 * math.pi) * per_turn
        low, high = axis.min_position, axis.max_position
        if low is None or high is None or low < -reach or high > reach:
            bad(
                "p_max",
                f"positions go from {-reach:.6g} to {reach:.6g} of the axis, and the travel goes beyond",
                "give min_position and max_position within that, or a motor with a greater range",
            )
        fastest = self.v_max / (2.0 * math.pi) * per_turn
        if axis.max_velocity > fastest:
            bad(
                "v_max",
                f"speeds go up to {fastest:.6g} of the axis, and max_velocity is {axis.max_velocity:g}",
                "lower max_velocity, or give a motor with a greater range",
            )
