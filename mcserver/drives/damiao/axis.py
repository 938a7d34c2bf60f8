"""One Damiao motor: a frame in every cycle, which the motor answers with its feedback.

A motor goes on by its latest command until its register TIMEOUT ends, which may be 0: for ever. So it is
given the time-out of the machine file each time before it is energized, as its power may have been away. Its
ranges are read with it: a frame says other numbers to a motor with other ranges.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

from mcserver.can.port import CanPort
from mcserver.drives.bus import DriveFault, DriveMode, DriveState
from mcserver.drives.damiao.codec import (
    FIRST_FAULT,
    LENGTH,
    MIT_MODE,
    REGISTERS,
    TIMEOUT_UNIT,
    Order,
    Register,
    Status,
    position_step,
    register_answer,
    register_request,
    velocity_step,
)
from mcserver.drives.damiao.drive import DamiaoDrive
from mcserver.drives.streamed import StreamedAxis
from mcserver.machine.machine_file import Axis
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

_FAULTS: Mapping[int, DriveFault] = MappingProxyType(
    {
        Status.OVER_VOLTAGE: DriveFault.VOLTAGE,
        Status.UNDER_VOLTAGE: DriveFault.VOLTAGE,
        Status.OVER_CURRENT: DriveFault.OVER_CURRENT,
        Status.MOS_OVER_TEMPERATURE: DriveFault.OVER_TEMPERATURE,
        Status.COIL_OVER_TEMPERATURE: DriveFault.OVER_TEMPERATURE,
        Status.OVERLOAD: DriveFault.OVER_CURRENT,
    }
)


class DamiaoAxis(StreamedAxis):
    """State of one axis."""

    def __init__(self, axis: Axis, drive: DamiaoDrive, cycle_s: float, silence_cycles: int) -> None:
        # while a motor is asked for its registers, its feedback comes every other cycle
        super().__init__(axis, silence_cycles + 1)
        sign = -1.0 if drive.invert else 1.0
        self._node = drive.node
        self._feedback_id = drive.feedback_id
        self._ranges = drive.ranges
        self._kp, self._kd = drive.kp, drive.kd
        self._sign = sign
        # radians of the output shaft, by the axis
        self._radians = sign * TURN / axis.travel_per_motor_turn
        self._greatest = JUMP_FACTOR * drive.v_max * cycle_s
        self._slack = JUMP_STEPS * position_step(drive.p_max)
        self._standing = STANDING_STEPS * velocity_step(drive.v_max) / abs(self._radians)
        self._setup = (
            *((register, value, None) for register, value in self._expected(drive)),
            (Register.TIMEOUT, drive.command_timeout_ms * 1e-3 / TIMEOUT_UNIT, Register.TIMEOUT),
        )
        self._checked = 0
        self._written = False
        self._asks = False
        self._command = bytearray()
        self._request = bytearray()
        self._since = 0
        self._status = int(Status.DISABLED)
        self._shaft = 0.0
        self._known = False
        self._foreign = 0
        self._braking_cycles = round(BRAKING_S / cycle_s)
        self._braking = 0

    @staticmethod
    def _expected(drive: DamiaoDrive) -> tuple[tuple[Register, float], ...]:
        return (
            (Register.CTRL_MODE, float(MIT_MODE)),
            (Register.PMAX, drive.p_max),
            (Register.VMAX, drive.v_max),
            (Register.TMAX, drive.t_max),
        )

    def open(self, port: CanPort) -> dict[int, Callable[[bytes], None]]:
        self._command = port.prepare(self._node, LENGTH)
        self._request = port.prepare(REGISTERS, LENGTH)
        self._at = port.payload_offset
        self._send = port.send_prepared
        return {self._feedback_id: self.take}

    # ------------------------------------------------------------------ what has come

    def take(self, payload: bytes) -> None:
        """Take an answer of the motor: feedback, or a register."""
        answer = register_answer(self._node, payload)
        if answer is not None:
            self._take_register(*answer)
            return
        feedback = self._ranges.decode_feedback(self._node, payload)
        if feedback is None:
            self.short += 1
            self._foreign += 1
            if self._foreign == FOREIGN_FRAMES and not self._known:
                self.complaint = (
                    f"what comes by {self._feedback_id:02X}h is no feedback of motor {self._node} "
                    f"({payload.hex(' ')})",
                    "check kind, node (ESC_ID) and feedback_id (MST_ID), and who else is on the bus",
                )
            return
        step = abs(feedback.position - self._shaft)
        elapsed = max(1, self.age + 1)
        if self._known and step > self._greatest * elapsed + self._slack:
            self.fail(DriveFault.POSITION_LOST)
        self._shaft = feedback.position
        self._status = feedback.status
        self._known = True
        self.age = -1
        self.position = feedback.position / self._radians
        self.velocity = feedback.velocity / self._radians

    def _take_register(self, register: Register, value: float) -> None:
        if self.ready:
            return
        wanted, expected, writes = self._setup[self._checked]
        if register is not wanted:
            return
        if writes is not None and not self._written:
            # this was the answer to the write: what the register has is read after it
            self._written = True
        elif abs(value - expected) <= SAME * abs(expected) + (0.5 if writes is not None else 0.0):
            self._checked += 1
            self.complaint = None
        else:
            self.complaint = (
                f"the register {register.name} of the motor is {value:g}, {expected:g} is needed",
                "set it in the maker's tool, or correct the machine file (kind, p_max, v_max, t_max)",
            )

    @property
    def ready(self) -> bool:
        """Whether its registers have been seen to be as they have to be."""
        return self._checked == len(self._setup)

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
        if self._status >= FIRST_FAULT and self.fresh:
            self.fail(_FAULTS.get(self._status, DriveFault.OTHER))
        if self.fault is not DriveFault.NONE:
            self.state = DriveState.FAULT
            return self._brake_or_disable()
        if commanded is DriveMode.STOP and self._status == Status.ENABLED:
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
        if self._braking <= 0 or self._status != Status.ENABLED or abs(self.velocity) <= self._standing:
            self._braking = 0
            return self._disable()
        return self._move(0.0, 0.0, 0.0, 0.0)

    def _enabled(self) -> bool:
        """Go on to ENERGIZED; once there, a motor that is disabled has let go by itself."""
        if self.state is DriveState.ENERGIZED:
            if self._status != Status.ENABLED:
                self.state = DriveState.OFF
            return self._status == Status.ENABLED
        if self.ready and self.fresh and self._status == Status.ENABLED:
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
        return self._order(Order.ENABLE)

    def _reset(self) -> bool:
        if self.fresh and self._since >= ANSWER_CYCLES and self._status == Status.DISABLED:
            self.fault, self.detail = DriveFault.NONE, 0
            self.state = DriveState.OFF
        else:
            self.state = DriveState.FAULT if self.fault is not DriveFault.NONE else DriveState.STOPPING
        # the motor says its state when it is disabled
        return self._order(Order.CLEAR_FAULT) if self._since % 2 else self._disable()

    def _disable(self) -> bool:
        """Disable the motor, and ask for its registers in turn with that."""
        self._asks = not self._asks and not self.ready
        if not self._asks:
            return self._order(Order.DISABLE)
        register, expected, writes = self._setup[self._checked]
        value = expected if writes is not None and not self._written else None
        self._request[self._at : self._at + LENGTH] = register_request(self._node, register, value)
        return self._send(self._request)

    def _order(self, order: Order) -> bool:
        return self._transmit(order.payload)

    def _move(
        self, stiffness: float, position: float, velocity: float, torque: float, damping: float | None = None
    ) -> bool:
        kd = self._kd if damping is None else damping
        return self._transmit(
            self._ranges.command(
                position * self._radians, velocity * self._radians, stiffness, kd, torque * self._sign
            )
        )

    def _transmit(self, payload: bytes) -> bool:
        self._command[self._at : self._at + LENGTH] = payload
        return self._send(self._command)
