"""Metres and radians as the millimetres and degrees of messages."""

from __future__ import annotations

import math

import numpy as np

from mckinematics.chain import Chain
from mckinematics.pose import Array


def millimetres_text(metres: float) -> str:
    """Millimetres, to a micrometre."""
    return _number(1000.0 * metres)


def degrees_text(radians: float) -> str:
    """Degrees, to a thousandth."""
    return _number(math.degrees(radians))


def point_text(position: Array) -> str:
    """Return a point as words of the G-code: ``X -159 Y -400 Z 800``."""
    words = zip("XYZ", np.asarray(position, dtype=float), strict=True)
    return " ".join(f"{letter} {millimetres_text(float(value))}" for letter, value in words)


def joint_text(chain: Chain, column: int, value: float) -> str:
    """Return a joint position with its unit."""
    return f"{degrees_text(value)} deg" if chain.revolute[column] else f"{millimetres_text(value)} mm"


def _number(value: float) -> str:
    shown = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if shown == "-0" else shown
