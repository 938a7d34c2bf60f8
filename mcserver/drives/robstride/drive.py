"""``[axis.drive]`` with kind = "robstride": its keys, its share of a bus, and what its feedback says."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, Self

from mcserver.can.port import recipient
from mcserver.drives.mit_drive import GAINS, MitDrive
from mcserver.drives.robstride.codec import (
    FAULTS,
    USUAL_P_MAX,
    Kind,
    Mode,
    Parameter,
    Ranges,
    State,
    answer_identifier,
    feedback_identifier,
    feedback_identifiers,
    parameter_payload,
    to_motor,
)
from mcserver.drives.streamed import StreamedAxis
from mcserver.machine.constraints import NotNegative
from mcserver.machine.drive import Refusal

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.sections import AxisSection

_RANGE = "the end of the motor's range in its manual's table of commands"


class RobstrideDrive(MitDrive, frozen=True, tag="robstride"):
    """A RobStride motor by its private protocol; its node number is its CAN_ID.

    Attributes:
        kp_max, kd_max: of the ranges of its model, as p_max, v_max and t_max.
    """

    extended: ClassVar[bool] = True
    needed: ClassVar[Mapping[str, str]] = MappingProxyType(
        dict.fromkeys(("p_max", "v_max", "t_max", "kp_max", "kd_max"), _RANGE) | dict(GAINS)
    )
    p_max: NotNegative = USUAL_P_MAX
    kp_max: NotNegative = 0.0
    kd_max: NotNegative = 0.0

    @property
    def ranges(self) -> Ranges:
        return Ranges(self.p_max, self.v_max, self.t_max, self.kp_max, self.kd_max)

    @property
    def telemetry_ids(self) -> tuple[int, ...]:
        running = feedback_identifier(self.node, State(Mode.RUN, 0))
        return running, answer_identifier(self.node), *feedback_identifiers(self.node)

    @property
    def foreign_ids(self) -> tuple[int, ...]:
        return (recipient(to_motor(Kind.STOP, self.node)),)

    @property
    def question(self) -> tuple[int, bytes]:
        return to_motor(Kind.READ, self.node), parameter_payload(Parameter.MECH_POS)

    def complete(self, axis: AxisSection, cycle_s: float, bad: Refusal) -> tuple[Self, float | None]:
        for key, most in (("kp", self.kp_max), ("kd", self.kd_max)):
            if getattr(self, key) > most > 0.0:
                bad(key, f"is beyond {key}_max, {most:g}", f"give {key} = {most:g} at most")
        return super().complete(axis, cycle_s, bad)

    def axis(self, axis: Axis, cycle_s: float, silence_cycles: int) -> StreamedAxis:
        # what is in the cycle is needed by those only who run one
        from mcserver.drives.robstride.axis import RobstrideAxis

        return RobstrideAxis(axis, self, cycle_s, silence_cycles)

    def fault_bits(self, telemetry: bytes) -> int | None:  # noqa: ARG002
        # they are in the identifier
        return None

    def fault_text(self, bits: int) -> str:
        names = [name for bit, name in FAULTS.items() if bits & bit]
        return f"fault {bits:02X}h: {', '.join(names)}" if bits else "no fault"

    def monitored(self, telemetry: bytes) -> dict[str, float]:
        feedback = self.ranges.decode_feedback(telemetry)
        if feedback is None:
            return {}
        return {"torque [N·m]": feedback.torque, "coil temperature [°C]": feedback.coil_celsius}


DRIVE = RobstrideDrive
