"""Where an executor's programs are, as its newest cycle shows them."""

from __future__ import annotations

import msgspec


class SlotView(msgspec.Struct, frozen=True):
    """One executor slot: where its program is on its time axis, how fast that passes, its override."""

    u: float
    rate: float
    override: float = 1.0
