"""Where work coordinate systems have their zeros in a picture of the axes 0, 1 and 2."""

from __future__ import annotations

from collections.abc import Mapping


def work_zeros(origins: Mapping[str, Mapping[str, float]]) -> dict[str, list[float]]:
    """Return X, Y and Z of each zero [mm] by name, with the machine's own if there is any.

    Args:
        origins: by system, such as ``G54``: where the axes read zero, by number as text [mm].
    """
    found = {
        system: [float(origin.get(str(axis), 0.0)) for axis in range(3)] for system, origin in origins.items()
    }
    return {"machine": [0.0, 0.0, 0.0], **found} if found else {}
