"""Describe a contact that the planner has found ahead as a diagnostic."""

from __future__ import annotations

import math
from collections.abc import Sequence

from mcserver.clearance.distances import too_near
from mcserver.clearance.mounted import NOT_KNOWN
from mcserver.clearance.scene import Scene
from mcserver.clearance.slow_zones import SLOWER
from mcserver.clearance.sweep import Contact
from mcserver.errors import Diagnostic
from mcserver.units import MM


def touching(
    scene: Scene, contact: Contact, line: int, hint: str, margin: float, others: Sequence[str]
) -> Diagnostic:
    """Return the diagnostic of a contact.

    Args:
        hint: remedy, if the contact has none of its own. margin: that bodies keep [m].
        others: other programs that move one of the two bodies.
    """
    pair = scene.pairs[contact.pair]
    one, other = pair.names
    slow = pair.max_speed
    if slow < math.inf:
        message = f"{one!r} may go faster than {slow / MM:g} mm/s in the slow zone {other!r}"
        hint = SLOWER
    elif not contact.shown:
        message = f"it cannot be shown that {one!r} stays clear of {other!r}"
    elif pair.zone:
        message = pair.crosses(will=True)
    else:
        message = f"{one!r} would come too near to {other!r}: {too_near(contact.distance, margin)}"
    if others:
        run = "runs" if len(others) == 1 else "run"
        message += f", where {' and '.join(others)} {run} beside it"
        hint = "let one wait until the other has ended or left, such as by M66"
    elif not scene.certain(contact.pair):
        hint = NOT_KNOWN
    code = "MC320" if not pair.zone else "MC321" if slow == math.inf else "MC322"
    return Diagnostic(code=code, message=message, line=line, hint=hint)
