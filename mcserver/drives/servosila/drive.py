"""``[axis.drive]`` with kind = "servosila": its keys, the codes of its commands, and its share of a bus."""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Self

import msgspec
from msgspec import Meta

from mcserver.drives.bus import DriveMode
from mcserver.drives.servosila.codec import fault_bits_text, unpack_status
from mcserver.drives.streamed import StreamedAxis, StreamedDrive
from mcserver.machine.bus_load import Share, frame_bits
from mcserver.machine.constraints import NotNegative
from mcserver.machine.drive import Refusal
from mcserver.machine.section_reader import did_you_mean

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis
    from mcserver.machine.sections import AxisSection

# Codes of Servosila's commands that its public reference gives; the others come from the machine file.
CODES = MappingProxyType({"reset": 0x01, "stop": 0x04, "speed": 0x20, "servo": 0x30, "reset_work_zone": 0xE0})
OWN_CODES = ("off", "rpm", "torque")
# What the public reference uses these codes for: a command of another meaning must not get one of them.
PUBLISHED = MappingProxyType(
    {
        0x01: "Reset",
        0x04: "Stop",
        0x20: "Electronic Speed Control (Hz)",
        0x30: "Servo",
        0x38: "Servo Stepper, an offset from the current position: streamed, it makes the axis run away",
        0x58: "Kickstart",
        0xA4: "PWM output",
        0xB0: "a load test",
        0xE0: "Reset Work Zone",
    }
)
FRAME_BYTES = 8
TELEMETRY_FRAMES = 3


class ServosilaDrive(StreamedDrive, frozen=True, tag="servosila"):
    """A Servosila drive.

    Attributes:
        codes: of commands. pole_pairs: of the motor. telemetry_hz: 0: at every cycle.
    """

    codes: dict[str, int] = msgspec.field(default_factory=dict)
    pole_pairs: Annotated[int, Meta(ge=0, le=1000, description="see the motor's data")] = 0
    telemetry_hz: NotNegative = 0.0

    def has_mode(self, mode: int) -> bool:
        if mode == DriveMode.TORQUE:
            return "torque" in self.codes
        return mode != DriveMode.VELOCITY or self.pole_pairs > 0 or "rpm" in self.codes

    def answer_cycles(self, cycle_s: float) -> int:
        return 1 if self.telemetry_hz <= 0.0 else math.ceil(1.0 / (self.telemetry_hz * cycle_s) - 1e-9)

    def complete(self, axis: AxisSection, cycle_s: float, bad: Refusal) -> tuple[Self, float | None]:
        _check_codes(self, bad)
        codes = {**CODES, **self.codes}
        return StreamedDrive.complete(msgspec.structs.replace(self, codes=codes), axis, cycle_s, bad)

    @classmethod
    def shares(cls, axes: Sequence[Axis], cycle_hz: float) -> list[Share]:  # noqa: ARG003
        rates = [axis.drive.telemetry_hz for axis in axes if isinstance(axis.drive, ServosilaDrive)]
        every_cycle, own_rate = float(rates.count(0.0)), sum(rates)
        bits = frame_bits(FRAME_BYTES)
        return [
            Share("commands", float(len(axes)), bits),
            Share("telemetry", TELEMETRY_FRAMES * every_cycle, bits, TELEMETRY_FRAMES * own_rate),
        ]

    def axis(self, axis: Axis, cycle_s: float, silence_cycles: int) -> StreamedAxis:
        # what is in the cycle is needed by those only who run one
        from mcserver.drives.servosila.axis import ServosilaAxis

        return ServosilaAxis(axis, self, cycle_s, silence_cycles)

    def fault_bits(self, telemetry: bytes) -> int | None:
        return int.from_bytes(telemetry[:2], "little") if len(telemetry) >= 2 else None

    def fault_text(self, bits: int) -> str:
        return f"fault bits {fault_bits_text(bits)}" if bits else "no fault"

    def monitored(self, telemetry: bytes) -> dict[str, float]:
        status = unpack_status(telemetry)
        return {} if status is None else {"DC bus voltage [V]": status.dc_bus_volts}


DRIVE = ServosilaDrive


def _check_codes(drive: ServosilaDrive, bad: Refusal) -> None:
    known = (*CODES, *OWN_CODES)
    for name, code in drive.codes.items():
        if name not in known:
            hint = did_you_mean(name, known, f"known codes: {', '.join(known)}")
            bad("codes", f"there is no command {name!r}", hint)
        elif not 0 <= code <= 0xFF:
            bad("codes", f"{name} = {code} is outside 0 … 255", "see the drive's reference")
        elif code in PUBLISHED and CODES.get(name) != code:
            bad(
                "codes",
                f"{name} = 0x{code:02X}: {code:02X}h is {PUBLISHED[code]}",
                f"take the code of {name} from the drive's reference"
                + (", or leave the key out" if name in CODES else ""),
            )
    by_code: dict[int, str] = {}
    for name, code in {**CODES, **drive.codes}.items():
        if code in by_code:
            bad("codes", f"{code:02X}h is the code of {name} and of {by_code[code]}", "give each its own")
        by_code[code] = name
    if "off" not in drive.codes and not any(name not in known for name in drive.codes):
        bad(
            "codes",
            "the code of Off is missing: the drive could not be de-energized",
            "give codes = { off = … } from the drive's reference",
        )
