"""Profile position (mode 1): targets one by one, on profiles that the drive makes itself.

CiA 402-2, profile position: a rising edge of bit 4 hands over 607Ah, bit 12 of the statusword acknowledges
it, bit 4 falls, bit 12 falls: only then the next one may come. Bit 5: it takes effect at once. Bit 8: halt.

Bit 8 is set until the drive has acknowledged a target of ours, so that nothing which an earlier master, or an
earlier program, has left in the drive can move it. Bit 4 stays until it is answered, since a drive that
misses a short pulse would go on to the target before.
"""

from __future__ import annotations

import enum

NEW_SETPOINT = 0x0010
IMMEDIATELY = 0x0020
HALT = 0x0100
ACKNOWLEDGED = 0x1000
FOLLOWING_ERROR = 0x2000
# A drive acknowledges within this time, and takes its acknowledgement back within the same [s].
ANSWER_S = 0.25
# Targets beyond have no place in 607Ah: modulo 2^32 they would be somewhere else.
GREATEST_TARGET = 2**31 - 1


class Refusal(enum.IntEnum):
    """Why an axis cannot go on."""

    NOT_ACKNOWLEDGED = 1
    STILL_ACKNOWLEDGED = 2
    OUT_OF_RANGE = 3
    FOLLOWING = 4


class Handover(enum.Enum):
    """How far a set-point has come."""

    IDLE = enum.auto()  # the drive has the latest one, or none was set
    WAITING = enum.auto()  # target and speed are in the RPDOs; bit 12 of the one before has to fall
    OFFERED = enum.auto()  # bit 4 is set until bit 12 is
    TAKEN = enum.auto()  # bit 4 has fallen; bit 12 has not yet


class ProfilePosition:
    """The set-points of one axis.

    Args:
        sends_speed: 6081h is in a PDO, so that a target with another speed is another set-point.

    Attributes:
        target: for 607Ah [counts]; None: the axis has none. speed: for 6081h.
        bits: of the controlword, besides those of the power state.
    """

    def __init__(self, cycle_s: float, *, sends_speed: bool) -> None:
        self._patience = max(6, round(ANSWER_S / cycle_s))
        self._sends_speed = sends_speed
        self._handover = Handover.IDLE
        self._since = 0
        # the axis is to stand, whatever target the drive has
        self._void = True
        # once the set-point that is offered is acknowledged, the axis may go to it
        self._releases = False
        self.target: int | None = None
        self.speed = 0
        self.bits = HALT

    def reset(self) -> None:
        """The drive is not energized in this mode: what it was given does not count any more."""
        self._handover = Handover.IDLE
        self._void = True
        self._releases = False
        self.target = None
        self.bits = HALT

    def step(self, goal: int | None, speed: int, word: int, *, fresh: bool) -> Refusal | None:
        """One cycle of an energized axis.

        Args:
            goal: where to go [counts]; None: it is to come to rest where it is. speed: on the way there.
            word: the statusword. fresh: it came in this cycle.

        Returns:
            Why the axis has to be given up; None: all is well.
        """
        if goal is not None and abs(goal) > GREATEST_TARGET:
            return Refusal.OUT_OF_RANGE
        self._since += 1
        if goal is None:
            self._void = True
            self._releases = False
            if self._handover is Handover.WAITING:
                self._enter(Handover.IDLE)
        refusal = self._take_answer(word) if fresh else None
        if refusal is None and self._since > self._patience:
            refusal = self._overdue()
        if self._handover is Handover.IDLE and goal is None:
            self.target = None
        elif self._handover is Handover.IDLE and goal is not None and self._is_new(goal, speed):
            # target and speed stand in the drive before the edge that makes them valid
            self.target, self.speed = goal, speed
            self._enter(Handover.WAITING)
        elif self._handover is Handover.WAITING and fresh and not word & ACKNOWLEDGED:
            self._releases = True
            self._enter(Handover.OFFERED)
        self.bits = HALT if self._void else 0
        if self._handover is Handover.OFFERED:
            self.bits |= NEW_SETPOINT | IMMEDIATELY
        return refusal

    def _take_answer(self, word: int) -> Refusal | None:
        acknowledged = bool(word & ACKNOWLEDGED)
        if self._handover is Handover.OFFERED and acknowledged:
            self._enter(Handover.TAKEN)
            self._void = not self._releases
        elif self._handover is Handover.TAKEN and not acknowledged:
            self._enter(Handover.IDLE)
        if self._handover is Handover.IDLE and not self._void and word & FOLLOWING_ERROR:
            return Refusal.FOLLOWING
        return None

    def _overdue(self) -> Refusal | None:
        if self._handover is Handover.IDLE:
            return None
        if self._handover is not Handover.OFFERED:
            return Refusal.STILL_ACKNOWLEDGED
        if self._releases:
            return Refusal.NOT_ACKNOWLEDGED
        # it was taken back by a halt before the drive has looked at it
        self._enter(Handover.TAKEN)
        return None

    def _is_new(self, goal: int, speed: int) -> bool:
        return self._void or goal != self.target or (self._sends_speed and speed != self.speed)

    def _enter(self, handover: Handover) -> None:
        self._handover = handover
        self._since = 0
