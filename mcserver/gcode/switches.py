"""The operator's switches for a program: block delete and optional stop (D-98)."""

from __future__ import annotations

import re

import msgspec

from mcserver.gcode.computing.expressions import ComputingError

_BLOCK_DELETE = re.compile(r"(\ufeff?[ \t]*(?:N[ \t]*[0-9]+[ \t]*)?)/([0-9]*)", re.IGNORECASE)


class Switches(msgspec.Struct, frozen=True):
    """Switches that hold for a program from its opening to its end.

    Attributes:
        block_delete: lines that begin with ``/`` are skipped; else the ``/`` is ignored.
        optional_stop: M01 pauses; else it is ignored.
    """

    block_delete: bool = False
    optional_stop: bool = True

    @classmethod
    def of(cls, block_delete: bool | None, optional_stop: bool | None) -> Switches | None:
        """Return the switches of a request; None if it sets none."""
        if block_delete is None and optional_stop is None:
            return None
        return cls(bool(block_delete), optional_stop is not False)

    def read(self, text: str) -> str:
        """Return a line as it is to be interpreted; columns stay, and a skipped line keeps its number N.

        Raises:
            ComputingError: MC198 the line has one of several switches of block delete.
        """
        found = _BLOCK_DELETE.match(text) if "/" in text else None
        if found is None:
            return text
        if found[2] not in ("", "1"):
            raise ComputingError(
                "MC198",
                f"/{found[2]} is a block delete switch of its own; there is one here",
                (found.end(1) + 1, found.end() + 1),
                "write / where that switch is meant, and nothing where it is not",
            )
        if self.block_delete:
            return found[1]
        return found[1] + " " * (found.end() - found.end(1)) + text[found.end() :]


# no switch is set: every line is executed, and every pause stops
AS_WRITTEN = Switches()
