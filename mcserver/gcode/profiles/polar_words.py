"""Read LinuxCNC's words @ and ^: radius and angle of one move (D-96)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import msgspec

from mcserver.gcode.line_faults import FaultList
from mcserver.gcode.profiles.codes import DRILLING, PROBING, TAKES_AXES, code_name
from mcserver.gcode.text.profile_words import ProfileWord

# axis whose word each replaces
POLAR_LETTERS: Final[Mapping[str, int]] = MappingProxyType({"@": 0, "^": 1})


def as_axis_words(
    polar: Sequence[ProfileWord],
    codes: Sequence[ProfileWord],
    words: Sequence[ProfileWord],
    machine_frame: bool,
    faults: FaultList,
) -> list[ProfileWord]:
    """Return words @ and ^ as X and Y, which are then read as radius and angle; empty after a fault (MC153).

    Args:
        codes, words: of their line, the latter with axes. machine_frame: G53 is one of its codes.
    """
    if not polar:
        return []
    axes = {POLAR_LETTERS[word.letter]: word for word in polar}
    takers = {code_name(word.letter, word.value) for word in codes} & TAKES_AXES
    others = sorted(takers - DRILLING - PROBING - {"REPEAT"}) + ["G53"] * machine_frame
    if len(axes) < len(polar) or any(word.axis in (0, 1) for word in words) or others:
        # the second of two equal letters, or any
        word = polar[-1]
        faults.add(
            "MC153",
            f"{word.letter}{word.text} does not go together with {others[0] if others else 'X and Y'}",
            word.span,
            "@ and ^ are a move's radius and angle, in place of X and Y",
        )
        return []
    return [
        msgspec.structs.replace(word, letter="XY"[axis], axis=axis) for axis, word in sorted(axes.items())
    ]
