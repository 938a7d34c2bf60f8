"""How near two bodies come, in the words of reports and diagnostics."""

from __future__ import annotations

import math

from mcserver.units import MM


def contact_mm(distance: float, digits: int) -> float:
    """Return the distance of a contact [mm], not negative; rounded down, so that none reads as the margin.

    Args:
        distance: [m].
    """
    return max(0.0, math.floor(distance / MM * 10.0**digits) / 10.0**digits)


def too_near(distance: float, margin: float, digits: int = 2) -> str:
    """Return a distance that is below the margin beside it, such as "4.99 mm, 5 wanted"; both in [m]."""
    return f"{contact_mm(distance, digits):.{digits}f} mm, {margin / MM:g} wanted"
