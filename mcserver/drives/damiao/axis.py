"""One Damiao motor in the cycle of its bus."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import IntEnum
from types import MappingProxyType

from mcserver.can.port import CanPort
from mcserver.drives.bus import DriveFault
from mcserver.drives.damiao.codec import (
    FIRST_FAULT,
    LENGTH,
    MIT_MODE,
    REGISTERS,
    TIMEOUT_UNIT,
    Order,
    Register,
    Status,
    register_answer,
    register_request,
)
from mcserver.drives.damiao.drive import DamiaoDrive
from mcserver.drives.mit_axis import MitAxis, Power, Requirement
from mcserver.machine.axis import Axis

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


class DamiaoAxis(MitAxis):
    """State of one axis."""

    def __init__(self, axis: Axis, drive: DamiaoDrive, cycle_s: float, silence_cycles: int) -> None:
        requirements = (
            Requirement(Register.CTRL_MODE, float(MIT_MODE)),
            Requirement(Register.PMAX, drive.p_max),
            Requirement(Register.VMAX, drive.v_max),
            Requirement(Register.TMAX, drive.t_max),
            Requirement(Register.TIMEOUT, drive.command_timeout_ms * 1e-3 / TIMEOUT_UNIT, written=True),
        )
        super().__init__(axis, drive, cycle_s, silence_cycles, requirements)
        self._feedback_id = drive.feedback_id
        self._ranges = drive.ranges
        self._command = bytearray()
        self._request = bytearray()

    def open(self, port: CanPort) -> dict[int, Callable[[bytes], None]]:
        self._command = port.prepare(self._node, LENGTH)
        self._request = port.prepare(REGISTERS, LENGTH)
        self._at = port.payload_offset
        self._send = port.send_prepared
        return {self._feedback_id: self.take}

    def take(self, payload: bytes) -> None:
        """Take an answer of the motor: feedback, or a register."""
        answer = register_answer(self._node, payload)
        if answer is not None:
            self._take_register(*answer)
            return
        feedback = self._ranges.decode_feedback(self._node, payload)
        if feedback is None:
            self._take_foreign(
                f"what comes by {self._feedback_id:02X}h is no feedback of motor {self._node} "
                f"({payload.hex(' ')})",
                "check kind, node (ESC_ID) and feedback_id (MST_ID), and who else is on the bus",
            )
            return
        power = Power.ENABLED if feedback.status == Status.ENABLED else Power.DISABLED
        if feedback.status >= FIRST_FAULT:
            power = Power.FAULT
        self._take_feedback(feedback, power, _FAULTS.get(feedback.status, DriveFault.OTHER))

    def _send_enable(self) -> bool:
        return self._transmit(Order.ENABLE.payload)

    def _send_disable(self) -> bool:
        return self._transmit(Order.DISABLE.payload)

    def _send_clear(self) -> bool:
        return self._transmit(Order.CLEAR_FAULT.payload)

    def _send_request(self, register: IntEnum, value: float | None) -> bool:
        self._request[self._at : self._at + LENGTH] = register_request(self._node, Register(register), value)
        return self._send(self._request)

    def _send_command(self, position: float, velocity: float, kp: float, kd: float, torque: float) -> bool:
        return self._transmit(self._ranges.command(position, velocity, kp, kd, torque))

    def _transmit(self, payload: bytes) -> bool:
        self._command[self._at : self._at + LENGTH] = payload
        return self._send(self._command)
