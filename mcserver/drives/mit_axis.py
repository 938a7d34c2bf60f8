"""One motor in MIT mode: a frame in every cycle, which the motor answers with its feedback.

A motor goes on by its latest command until its time-out ends, which may be 0: for ever. So it is given the
time-out of the machine file each time before it is energized, as its power may have been away. What else has
to be so in it is read with that: a frame says other numbers to a motor with other ranges.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from enum import Enum, IntEnum
from typing import NamedTuple

from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.mit_drive import MitDrive
from mcserver.drives.mit_numbers import Feedback
from mcserver.drives.streamed import StreamedAxis
from mcserver.machine.axis import Axis
from mcserver.units import TURN

# An order may be answered so many cycles after it was sent.
ANSWER_CYCLES = 3
# A reading further from the one before than this multiple of what the motor can do is no motion; and so many
# steps of the frame are let pass in any case. After commands that were late it is faster than its axis.
JUMP_FACTOR = 1.5
JUMP_STEPS = 16
# Within so many steps of the frame from 0 a velocity is that of a motor that stands.
STANDING_STEPS = 1.6
# After a fault a motor brakes by damping for so long at most [s].
BRAKING_S = 1.0
# Frames with another length, number or state that come instead of feedback are of another protocol.
FOREIGN_FRAMES = 20
# A motor's range is the machine file's within this share: its registers are 32-bit floats.
SAME = 1e-5


class Power(Enum):
    """What a motor says of its power stage."""

    DISABLED = "disabled"
    ENABLED = "enabled"
    FAULT = "fault"


class Requirement(NamedTuple):
    """What a register has to have before a motor is energized.

    Attributes:
        written: it is written and read back. at_most: less is possible.
    """

    register: IntEnum
    value: float
    written: bool = False
    at_most: bool = False


class MitAxis(StreamedAxis):
    """State of one axis.

    Args:
        requirements: in the order in which they are read.
    """

    def __init__(
        self,
        axis: Axis,
        drive: MitDrive,
        cycle_s: float,
        silence_cycles: int,
        requirements: Sequence[Requirement],
    ) -> None:
        # while a motor is asked for its registers, its feedback comes every other cycle
        super().__init__(axis, silence_cycles + 1)
        sign = -1.0 if drive.invert else 1.0
        self._node = drive.node
        self._kp, self._kd = drive.kp, drive.kd
        self._sign = sign
        # radians of the output shaft, by the axis
        self._radians = sign * TURN / axis.travel_per_motor_turn
        self._greatest = JUMP_FACTOR * drive.v_max * cycle_s
        self._slack = JUMP_STEPS * drive.position_step
        self._standing = STANDING_STEPS * drive.velocity_step / abs(self._radians)
        self._requirements = tuple(requirements)
        self._checked = 0
        self._written = False
        self._asks = False
        self._since = 0
        self._power = Power.DISABLED
        self._motor_fault = DriveFault.NONE
        self._shaft = 0.0
        self._known = False
        self._foreign = 0
        self._braking_cycles = round(BRAKING_S / cycle_s)
        self._braking = 0

    # ------------------------------------------------------------------ frames of its protocol

    @abstractmethod
    def _send_enable(self) -> bool:
        """Send the order; False: it found no room."""

    @abstractmethod
    def _send_disable(self) -> bool:
        """Send the order, which a motor answers with its state; as `_send_enable`."""

    @abstractmethod
    def _send_clear(self) -> bool:
        """Send the order to clear a fault; as `_send_enable`."""

    @abstractmethod
    def _send_request(self, register: IntEnum, value: float | None) -> bool:
        """Ask for a register, or write it; as `_send_enable`."""

    @abstractmethod
    def _send_command(self, position: float, velocity: float, kp: float, kd: float, torque: float) -> bool:
        """Command the output shaft [rad, rad/s, N·m/rad, N·m·s/rad, N·m]; as `_send_enable`."""

    # ------------------------------------------------------------------ what has come

    def _take_feedback(self, feedback: Feedback, power: Power, fault: DriveFault) -> None:
        """Take a motor's feedback; ``fault``: where it is in one."""
        moved = abs(feedback.position - self._shaft)
        elapsed = max(1, self.age + 1)
        if self._known and moved > self._greatest * elapsed + self._slack:
            self.fail(DriveFault.POSITION_LOST)
        self._shaft = feedback.position
        self._power, self._motor_fault = power, fault
        self._known = True
        self.age = -1
        self.position = feedback.position / self._radians
        self.velocity = feedback.velocity / self._radians

    def _take_foreign(self, what: str, hint: str) -> None:
        """Count a frame in the place of feedback that is none."""
        self.short += 1
        self._foreign += 1
        if self._foreign == FOREIGN_FRAMES and not self._known:
            self.complaint = (what, hint)

    def _take_register(self, register: IntEnum, value: float) -> None:
        """Take what a register has."""
        if self.ready:
            return
        wanted = self._requirements[self._checked]
        if register is not wanted.register:
            return
        if wanted.written and not self._written:
            # this was the answer to the write: what the register has is read after it
            self._written = True
            return
        slack = SAME * abs(wanted.value) + (0.5 if wanted.written else 0.0)
        if abs(value - wanted.value) <= slack or (wanted.at_most and value < wanted.value):
            self._checked += 1
            self._written = False
            self.complaint = None
            return
        self._written = False
        needed = f"{wanted.value:g} at most fits" if wanted.at_most else f"{wanted.value:g} is needed"
        self.complaint = (
            f"the register {register.name} of the motor is {value:g}, {needed}",
            "set it in the maker's tool, or correct the machine file (kind, p_max, v_max, t_max)",
        )

    @property
    def ready(self) -> bool:
        """Whether its registers have been seen to be as they have to be."""
        return self._checked == len(self._requirements)

    @property
    def booted(self) -> bool:
        return self._known and self.ready

    def read(self) -> None:
        self.age += 1
        self.fresh = self.age <= (0 if self.ready else 1)

    def _check_again(self) -> None:
        self._checked = 0
        self._written = False

    def fail(self, fault: DriveFault, detail: int = 0) -> bool:
        latched = super().fail(fault, detail)
        if latched:
            self._braking = self._braking_cycles
        return latched

    # ------------------------------------------------------------------ what goes out

    def step(self, commanded: DriveMode, position: float, velocity: float, torque: float) -> bool:
        """One cycle: the state, and the frame; False: it found no room."""
        self._since = self._since + 1 if commanded is self._commanded else 0
        self._commanded = commanded
        if commanded is DriveMode.SILENT:
            self.state = DriveState.OFF if self.fault is DriveFault.NONE else DriveState.FAULT
            return True
        if commanded is DriveMode.RESET:
            return self._reset()
        if self._power is Power.FAULT and self.fresh:
            self.fail(self._motor_fault)
        if self.fault is not DriveFault.NONE:
            self.state = DriveState.FAULT
            return self._brake_or_disable()
        if commanded is DriveMode.STOP and self._power is Power.ENABLED:
            standing = abs(self.velocity) <= self._standing and self.fresh and self._since >= ANSWER_CYCLES
            self.state = DriveState.OFF if standing else DriveState.STOPPING
            return self._move(0.0, 0.0, 0.0, 0.0)
        if commanded in (DriveMode.OFF, DriveMode.STOP):
            self.state = DriveState.OFF
            return self._disable()
        if commanded not in (DriveMode.POSITION, DriveMode.VELOCITY, DriveMode.TORQUE):
            self.fail(DriveFault.NOT_CONFIGURED, int(commanded))
            self.state = DriveState.FAULT
            return self._disable()
        started = self.state is DriveState.ENERGIZED
        if not self._enabled():
            return self._enable()
        if not started:
            # until the axis counts as energized its target is where it is
            position, velocity, torque = self.position, 0.0, 0.0
        if commanded is DriveMode.TORQUE:
            return self._move(0.0, 0.0, 0.0, torque, damping=0.0)
        if commanded is DriveMode.VELOCITY:
            return self._move(0.0, 0.0, velocity, torque)
        return self._move(self._kp, position, velocity, torque)

    def _brake_or_disable(self) -> bool:
        """Brake a motor that still can by damping, which needs no position, and disable it then."""
        self._braking -= 1
        if self._braking <= 0 or self._power is not Power.ENABLED or abs(self.velocity) <= self._standing:
            self._braking = 0
            return self._disable()
        return self._move(0.0, 0.0, 0.0, 0.0)

    def _enabled(self) -> bool:
        """Go on to ENERGIZED; once there, a motor that is disabled has let go by itself."""
        if self.state is DriveState.ENERGIZED:
            if self._power is not Power.ENABLED:
                self.state = DriveState.OFF
            return self._power is Power.ENABLED
        if self.ready and self.fresh and self._power is Power.ENABLED:
            self.state = DriveState.ENERGIZED
            return True
        if self.state is not DriveState.STARTING:
            # its power may have been away for less than a silence that counts
            self._check_again()
        self.state = DriveState.STARTING
        return False

    def _enable(self) -> bool:
        if self.state is not DriveState.STARTING or not self.ready:
            return self._disable()
        return self._send_enable()

    def _reset(self) -> bool:
        if self.fresh and self._since >= ANSWER_CYCLES and self._power is Power.DISABLED:
            self.fault, self.detail = DriveFault.NONE, 0
            self.state = DriveState.OFF
        else:
            self.state = DriveState.FAULT if self.fault is not DriveFault.NONE else DriveState.STOPPING
        # the motor says its state when it is disabled
        return self._send_clear() if self._since % 2 else self._disable()

    def _disable(self) -> bool:
        """Disable the motor, and ask for its registers in turn with that."""
        self._asks = not self._asks and not self.ready
        if not self._asks:
            return self._send_disable()
        wanted = self._requirements[self._checked]
        return self._send_request(
            wanted.register, wanted.value if wanted.written and not self._written else None
        )

    def _move(
        self, stiffness: float, position: float, velocity: float, torque: float, damping: float | None = None
    ) -> bool:
        kd = self._kd if damping is None else damping
        return self._send_command(
            position * self._radians, velocity * self._radians, stiffness, kd, torque * self._sign
        )
