"""What a machine's service is started with."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import msgspec


class ServiceOptions(msgspec.Struct, frozen=True):
    """Of one start.

    Attributes:
        journal: the journal's file.
        instance: id of this start.
        clock: Unix time [s].
    """

    journal: Path
    instance: str
    clock: Callable[[], float] = time.time
