"""``[axis.drive]`` with kind = "damiao": its keys, its share of a bus, and what its feedback says."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, ClassVar, Self

import msgspec
from msgspec import Meta

from mcserver.drives.damiao.codec import (
    FAULTS,
    FIRST_FAULT,
    GREATEST_KD,
    GREATEST_KP,
    REGISTERS,
    Ranges,
    refresh_request,
)
from mcserver.drives.mit_drive import GAINS, MitDrive
from mcserver.drives.streamed import StreamedAxis
from mcserver.machine.drive import Refusal

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.sections import AxisSection

# Feedback comes by a motor's number and this, where the machine file does not say.
USUAL_OFFSET = 0x10
GREATEST_IDENTIFIER = 0x7F


class DamiaoDrive(MitDrive, frozen=True, tag="damiao"):
    """A Damiao motor in MIT mode; its node number is ESC_ID.

    Attributes:
        feedback_id: MST_ID of the motor. p_max, v_max, t_max: its registers PMAX, VMAX and TMAX.
    """

    borrowed_key: ClassVar[str] = "feedback_id"
    velocity_bits: ClassVar[int] = 12
    needed: ClassVar[Mapping[str, str]] = MappingProxyType(
        {key: f"the motor's register {key.upper().replace('_', '')}" for key in ("p_max", "v_max", "t_max")}
        | dict(GAINS)
    )
    feedback_id: Annotated[
        int, Meta(ge=0, le=GREATEST_IDENTIFIER, description="MST_ID of the motor, 1 to 127")
    ] = 0
    kp: Annotated[float, Meta(ge=0.0, le=GREATEST_KP, description="0 to 500 N·m/rad")] = 0.0
    kd: Annotated[float, Meta(ge=0.0, le=GREATEST_KD, description="0 to 5 N·m·s/rad")] = 0.0

    @property
    def ranges(self) -> Ranges:
        return Ranges(self.p_max, self.v_max, self.t_max)

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
        feedback_id = self.feedback_id or self.node + USUAL_OFFSET
        if feedback_id > GREATEST_IDENTIFIER or feedback_id == self.node:
            bad(
                "feedback_id",
                f"feedback cannot come by {feedback_id:02X}h",
                "set MST_ID in the motor to 1 … 127, not the number of the motor, and give it here",
            )
        drive = msgspec.structs.replace(self, feedback_id=feedback_id)
        return MitDrive.complete(drive, axis, cycle_s, bad)

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
