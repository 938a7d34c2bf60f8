"""Ends of endless rotary axes, for which an absolute word is an angle within one turn (D-139)."""

from __future__ import annotations

import math

from mcserver.machine.sections import Rollover
from mcserver.units import TURN

# an axis this close to the angle does not turn, and to half a turn has two equal ways [rad]
_EQUAL = 1e-9


def rolled_over(rollover: Rollover, written: float, zero: float, start: float) -> float:
    """Return the position for an absolute word [rad].

    Fanuc's rotary axis roll-over turns the shorter way, for half a turn forwards. Its rotary axis control,
    and LinuxCNC's wrapped rotary axis, take the sign as direction: C-90 turns backwards to 90 degrees.

    Args:
        written: of the word. zero: of the program, as an axis position. start: the axis's position [rad].
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
    # add whole turns to the word, so that the angle is exactly the written one
    return end + TURN * (round((start + way - end) / TURN) + turns)
