"""One simulated Damiao motor in MIT mode: every frame to it is answered with feedback, or with a register.

Between frames it goes on by its latest command, until its register TIMEOUT ends; 0 there means for ever, and
registers that were written are lost with its power, as in the real one. After power it knows its place within
one turn of the output shaft.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from mcserver.drive_sim.motor import Hardware
from mcserver.drive_sim.streamed_node import BOOT_S, StreamedNode
from mcserver.drives.damiao.codec import (
    FIRST_FAULT,
    LENGTH,
    MIT_MODE,
    READ,
    REFRESH,
    REGISTERS,
    TIMEOUT_UNIT,
    WRITE,
    Feedback,
    Order,
    Ranges,
    Register,
    Status,
    is_status,
    register_answer,
    register_request,
)
from mcserver.drives.damiao.drive import DamiaoDrive
from mcserver.machine.machine_file import Axis, Machine
from mcserver.units import TURN

# Longest step of the motor's own loop, and the longest time that is made up for [s].
STEP_S = 1e-4
LONGEST_S = 0.05
# Without frames it moves on so often [s].
IDLE_S = 0.005


class DamiaoNode(StreamedNode):
    """One motor."""

    kind = "damiao"
    title = "Damiao motor"

    def __init__(
        self,
        node: int,
        feedback_id: int,
        transmit: Callable[[int, bytes], None],
        ranges: Ranges,
        hardware: Hardware | None = None,
        position: float = 0.0,
    ) -> None:
        """Make a motor that is off; ``position``: of its output shaft [turn]."""
        super().__init__(node, transmit, hardware, position)
        self.wake = math.inf
        self.registers = {
            Register.TIMEOUT: 0.0,
            Register.CTRL_MODE: float(MIT_MODE),
            Register.PMAX: ranges.position,
            Register.VMAX: ranges.velocity,
            Register.TMAX: ranges.torque,
        }
        self._stored = dict(self.registers)
        self._feedback_id = feedback_id
        self._zero = 0.0
        self._status = int(Status.DISABLED)
        self._target = (0.0, 0.0, 0.0, 0.0, 0.0)
        self._heard_at = self._stepped_at = 0.0

    def switch_on(self, now: float) -> None:
        """Power comes: nothing is heard for a moment; the shaft is within half a turn of its zero."""
        self._booting = True
        self.registers = dict(self._stored)
        self._status = int(Status.DISABLED)
        self._stepped_at = now
        self.wake = now + BOOT_S

    def identifiers(self) -> set[int]:
        return {self.node, REGISTERS}

    def receive(self, identifier: int, payload: bytes, now: float) -> None:
        """A frame; one of a wrong length is left out."""
        if self._booting or self.wrong.stuck or len(payload) != LENGTH:
            return
        self._advance(now)
        if identifier == REGISTERS:
            self._receive_request(payload)
        elif identifier == self.node:
            self._heard_at = now
            if payload[:-1] == Order.ENABLE.payload[:-1]:
                self._obey(payload[-1])
            elif self._status == Status.ENABLED and self.registers[Register.CTRL_MODE] == MIT_MODE:
                self._target = self._ranges.decode_command(payload)
            self._tell()

    def poll(self, now: float) -> None:
        """Move on; sets `wake`."""
        if self._booting:
            self._booting = False
            self._zero = math.floor(self.motor.position + 0.5)
        self._advance(now)
        self.wake = now + IDLE_S

    def trip(self, code: int) -> None:
        if code:
            self._status = code if code >= FIRST_FAULT and is_status(code) else int(Status.OVERLOAD)
        else:
            self._status = int(Status.OVER_CURRENT)

    def more(self) -> Mapping[str, object]:
        return {
            "power": Status(self._status).name,
            "fault_bits": self._status if self._status >= FIRST_FAULT else 0,
            "timeout": self.registers[Register.TIMEOUT],
        }

    # ------------------------------------------------------------------ inside

    @property
    def _ranges(self) -> Ranges:
        return Ranges(*(self.registers[each] for each in (Register.PMAX, Register.VMAX, Register.TMAX)))

    def _obey(self, order: int) -> None:
        if order == Order.CLEAR_FAULT:
            self._status = int(Status.DISABLED)
        elif order == Order.ENABLE and self._status < FIRST_FAULT:
            self._status = int(Status.ENABLED)
            self._target = (0.0, 0.0, 0.0, 0.0, 0.0)
        elif order == Order.DISABLE and self._status < FIRST_FAULT:
            self._status = int(Status.DISABLED)

    def _receive_request(self, payload: bytes) -> None:
        if int.from_bytes(payload[:2], "little") != self.node:
            return
        if payload[2] == REFRESH:
            self._tell()
        elif payload[2] in (READ, WRITE) and payload[3] in self.registers:
            register = Register(payload[3])
            if payload[2] == WRITE:
                written = register_answer(self.node, payload)
                assert written is not None
                if math.isfinite(written[1]) and written[1] >= 0.0:
                    self.registers[register] = written[1]
            answer = bytearray(register_request(self.node, register, self.registers[register]))
            answer[2] = payload[2]
            self._transmit(self._feedback_id, bytes(answer))

    def _advance(self, now: float) -> None:
        self._stepped_at = max(self._stepped_at, now - LONGEST_S)
        timeout = self.registers[Register.TIMEOUT] * TIMEOUT_UNIT
        if timeout > 0.0 and self._status == Status.ENABLED and now - self._heard_at > timeout:
            self._status = int(Status.COMMUNICATION_LOST)
        left = now - self._stepped_at
        steps = math.ceil(left / STEP_S - 1e-9)
        for _ in range(steps):
            self._step(left / steps)
        self._stepped_at = now

    def _step(self, dt: float) -> None:
        motor = self.motor
        if self._status != Status.ENABLED:
            if not motor.stands:
                motor.coast(dt)
            return
        position, velocity, kp, kd, torque = self._target
        place, speed = (motor.position - self._zero) * TURN, motor.velocity * TURN
        wanted = kp * (position - place) + kd * (velocity - speed) + torque
        most = self.registers[Register.TMAX]
        motor.push(min(max(wanted, -most), most), dt)

    def _tell(self) -> None:
        motor = self.motor
        place = (motor.position - self._zero) * TURN
        feedback = Feedback(self._status, place, motor.velocity * TURN, motor.torque, 31, 28)
        self._transmit(self._feedback_id, self._ranges.feedback(self.node, feedback))


def simulated_node(
    _machine: Machine,
    axis: Axis,
    transmit: Callable[[int, bytes], None],
    hardware: Hardware,
    position: float,
    _energize_s: float,
) -> DamiaoNode:
    """Return the drive of an axis, see `mcserver.drive_sim.from_machine.build_node`."""
    drive = axis.drive
    assert isinstance(drive, DamiaoDrive)
    return DamiaoNode(drive.node, drive.feedback_id, transmit, drive.ranges, hardware, position)
