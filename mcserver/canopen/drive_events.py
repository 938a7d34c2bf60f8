"""What the service path tells the server."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

# Names as in docs/keyspace.md.
CanopenEventKind = Literal[
    "drive.emergency",
    "drive.lost",
    "drive.back",
    "drive.rebooted",
    "drive.started",
    "drive.failed",
    "bus.foreign_master",
    "bus.lost",
    "bus.back",
]


@dataclass(frozen=True)
class CanopenEvent:
    """One event; ``axis`` is None for a whole bus, ``code`` empty for good news."""

    kind: CanopenEventKind
    message: str
    axis: int | None = None
    code: str = ""
