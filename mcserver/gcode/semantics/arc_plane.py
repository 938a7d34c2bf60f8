"""Choose the plane of an arc (D-22)."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

# first and second axis, right-handed as seen from the plane's positive normal
PLANES: Mapping[int, tuple[int, int]] = MappingProxyType({17: (0, 1), 18: (2, 0), 19: (1, 2)})
OFFSET_LETTERS = "IJK"


class NoPlane(Exception):
    """The words do not determine a plane, or contradict each other; the message names the missing word."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.message = message
        self.hint = hint


def choose_plane(chosen: int | None, offsets: frozenset[int], endpoint: frozenset[int]) -> int:
    """Return 17, 18 or 19.

    Args:
        chosen: G17-G19 in force, or None.
        offsets: which of I J K are written, as 0 1 2; empty in the R form.
        endpoint: which of X Y Z (U V W) are written, as 0 1 2.

    Raises:
        NoPlane: the words do not determine a plane, or contradict each other.
    """
    if chosen is not None:
        return chosen
    if not offsets:
        return _by_endpoint(endpoint)
    if len(offsets) == 3:
        raise NoPlane("I, J and K together lie in no single plane", "give the two offsets of the arc's plane")
    fitting = [plane for plane, axes in PLANES.items() if offsets <= set(axes)]
    if len(fitting) > 1:
        # one offset letter: prefer a plane that also contains the endpoint's words
        holding = [plane for plane in fitting if endpoint <= set(PLANES[plane])]
        fitting = holding or fitting
    if len(fitting) == 1 or 17 in fitting:
        return fitting[0] if len(fitting) == 1 else 17
    letter = OFFSET_LETTERS[next(iter(offsets))]
    raise NoPlane(
        f"{letter} alone fits the planes G{fitting[0]} and G{fitting[1]}",
        "choose the plane by G18 or G19, or give the second offset",
    )


def _by_endpoint(endpoint: frozenset[int]) -> int:
    if len(endpoint) == 3:
        return 17
    for plane, axes in PLANES.items():
        if endpoint == set(axes):
            return plane
    if len(endpoint) == 1:
        raise NoPlane(
            f"R with {'XYZ'[next(iter(endpoint))]} alone does not say in which plane the arc lies",
            "give the second word of the endpoint, or choose the plane by G17, G18 or G19",
        )
    raise NoPlane("the arc has no endpoint", "give the two words of the endpoint, or the centre by I J K")
