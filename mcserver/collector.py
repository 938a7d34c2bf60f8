"""The garbage collector of a process that runs for long and makes many objects."""

from __future__ import annotations

import gc

# New objects between two looks of the collector.
YOUNG_OBJECTS = 20_000


def settle_collector() -> None:
    """What is here now stays: thousands of values a second need not look through it again."""
    gc.freeze()
    gc.set_threshold(YOUNG_OBJECTS, 10, 10)
