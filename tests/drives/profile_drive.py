"""A drive in memory that has profile position alone, with the handshake as makers write it."""

from __future__ import annotations

import struct

import msgspec

from mcserver.can.cob import Function
from mcserver.can.pdo_layout import Mode
from mcserver.canopen.configuration import configure
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.settings import settings_of
from mcserver.machine.machine_file import Machine
from tests.drives.can_rig import machine
from tests.drives.fake_can import ENABLED, FakeBus, FakeDrive, wrap

PP = 'mode = "pp"\n'
NEW, IMMEDIATELY, HALT = 0x10, 0x20, 0x100
REACHED, ACKNOWLEDGED, FOLLOWING = 0x400, 0x1000, 0x2000


class ProfileDrive(FakeDrive):
    """Goes to acknowledged set-points at a speed of its own, in counts a SYNC.

    Attributes:
        taken: (target, speed) of each set-point that it has acknowledged. pulses: lengths of bit 4 in SYNCs.
        ack_after: SYNCs until it does; None: never. keeps_ack: it does not take the acknowledgement back.
        slip: it reports a following error.
    """

    step = 40

    def __init__(self, bus: FakeBus, node: int, position: int = 0, cycle_s: float = 1e-3) -> None:
        super().__init__(bus, node, position, cycle_s)
        self.taken: list[tuple[int, int]] = []
        self.pulses: list[int] = []
        self.ack_after: int | None = 1
        self.keeps_ack = self.slip = False
        self.profile_speed = 0
        self.setpoint: int | None = None
        # an earlier master has left a target that was never reached
        self.stale: int | None = None
        self._edge = self._acknowledged = False
        self._high = 0

    def receive(self, identifier: int, payload: bytes) -> None:
        if identifier == Function.RPDO2 + self.node:
            (self.profile_speed,) = struct.unpack("<I", payload)
            return
        super().receive(identifier, payload)

    def _move(self) -> None:
        if self.word == ENABLED and self.shown == Mode.PROFILE_POSITION and not self.jammed:
            goal = self.setpoint if self.setpoint is not None else self.stale
            if goal is not None and not self.controlword & HALT:
                self.exact += max(-self.step, min(self.step, goal - self.exact))
        self.position = round(self.exact)

    def _step(self) -> None:
        before = self.word
        super()._step()
        if self.word != ENABLED:
            self.setpoint, self._acknowledged, self._high = None, False, 0
            return
        if before != ENABLED:
            self._high = 0
        if self.controlword & NEW:
            self._high += 1
            self._edge = self._edge or self._high == 1
            if self._edge and self.ack_after is not None and self._high > self.ack_after:
                self._edge, self._acknowledged = False, True
                self.setpoint = self.target
                self.taken.append((self.target, self.profile_speed))
        elif self._high:
            self.pulses.append(self._high)
            self._high, self._edge = 0, False
        if not self.controlword & NEW and not self.keeps_ack:
            self._acknowledged = False

    def _answer(self) -> None:
        base = self.word
        if self._acknowledged:
            self.word |= ACKNOWLEDGED
        if self.slip:
            self.word |= FOLLOWING
        if self.setpoint is not None and abs(wrap(self.setpoint - self.position)) < 2:
            self.word |= REACHED
        try:
            super()._answer()
        finally:
            self.word = base


def agreed(axes: int = 1, drive: str = PP, axis: str = "max_following_error = 2.0") -> Machine:
    """A machine as it is after boot-up: 6081h in an RPDO of its own."""
    described = machine(axes, drive=drive, axis=axis)
    sections = []
    for each, settings in zip(described.axes, settings_of(described), strict=True):
        _, planned = configure(settings, described.cycle_s, generic_dictionary(settings.node), 127)
        replaced = msgspec.structs.replace(each.drive, process_data=planned.process_data)
        sections.append(msgspec.structs.replace(each, drive=replaced))
    return msgspec.structs.replace(described, axes=tuple(sections))
