"""One RobStride motor in the cycle of its bus."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import IntEnum
from functools import partial
from types import MappingProxyType

from mcserver.can.cob import Function
from mcserver.can.frame import IDENTIFIER
from mcserver.can.port import CanPort
from mcserver.drives.bus import DriveFault
from mcserver.drives.mit_axis import MitAxis, Power, Requirement
from mcserver.drives.robstride.codec import (
    CLEAR_FAULT,
    LENGTH,
    OPERATION_MODE,
    TIMEOUT_UNIT,
    FaultBit,
    Kind,
    Mode,
    Parameter,
    State,
    answer_identifier,
    feedback_identifiers,
    parameter_of,
    parameter_payload,
    to_motor,
)
from mcserver.drives.robstride.drive import RobstrideDrive
from mcserver.machine.axis import Axis

_FAULTS: Mapping[FaultBit, DriveFault] = MappingProxyType(
    {
        FaultBit.OVER_TEMPERATURE: DriveFault.OVER_TEMPERATURE,
        FaultBit.OVER_CURRENT: DriveFault.OVER_CURRENT,
        FaultBit.STALL: DriveFault.OVER_CURRENT,
        FaultBit.UNDER_VOLTAGE: DriveFault.VOLTAGE,
        FaultBit.ENCODER: DriveFault.ENCODER,
        FaultBit.NOT_CALIBRATED: DriveFault.ENCODER,
    }
)


class RobstrideAxis(MitAxis):
    """State of one axis."""

    def __init__(self, axis: Axis, drive: RobstrideDrive, cycle_s: float, silence_cycles: int) -> None:
        timeout = drive.command_timeout_ms * 1e-3 / TIMEOUT_UNIT
        requirements = (
            Requirement(Parameter.RUN_MODE, OPERATION_MODE, written=True),
            Requirement(Parameter.LIMIT_TORQUE, drive.t_max, at_most=True),
            Requirement(Parameter.CAN_TIMEOUT, timeout, written=True),
        )
        super().__init__(axis, drive, cycle_s, silence_cycles, requirements)
        self._ranges = drive.ranges
        self._frames: dict[Kind, bytearray] = {}

    def open(self, port: CanPort) -> dict[int, Callable[[bytes], None]]:
        kinds = (Kind.COMMAND, Kind.ENABLE, Kind.STOP, Kind.READ, Kind.WRITE)
        self._frames = {kind: port.prepare(to_motor(kind, self._node), LENGTH) for kind in kinds}
        self._at = port.payload_offset
        self._send = port.send_prepared
        handlers: dict[int, Callable[[bytes], None]] = {
            whole: partial(self.take, state) for whole, state in feedback_identifiers(self._node).items()
        }
        handlers[answer_identifier(self._node)] = self.take_parameter
        handlers[answer_identifier(self._node, refused=True)] = self._take_refusal
        handlers[Function.HEARTBEAT + self._node] = self._take_heartbeat
        return handlers

    # ------------------------------------------------------------------ what has come

    def take(self, state: State, payload: bytes) -> None:
        """Take feedback, whose state was in its identifier."""
        feedback = self._ranges.decode_feedback(payload)
        if feedback is None or state.mode not in Mode._value2member_map_:
            self._take_foreign(
                f"what comes as feedback of motor {self._node} is none "
                f"({payload.hex(' ')}, mode {state.mode})",
                "check kind and node, and who else is on the bus",
            )
            return
        fault = next((_FAULTS[bit] for bit in _FAULTS if state.faults & bit), DriveFault.NONE)
        power = Power.ENABLED if state.mode == Mode.RUN else Power.DISABLED
        self._take_feedback(feedback, Power.FAULT if state.faults else power, fault)

    def take_parameter(self, payload: bytes) -> None:
        """Take the answer to a request."""
        answer = parameter_of(payload)
        if answer is not None:
            self._take_register(*answer)

    def _take_refusal(self, _payload: bytes) -> None:
        if not self.ready:
            name = self._requirements[self._checked].register.name
            self.complaint = (
                f"the motor has no parameter {name}",
                "give it a newer firmware: without it the motor cannot be made safe",
            )

    def _take_heartbeat(self, _payload: bytes) -> None:
        if not self._known:
            self.complaint = (
                f"motor {self._node} speaks CANopen",
                "switch it to its private protocol in the maker's tool, and its power off and on",
            )

    # ------------------------------------------------------------------ what goes out

    def _send_enable(self) -> bool:
        return self._transmit(Kind.ENABLE, bytes(LENGTH))

    def _send_disable(self) -> bool:
        return self._transmit(Kind.STOP, bytes(LENGTH))

    def _send_clear(self) -> bool:
        return self._transmit(Kind.STOP, CLEAR_FAULT)

    def _send_request(self, register: IntEnum, value: float | None) -> bool:
        # a write is answered by feedback alone: what came of it is read after it
        self._written = value is not None or self._written
        return self._transmit(Kind.READ if value is None else Kind.WRITE, parameter_payload(register, value))

    def _send_command(self, position: float, velocity: float, kp: float, kd: float, torque: float) -> bool:
        whole, payload = self._ranges.command(self._node, position, velocity, kp, kd, torque)
        IDENTIFIER.pack_into(self._frames[Kind.COMMAND], 0, whole)
        return self._transmit(Kind.COMMAND, payload)

    def _transmit(self, kind: Kind, payload: bytes) -> bool:
        frame = self._frames[kind]
        frame[self._at : self._at + LENGTH] = payload
        return self._send(frame)
