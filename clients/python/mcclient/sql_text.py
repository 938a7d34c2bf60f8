"""Text as SQL has it."""

from __future__ import annotations


def quoted(value: object) -> str:
    """Return a value as a string of SQL, such as a path for ``COPY``, which takes no parameters."""
    return "'" + str(value).replace("'", "''") + "'"
