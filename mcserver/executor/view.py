"""State of an executor's slots in its newest cycle."""

from __future__ import annotations

import msgspec


class SlotView(msgspec.Struct, frozen=True):
    """One executor slot: u, playback rate and override of its program."""

    u: float
    rate: float
    override: float = 1.0
