"""Find what an editor can fold: blocks of comments, and what stands under each of them."""

from __future__ import annotations

import re
from collections.abc import Sequence

_ONLY_COMMENT = re.compile(r"[ \t]*(?:;.*|(?:\([^)]*\)[ \t]*)+(?:;.*)?)\Z", re.DOTALL)


def folding_ranges(lines: Sequence[str]) -> list[tuple[int, int, bool]]:
    """Return (first line, last line, True for comments) from 0, last included, of two lines or more.

    A block is a row of lines of comments alone. It heads a section, which ends before the next block.
    """
    found: list[tuple[int, int, bool]] = []
    heads: list[int] = []
    first = -1
    for number, line in enumerate([*lines, ""]):
        if _ONLY_COMMENT.match(line):
            if first < 0:
                first = number
                heads.append(number)
        elif first >= 0:
            if number - first > 1:
                found.append((first, number - 1, True))
            first = -1
    for place, head in enumerate(heads):
        last = (heads[place + 1] if place + 1 < len(heads) else len(lines)) - 1
        while last > head and not lines[last].strip():
            last -= 1
        if last > head and not _ONLY_COMMENT.match(lines[last]):
            found.append((head, last, False))
    return found
