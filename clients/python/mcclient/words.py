"""Words of the wire: texts of a few known values, to which a later server may add."""

from __future__ import annotations

import enum


class Word(enum.StrEnum):
    """A text that is one of a few; ``ProgramState.RUNNING == "running"``.

    One that this version does not know is kept as it is: it is no member, and its name is ``LATER``.
    """

    @classmethod
    def _missing_(cls, value: object) -> Word | None:
        if not isinstance(value, str):
            return None
        later = str.__new__(cls, value)
        later._name_ = "LATER"
        later._value_ = value
        return later
