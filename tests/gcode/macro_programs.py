"""Random programs in macro B, each beside the plain lines that it comes to."""

from __future__ import annotations

from random import Random

from tests.machine_text import axes_text

HEAD = '[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\nmacros = "fanuc"\n'
MACHINE_TEXT = HEAD + axes_text(range(3), velocity=1e3, acceleration=1e4)


class MacroWriter:
    """Write one program; a parameter is given once only, so that the plain lines can be known.

    Args:
        only_calls: of all blocks only M98, without expressions.
    """

    def __init__(self, seed: int, *, only_calls: bool = False) -> None:
        self._only_calls = only_calls
        self._random = Random(seed)
        self._counter = 100
        self._label = 10
        self._programs: list[str] = []

    def program(self) -> tuple[str, str]:
        """Return the program, and its plain lines."""
        head = ["G21 G91 G94 F6000"]
        macro, plain = self._lines(0)
        text = ["%", "O1 (MAIN)", *head, *macro, "M30", *self._programs, "%"]
        return "\n".join(text), "\n".join([*head, *plain, "M30"])

    def _lines(self, deep: int) -> tuple[list[str], list[str]]:
        macro: list[str] = []
        plain: list[str] = []
        for _ in range(self._random.randint(1, 4)):
            blocks = [self._while, self._goto, self._back, self._call]
            moves = [self._move, self._macro]
            if self._only_calls:
                blocks, moves = [self._call], [self._move]
            if deep < 3 and self._random.random() < 0.6:
                more, unrolled = self._random.choice(blocks)(deep)
            else:
                more, unrolled = self._random.choice(moves)()
            macro += more
            plain += unrolled
        return macro, plain

    def _move(self) -> tuple[list[str], list[str]]:
        length = self._random.randint(1, 9)
        line = f"G1 {self._random.choice('XYZ')}{length}"
        return [f"N{self._labelled()} {line}"], [line]

    def _labelled(self) -> int:
        self._label += 1
        return self._label

    def _counted(self) -> int:
        self._counter += 1
        return 100 + self._counter % 100

    def _while(self, deep: int) -> tuple[list[str], list[str]]:
        turns, counter = self._random.randint(0, 3), self._counted()
        macro, plain = self._lines(deep + 1)
        head = [f"#{counter}={turns}", f"WHILE [#{counter} GT 0] DO{deep + 1}"]
        return [*head, *macro, f"#{counter}=#{counter}-1", f"END{deep + 1}"], plain * turns

    def _goto(self, deep: int) -> tuple[list[str], list[str]]:
        label, taken = self._labelled(), self._random.random() < 0.5
        macro, plain = self._lines(deep + 1)
        return [f"IF [{int(taken)} EQ 1] GOTO {label}", *macro, f"N{label}"], [] if taken else plain

    def _back(self, deep: int) -> tuple[list[str], list[str]]:
        label, turns, counter = self._labelled(), self._random.randint(1, 3), self._counted()
        macro, plain = self._lines(deep + 1)
        tail = [f"#{counter}=#{counter}+1", f"IF [#{counter} LT {turns}] GOTO {label}"]
        return [f"#{counter}=0", f"N{label}", *macro, *tail], plain * turns

    def _call(self, deep: int) -> tuple[list[str], list[str]]:
        times, number = self._random.randint(1, 3), 1000 + self._labelled()
        # a loop of a subprogram has a number of its own
        macro, plain = self._lines(deep + 1)
        self._programs += [f"O{number}", *macro, "M99"]
        shown = self._random.choice([f"P{number} L{times}", f"P{times}{number}"])
        return [f"M98 {shown}"], plain * times

    def _macro(self) -> tuple[list[str], list[str]]:
        number, length = 1000 + self._labelled(), self._random.randint(1, 9)
        self._programs += [f"O{number}", "G1 X[#1 * 2] Y#2", "M99"]
        return [f"G65 P{number} A{length}"], [f"G1 X{2 * length}"]
