"""Rows and entries that a program's planner asks to have replaced, from the executor's side."""

from __future__ import annotations

import numpy as np

from mcserver.executor.control_queue import ControlQueue
from mcserver.executor.entries import ControlKind
from mcserver.executor.headroom import RATE_MAX
from mcserver.executor.playback.playback import Playback
from mcserver.executor.playback.rate_control import RateControl
from mcserver.executor.shm.rings import ProgramRing
from mcserver.motion.kernels.rate_changes import NEAR_U

# Rows beyond those that setpoints are known to need, which they span.
SPANNED = 3.0


def answer_replacement(
    ring: ProgramRing, playback: Playback, queue: ControlQueue, ramp: RateControl, u: float, *, plays: bool
) -> None:
    """Take new rows in the place of old ones, at a cycle's beginning, or refuse.

    They are taken where they are behind all that the change of the rate under way passes, and behind what
    this cycle may pass: each setpoint is what it would be if these rows had come first. They are also taken
    where that change keeps all limits on them too: it is tried on them, and goes on as it was decided.

    Args:
        plays: whether the program moves by rows, and waits for nothing.
    """
    row, entry = ring.replacement
    last_u = playback.u_before(row)
    soonest = u + 2.0 * RATE_MAX + SPANNED
    if not plays or last_u is None or last_u < soonest or not _are_edges(ring, queue, entry, last_u):
        ring.refuse_replacement()
        return
    if last_u < ramp.decided_until(u) + SPANNED:
        ring.try_replacement()
        playback.look()
        edge, _ = queue.edge(u)
        if not ramp.may_go_on(u, edge):
            ring.refuse_replacement()
            playback.look()
            return
    ring.take_replacement()
    queue.replaced(entry, last_u)


def _are_edges(ring: ProgramRing, queue: ControlQueue, entry: int, u: float) -> bool:
    """Return whether entries from one on are still to come, only say where lines begin and end, and are those
    behind the row at u.
    """
    if entry < queue.next_number:
        return False
    places = np.arange(entry, ring.controls_written) % ring.controls
    before = np.arange(queue.next_number, entry) % ring.controls
    edges = (ring.entry_kind[places] <= ControlKind.LINE_END).all()
    behind = (ring.entry_u[places] >= u - NEAR_U).all() and (ring.entry_u[before] <= u + 1.0 + NEAR_U).all()
    return bool(edges and behind)
