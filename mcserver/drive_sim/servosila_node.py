"""One simulated Servosila drive: streamed commands in, free-running telemetry out (public device reference).

Commands come on 200h + node: code in byte 0, float32 little-endian at byte 4. Without a command for the
time-out the motor stops. After a fault only Reset counts; it takes the work zone back to its first turn: the
count becomes 0, or with ``absolute`` what the shaft's angle within the turn is, as when power comes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from mcserver.can.cob import Function
from mcserver.drive_sim.motor import WINDUP_S, Hardware
from mcserver.drive_sim.streamed_node import BOOT_S, StreamedNode
from mcserver.drives.servosila.codec import (
    COMMAND_PACKING,
    FLOAT16_UNIT,
    LENGTH,
    POSITION_PACKING,
    STATUS_PACKING,
)
from mcserver.drives.servosila.drive import ServosilaDrive
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine
from mcserver.units import MINUTE, TURN

NEVER = math.inf
# Code of the public reference that the server never sends: an offset from the current position.
SERVO_STEPPER = 0x38
# Fault bit that the simulation itself sets (reference, page 39): overcurrent.
FOLLOWING_FAULT = 0x0008
DC_BUS_V = 48.0
# A servo command is followed unless the shaft stays this far behind for this time [turn, s].
FOLLOWING_WINDOW = 1.0
FOLLOWING_S = 0.25


class ServosilaNode(StreamedNode):
    """One drive."""

    kind = "servosila"
    title = "Servosila drive"

    def __init__(
        self,
        node: int,
        transmit: Callable[[int, bytes], None],
        codes: Mapping[str, int],
        hardware: Hardware | None = None,
        position: float = 0.0,
        pole_pairs: int = 1,
        telemetry_s: float = 0.005,
        timeout_s: float = 0.1,
        *,
        absolute: bool = False,
    ) -> None:
        """Make a drive that is off.

        Args:
            codes: command → code. position: of the motor [turn]. timeout_s: without a command for so long it
                stops. absolute: its encoder knows the angle within a turn.
        """
        super().__init__(node, transmit, hardware, position)
        self._names = {code: name for name, code in codes.items()}
        self._names.setdefault(SERVO_STEPPER, "servo_stepper")
        self._absolute = absolute
        self._pole_pairs = max(1, pole_pairs)
        self._period = telemetry_s
        self._timeout = timeout_s
        self._zero = position
        self._command = "off"
        self._value = 0.0
        self._reference = position
        self._ramp = 0.0
        self._heard_at = -math.inf
        self._fault_bits = 0
        self._behind_s = 0.0
        self._tick_at = NEVER
        self._torque = 0.0

    def switch_on(self, now: float) -> None:
        """Power comes: silence for a moment, then telemetry; the work zone begins at 0."""
        self._booting = True
        self._fault_bits = 0
        self._enter("off")
        self._tick_at = now + BOOT_S
        self.wake = self._tick_at

    def identifiers(self) -> set[int]:
        return {Function.RPDO1 + self.node}

    def receive(self, identifier: int, payload: bytes, now: float) -> None:
        """A command; one of a wrong length or an unknown code is left out."""
        if self._booting or self.wrong.stuck or identifier != Function.RPDO1 + self.node:
            return
        if len(payload) != LENGTH:
            return
        code, value = COMMAND_PACKING.unpack(payload)
        name = self._names.get(code)
        if name is None or not math.isfinite(value):
            return
        self._heard_at = now
        if name == "reset":
            self._fault_bits = 0
            self._behind_s = 0.0
            self._back_to_first_turn()
            self._enter("off")
        elif self._fault_bits:
            return
        elif name == "reset_work_zone":
            self._back_to_first_turn()
        elif name == "servo_stepper":
            self._value = self._work_zone() + value
            if self._command != "servo":
                self._enter("servo")
        else:
            self._value = value
            if name != self._command:
                self._enter(name)

    def poll(self, now: float) -> None:
        """Steps and telemetry that are due; sets `wake`."""
        if now >= self._tick_at:
            if self._booting:
                self._booting = False
                self._back_to_first_turn()
            else:
                self._step(self._period, now)
            self._tell()
            # telemetry that was missed is not made up for
            self._tick_at = max(self._tick_at + self._period, now + 0.5 * self._period)
        self.wake = self._tick_at

    def trip(self, code: int) -> None:
        self._fail(code or FOLLOWING_FAULT)

    def more(self) -> Mapping[str, object]:
        return {
            "power": self._command.upper(),
            "fault_bits": self._fault_bits,
            "position": self._work_zone(),
        }

    # ------------------------------------------------------------------ inside

    def _enter(self, command: str) -> None:
        self._command = command
        self._reference = self.motor.position
        self._ramp = self.motor.velocity

    def _fail(self, bits: int) -> None:
        self._fault_bits |= bits
        self._enter("off")

    def _back_to_first_turn(self) -> None:
        self._zero = math.floor(self.motor.position) if self._absolute else self.motor.position

    def _work_zone(self) -> float:
        return (self.motor.position - self._zero) * self.motor.hardware.increments_per_turn

    def _step(self, dt: float, now: float) -> None:
        motor, command = self.motor, self._command
        if command not in ("off", "stop") and now - self._heard_at > self._timeout:
            self._enter("stop")
            command = "stop"
        self._torque = 0.0
        if command == "servo":
            self._follow(self._zero + self._value / motor.hardware.increments_per_turn, dt)
        elif command == "rpm":
            self._run(self._value / MINUTE, dt)
        elif command == "speed":
            self._run(self._value / self._pole_pairs, dt)
        elif command == "torque":
            motor.push(self._value, dt)
            self._torque = motor.torque
        elif command == "stop":
            self._brake(dt)
        elif not motor.stands:
            motor.coast(dt)

    def _follow(self, target: float, dt: float) -> None:
        self.motor.follow(self._reference, target, dt)
        self._reference = target
        self._torque = self.motor.torque
        behind = abs(target - self.motor.position) > FOLLOWING_WINDOW and self.motor.jammed
        self._behind_s = self._behind_s + dt if behind else 0.0
        if self._behind_s > FOLLOWING_S:
            self._fail(FOLLOWING_FAULT)

    def _run(self, speed: float, dt: float) -> None:
        limit = self.motor.hardware.max_speed
        speed = min(max(speed, -limit), limit)
        end = self._reference + speed * dt
        behind = end - self.motor.position
        if abs(behind) > WINDUP_S * limit:
            end = self.motor.position + math.copysign(WINDUP_S * limit, behind)
        self.motor.follow(end - speed * dt, end, dt)
        self._reference = end
        self._torque = self.motor.torque

    def _brake(self, dt: float) -> None:
        change = 0.8 * self.motor.hardware.max_acceleration * dt
        old = self._ramp
        self._ramp = math.copysign(max(abs(old) - change, 0.0), old)
        end = self._reference + 0.5 * (old + self._ramp) * dt
        self.motor.follow(self._reference, end, dt)
        self._reference = end
        self._torque = self.motor.torque

    def _tell(self) -> None:
        motor = self.motor
        electrical_hz = motor.velocity * self._pole_pairs
        angle = (motor.position * self._pole_pairs % 1.0) * TURN
        current = self._torque / motor.hardware.rated_torque
        volts = round(DC_BUS_V / FLOAT16_UNIT)
        status = STATUS_PACKING.pack(self._fault_bits, volts, electrical_hz)
        self._transmit(Function.TPDO1 + self.node, status)
        self._transmit(Function.TPDO2 + self.node, POSITION_PACKING.pack(angle, self._work_zone()))
        self._transmit(Function.TPDO3 + self.node, POSITION_PACKING.pack(current, 0.0))


def simulated_node(
    machine: Machine,
    axis: Axis,
    transmit: Callable[[int, bytes], None],
    hardware: Hardware,
    position: float,
) -> ServosilaNode:
    """Return the drive of an axis, see `mcserver.drive_sim.from_machine.build_node`."""
    drive = axis.drive
    assert isinstance(drive, ServosilaDrive)
    return ServosilaNode(
        drive.node,
        transmit,
        drive.codes,
        hardware,
        position,
        pole_pairs=drive.pole_pairs,
        telemetry_s=1.0 / drive.telemetry_hz if drive.telemetry_hz > 0.0 else machine.cycle_s,
        timeout_s=drive.command_timeout_ms * 1e-3,
    )
