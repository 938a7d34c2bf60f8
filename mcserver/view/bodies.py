"""Bodies of ``[clearance]`` as solids, about their middles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mcserver.units import MM
from mcserver.view.solids import Colour, Solid, ball, box, capsule, cylinder

BODY: Colour = (150, 156, 165)
ZONE: Colour = (170, 51, 119)


def body_solids(shape: str, size_mm: Sequence[float], colour: Colour = BODY) -> list[Solid]:
    """Return what `mcserver.machine.clearance_section.measures` says of a body; none of a mesh or cutter."""
    size = [each * MM for each in size_mm]
    match shape:
        case "box":
            return [box(np.array(size), colour)]
        case "cylinder":
            return [cylinder(size[0], size[1], colour)]
        case "sphere":
            return [ball(size[0], colour)]
        case "capsule":
            half = np.array([0.0, 0.0, 0.5 * size[1]])
            return [capsule(-half, half, size[0], colour)]
    return []
