"""Random programs with M98 and M99, read here and by LinuxCNC's rs274: their differences are printed.

``python -m tests.bench.rs274_calls [PROGRAMS] [SEED]``, as `tests.bench.rs274_programs`. rs274 finds
subprograms behind their call only, so an inner one stands behind the outer one here.
"""

from __future__ import annotations

import re
import sys

from mcserver.machine.machine_file import parse_machine
from tests.bench.rs274_programs import compare
from tests.gcode.macro_programs import MACHINE_TEXT, MacroWriter


class CallWriter:
    """Write one program of moves and calls."""

    def __init__(self, seed: int) -> None:
        self._writer = MacroWriter(seed, only_calls=True)

    def program(self) -> str:
        """Return the text."""
        text = re.sub(r"N[0-9]+ ", "", self._writer.program()[0])
        # repeats ahead of the number are Fanuc's alone
        text = re.sub(r"M98 P([0-9])([0-9]{4})\b", r"M98 P\2 L\1", text)
        main, _, rest = text.partition("M30\n")
        programs = re.split(r"(?m)^(?=O[0-9])", rest.removesuffix("%"))
        return "".join([main, "M30\n", *reversed(programs), "%\n"])


if __name__ == "__main__":
    numbers = (int(each) for each in sys.argv[1:3])
    sys.exit(bool(compare(CallWriter, *numbers, machine=parse_machine(MACHINE_TEXT))))
