"""Types of values in the machine file, as msgspec's constraints; ``description`` is a mistake's hint."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated

from msgspec import Meta

# Least difference of consecutive places in a table [mm, deg].
LEAST_STEP = 0.001

Limit = Annotated[float, Meta(gt=0.0, description="leave the key out where there is no limit")]
Positive = Annotated[float, Meta(gt=0.0, description="give a number above 0")]
NotNegative = Annotated[float, Meta(ge=0.0, description="leave the key out if it is not known")]
Damping = Annotated[float, Meta(ge=0.0, le=0.5, description="0.05 to 0.1 is usual")]
Milliseconds = Annotated[int, Meta(ge=0, le=0xFFFF, description="100 is usual")]
Unsigned32 = Annotated[int, Meta(ge=0, le=0xFFFFFFFF, description="see 1018h of the drive")]
Count = Annotated[int, Meta(ge=1, le=0xFFFFFFFF)]


def ascending(places: Sequence[float]) -> bool:
    """Return whether the places of a table ascend by at least `LEAST_STEP` each [mm, deg]."""
    return all(after - before >= LEAST_STEP for before, after in pairwise(places))
