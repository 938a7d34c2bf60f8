"""Ends of rotary axes that turn without end: an absolute word is an angle within one turn (D-139)."""

from __future__ import annotations

import math

from mcserver.machine.sections import Rollover
from mcserver.units import TURN

# nearer than this an axis stands at the angle already, and half a turn is as far both ways [rad]
_EQUAL = 1e-9


def rolled_over(rollover: Rollover, written: float, zero: float, start: float) -> float:
    """Return the position that an absolute word leads to [rad].

    Fanuc's rotary axis roll-over goes the shorter way, half a turn forwards. Its rotary axis control, and
    LinuxCNC's wrapped rotary axis, take the sign as the direction: C-90 turns backwards to 90 degrees.

    Args:
        written: of the word. zero: of the program, in positions of the axis. start: where the axis is [rad].
    """
    signed = rollover == "sign"
    end = zero + (abs(written) if signed else written)
    way = math.remainder(end - start, TURN)
    if abs(way) <= _EQUAL:
        return start
    if signed:
        backwards = math.copysign(1.0, written) < 0.0
        turns = -1 if backwards and way > 0.0 else int(not backwards and way < 0.0)
    else:
        turns = int(way <= _EQUAL - TURN / 2.0)
    # counted in whole turns from the word, so that the angle is the written one to the last bit
    return end + TURN * (round((start + way - end) / TURN) + turns)
