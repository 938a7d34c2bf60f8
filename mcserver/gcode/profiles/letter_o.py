"""Find the letter O among the digits of a number, as profiles read words."""

from __future__ import annotations

import re

from mcserver.errors import Edit
from mcserver.gcode.line_faults import FaultList

_WITH_O = re.compile(r"(?<![A-Z<])([A-MP-Z])([-+]?[0-9O.]*O[0-9O.]*)(?![A-Z.0-9])")
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"


def found_letter_o(code: str, faults: FaultList) -> bool:
    """Report the first number of a line with the letter O among its digits (MC101).

    A lone O counts as a digit where only a number fits, as in ``XO``; not in O-words and program numbers.
    """
    for found in _WITH_O.finditer(code):
        digits = found[2].replace("O", "0")
        if re.fullmatch(_NUMBER, digits):
            faults.add(
                "MC101",
                f"'{found[0]}' holds the letter O where the digit 0 belongs",
                (found.start() + 1, found.end() + 1),
                f"write {found[1]}{digits}",
                edit=Edit(found.start(2) + 1, found.end(2) + 1, digits),
            )
            return True
    return False
