"""``[axis.drive]`` with kind = "damiao": its keys, its share of a bus, and what its feedback says."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, ClassVar, Self

import msgspec
from msgspec import Meta

from mcserver.drives.damiao.codec import (
    FAULTS,
    FIRST_FAULT,
    GREATEST_KD,
    GREATEST_KP,
    LENGTH,
    REGISTERS,
    Ranges,
    position_step,
    refresh_request,
)
from mcserver.drives.streamed import StreamedAxis, StreamedDrive
from mcserver.machine.bus_load import Share, frame_bits
from mcserver.machine.constraints import NotNegative
from mcserver.machine.drive import Refusal

if TYPE_CHECKING:
    from mcserver.machine.machine_file import Axis
    from mcserver.machine.sections import AxisSection

# Feedback comes by a motor's number and this, where the machine file does not say.
USUAL_OFFSET = 0x10
GREATEST_IDENTIFIER = 0x7F
# Steps of the position that the travel stays away from the ends of ±PMAX, where readings stand still.
SPARE_STEPS = 16


class DamiaoDrive(StreamedDrive, frozen=True, tag="damiao"):
    """A Damiao motor in MIT mode; its node number is ESC_ID.

    Attributes:
        feedback_id: MST_ID of the motor. p_max, v_max, t_max: its registers PMAX [rad], VMAX [rad/s] and TMAX
            [N·m]. kp, kd: stiffness [N·m/rad] and damping [N·m·s/rad] while it follows positions; damping
            alone while it follows a velocity or stops. torque_feed_forward: the torque that the motion needs
            by the machine's model goes with positions.
    """

    borrowed_key: ClassVar[str] = "feedback_id"
    feedback_id: Annotated[
        int, Meta(ge=0, le=GREATEST_IDENTIFIER, description="MST_ID of the motor, 1 to 127")
    ] = 0
    p_max: NotNegative = 0.0
    v_max: NotNegative = 0.0
    t_max: NotNegative = 0.0
    kp: Annotated[float, Meta(ge=0.0, le=GREATEST_KP, description="0 to 500 N·m/rad")] = 0.0
    kd: Annotated[float, Meta(ge=0.0, le=GREATEST_KD, description="0 to 5 N·m·s/rad")] = 0.0
    torque_feed_forward: bool = False

    @property
    def ranges(self) -> Ranges:
        return Ranges(self.p_max, self.v_max, self.t_max)

    @property
    def takes_torques(self) -> bool:
        return self.torque_feed_forward

    @property
    def borrowed_node(self) -> int:
        return self.feedback_id

    @property
    def telemetry_ids(self) -> tuple[int, ...]:
        return (self.feedback_id,)

    @property
    def foreign_ids(self) -> tuple[int, ...]:
        # it sends only what somebody asks for
        return self.node, self.feedback_id

    @property
    def question(self) -> tuple[int, bytes]:
        return REGISTERS, refresh_request(self.node)

    def complete(self, axis: AxisSection, cycle_s: float, bad: Refusal) -> tuple[Self, float | None]:
        for key in ("p_max", "v_max", "t_max", "kp", "kd"):
            if getattr(self, key) <= 0.0:
                registers = key in ("p_max", "v_max", "t_max")
                hint = (
                    f"the motor's register {key.upper().replace('_', '')}"
                    if registers
                    else "such as 20 and 1"
                )
                bad(key, "is missing", f"give {key} = {hint}")
                return self, axis.units_per_motor_rev
        feedback_id = self.feedback_id or self.node + USUAL_OFFSET
        if feedback_id > GREATEST_IDENTIFIER or feedback_id == self.node:
            bad(
                "feedback_id",
                f"feedback cannot come by {feedback_id:02X}h",
                "set MST_ID in the motor to 1 … 127, not the number of the motor, and give it here",
            )
        # counts are the steps of the frame: the motor says radians of its output shaft
        steps = round(2.0 * math.pi / position_step(self.p_max))
        drive = msgspec.structs.replace(self, counts_per_motor_rev=steps, feedback_id=feedback_id)
        completed, per_turn = StreamedDrive.complete(drive, axis, cycle_s, bad)
        if per_turn is not None:
            _check_ranges(self, axis, per_turn, bad)
        return completed, per_turn

    @classmethod
    def shares(cls, axes: Sequence[Axis], cycle_hz: float) -> list[Share]:  # noqa: ARG003
        count, bits = float(len(axes)), frame_bits(LENGTH)
        return [Share("commands", count, bits), Share("feedback", count, bits)]

    def axis(self, axis: Axis, cycle_s: float, silence_cycles: int) -> StreamedAxis:
        # what is in the cycle is needed by those only who run one
        from mcserver.drives.damiao.axis import DamiaoAxis

        return DamiaoAxis(axis, self, cycle_s, silence_cycles)

    def fault_bits(self, telemetry: bytes) -> int | None:
        feedback = self.ranges.decode_feedback(self.node, telemetry)
        if feedback is None:
            return None
        return feedback.status if feedback.status >= FIRST_FAULT else 0

    def fault_text(self, bits: int) -> str:
        return f"fault {bits:X}h: {FAULTS.get(bits, 'unknown')}" if bits else "no fault"

    def monitored(self, telemetry: bytes) -> dict[str, float]:
        feedback = self.ranges.decode_feedback(self.node, telemetry)
        if feedback is None:
            return {}
        return {
            "torque [N·m]": feedback.torque,
            "MOS temperature [°C]": feedback.mos_celsius,
            "coil temperature [°C]": feedback.coil_celsius,
        }


DRIVE = DamiaoDrive


def _check_ranges(drive: DamiaoDrive, axis: AxisSection, per_turn: float, bad: Refusal) -> None:
    """Refuse motion that the motor's frames cannot say.

    Args:
        per_turn: travel of the axis by a turn of the output shaft [mm, deg].
    """
    reach = (drive.p_max - SPARE_STEPS * position_step(drive.p_max)) / (2.0 * math.pi) * per_turn
    low, high = axis.min_position, axis.max_position
    if low is None or high is None or low < -reach or high > reach:
        bad(
            "p_max",
            f"positions go from {-reach:.6g} to {reach:.6g} of the axis, and the travel does not end there",
            "give min_position and max_position within that, or a motor with a greater PMAX",
        )
    fastest = drive.v_max / (2.0 * math.pi) * per_turn
    if axis.max_velocity > fastest:
        bad(
            "v_max",
            f"speeds go up to {fastest:.6g} of the axis, and max_velocity is {axis.max_velocity:g}",
            "lower max_velocity, or set a greater VMAX in the motor and here",
        )
