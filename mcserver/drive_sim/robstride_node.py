"""One simulated RobStride motor by its private protocol: every frame to it is answered.

Parameters that were written are lost with its power; its CAN_TIMEOUT is 0 then, for ever.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from mcserver.can.port import EXTENDED
from mcserver.drive_sim.mit_node import LIMP, MitNode
from mcserver.drive_sim.motor import Hardware
from mcserver.drives.robstride.codec import (
    ALL_FAULTS,
    LENGTH,
    OPERATION_MODE,
    TIMEOUT_UNIT,
    FaultBit,
    Kind,
    Mode,
    Parameter,
    Ranges,
    State,
    answer_identifier,
    feedback_identifier,
    parameter_of,
    parameter_payload,
)
from mcserver.drives.robstride.drive import RobstrideDrive
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine


class RobstrideNode(MitNode):
    """One motor."""

    kind = "robstride"
    title = "RobStride motor"

    def __init__(
        self,
        node: int,
        transmit: Callable[[int, bytes], None],
        ranges: Ranges,
        hardware: Hardware | None = None,
        position: float = 0.0,
    ) -> None:
        """Make a motor that is off; ``position``: of its output shaft [turn]."""
        super().__init__(node, transmit, hardware, position)
        self.parameters = {
            Parameter.RUN_MODE: float(OPERATION_MODE),
            Parameter.LIMIT_TORQUE: ranges.torque,
            Parameter.CAN_TIMEOUT: 0.0,
        }
        self._stored = dict(self.parameters)
        self._ranges = ranges
        self._mode = Mode.RESET
        self._faults = 0

    @property
    def enabled(self) -> bool:
        return self._mode is Mode.RUN and not self._faults

    @property
    def timeout_s(self) -> float:
        return self.parameters[Parameter.CAN_TIMEOUT] * TIMEOUT_UNIT

    @property
    def greatest_torque(self) -> float:
        return self.parameters[Parameter.LIMIT_TORQUE]

    def forget(self) -> None:
        self.parameters = dict(self._stored)
        self._mode, self._faults = Mode.RESET, 0

    def let_go(self) -> None:
        self._mode = Mode.RESET

    def identifiers(self) -> set[int]:
        return {EXTENDED | self.node}

    def receive(self, identifier: int, payload: bytes, now: float) -> None:
        """A frame; one of a wrong length, or of another kind, is left out."""
        if self._booting or self.wrong.stuck or len(payload) != LENGTH:
            return
        self._advance(now)
        self._heard_at = now
        kind = identifier >> 24 & 0x1F
        if kind == Kind.READ:
            self._answer(payload)
            return
        if kind == Kind.COMMAND:
            if self.enabled and self.parameters[Parameter.RUN_MODE] == OPERATION_MODE:
                self._target = self._ranges.decode_command(identifier, payload)
        elif kind == Kind.ENABLE:
            if not self._faults:
                self._mode, self._target = Mode.RUN, LIMP
        elif kind == Kind.STOP:
            self._mode = Mode.RESET
            self._faults = 0 if payload[0] == 1 else self._faults
        elif kind == Kind.WRITE:
            self._write(payload)
        else:
            return
        state = State(self._mode, self._faults)
        self._transmit(feedback_identifier(self.node, state), self._ranges.feedback(self._feedback(0)))

    def trip(self, code: int) -> None:
        self._faults = code & ALL_FAULTS or int(FaultBit.STALL)
        self._mode = Mode.RESET

    def more(self) -> Mapping[str, object]:
        return {
            "power": self._mode.name,
            "fault_bits": self._faults,
            "timeout": self.parameters[Parameter.CAN_TIMEOUT],
        }

    # ------------------------------------------------------------------ inside

    def _write(self, payload: bytes) -> None:
        written = parameter_of(payload)
        if written is not None and written[0] in self.parameters and math.isfinite(written[1]):
            self.parameters[written[0]] = max(written[1], 0.0)

    def _answer(self, payload: bytes) -> None:
        asked = parameter_of(payload)
        parameter = None if asked is None else asked[0]
        if parameter is Parameter.MECH_POS:
            value = self._feedback(0).position
        elif parameter in self.parameters:
            value = self.parameters[parameter]
        else:
            self._transmit(answer_identifier(self.node, refused=True), payload)
            return
        self._transmit(answer_identifier(self.node), parameter_payload(parameter, value))


def simulated_node(
    _machine: Machine,
    axis: Axis,
    transmit: Callable[[int, bytes], None],
    hardware: Hardware,
    position: float,
) -> RobstrideNode:
    """Return the drive of an axis, see `mcserver.drive_sim.from_machine.build_node`."""
    drive = axis.drive
    assert isinstance(drive, RobstrideDrive)
    return RobstrideNode(drive.node, transmit, drive.ranges, hardware, position)
