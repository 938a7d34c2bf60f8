"""The one place where units are converted.

Inside the server every quantity is SI: metres, radians, seconds, newton metres. Millimetres, inches,
degrees and minutes exist only at the edges: G-code text, machine files, reports.
"""

from __future__ import annotations

import enum
import math

MM = 1e-3
INCH = 25.4e-3
FOOT = 12.0 * INCH
DEGREE = math.pi / 180.0
MINUTE = 60.0
TURN = 2.0 * math.pi


class AxisType(enum.Enum):
    """What an axis measures, and so its unit at the edges."""

    LINEAR = "linear"
    ROTARY = "rotary"

    @property
    def si_per_unit(self) -> float:
        """Metres per millimetre, or radians per degree."""
        return MM if self is AxisType.LINEAR else DEGREE

    @property
    def unit(self) -> str:
        """Name of the unit at the edges."""
        return "mm" if self is AxisType.LINEAR else "deg"
