"""Suppress faults of a check that follow from a refused tilted plane (D-111)."""

from __future__ import annotations

import re

from mcserver.errors import Diagnostic
from mcserver.gcode.semantics.tilted_planes import OUT_OF_ORDER

_CODE = re.compile(r"G[ \t]*0*(68[ \t]*\.20*|53[ \t]*\.10*|69)(?![0-9.])")
# faults of the plane, and of the ends of moves in it
_FOLLOWING = frozenset({"MC175", "MC176", "MC201"})


class LostPlanes:
    """Tracks G68.2, G53.1 and G69 of one program during a check."""

    def __init__(self) -> None:
        self._lost = False

    def unrelated(self, code: str, faults: tuple[Diagnostic, ...], *, tilted: bool) -> tuple[Diagnostic, ...]:
        """Return the faults of a line that do not follow from a plane refused before.

        Args:
            code: the line without comments, in capitals. tilted: a plane is in force after it.
        """
        codes = {match[1][:2] for match in _CODE.finditer(code)}
        if not (codes or self._lost):
            return faults
        tilts = "68" in codes
        unrelated = tuple(
            fault
            for fault in faults
            if not self._lost
            or fault.code not in _FOLLOWING
            or (tilts and not fault.message.startswith(OUT_OF_ORDER))
        )
        refused = any(fault.severity == "error" for fault in faults)
        if "69" in codes or tilts:
            self._lost = tilts and refused
        elif codes and refused and tilted:
            # the tool is not turned to the plane
            self._lost = True
        return unrelated
