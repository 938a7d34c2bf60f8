"""One simulated Damiao motor in MIT mode: every frame to it is answered with feedback, or with a register.

Registers that were written are lost with its power, as in the real one; its TIMEOUT is 0 then, for ever.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from mcserver.drive_sim.mit_node import LIMP, MitNode
from mcserver.drive_sim.motor import Hardware
from mcserver.drives.damiao.codec import (
    FIRST_FAULT,
    LENGTH,
    MIT_MODE,
    READ,
    REFRESH,
    REGISTERS,
    TIMEOUT_UNIT,
    WRITE,
    Order,
    Ranges,
    Register,
    Status,
    is_status,
    register_answer,
    register_request,
)
from mcserver.drives.damiao.drive import DamiaoDrive
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine


class DamiaoNode(MitNode):
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
        self.registers = {
            Register.TIMEOUT: 0.0,
            Register.CTRL_MODE: float(MIT_MODE),
            Register.PMAX: ranges.position,
            Register.VMAX: ranges.velocity,
            Register.TMAX: ranges.torque,
        }
        self._stored = dict(self.registers)
        self._feedback_id = feedback_id
        self._status = int(Status.DISABLED)

    @property
    def enabled(self) -> bool:
        return self._status == Status.ENABLED

    @property
    def timeout_s(self) -> float:
        return self.registers[Register.TIMEOUT] * TIMEOUT_UNIT

    @property
    def greatest_torque(self) -> float:
        return self.registers[Register.TMAX]

    def forget(self) -> None:
        self.registers = dict(self._stored)
        self._status = int(Status.DISABLED)

    def let_go(self) -> None:
        self._status = int(Status.COMMUNICATION_LOST)

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
            elif self.enabled and self.registers[Register.CTRL_MODE] == MIT_MODE:
                self._target = self._ranges.decode_command(payload)
            self._tell()

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
            self._target = LIMP
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

    def _tell(self) -> None:
        self._transmit(self._feedback_id, self._ranges.feedback(self.node, self._feedback(self._status)))


def simulated_node(
    _machine: Machine,
    axis: Axis,
    transmit: Callable[[int, bytes], None],
    hardware: Hardware,
    position: float,
) -> DamiaoNode:
    """Return the drive of an axis, see `mcserver.drive_sim.from_machine.build_node`."""
    drive = axis.drive
    assert isinstance(drive, DamiaoDrive)
    return DamiaoNode(drive.node, drive.feedback_id, transmit, drive.ranges, hardware, position)
