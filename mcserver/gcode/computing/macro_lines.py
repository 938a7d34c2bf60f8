"""Compile lines of Fanuc's macro B to the instructions that O-words are compiled to (D-91, D-92)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from types import MappingProxyType

from mcserver.gcode.computing.expressions import (
    NGC,
    ComputingError,
    Language,
    Null,
    Operators,
    Value,
    read_value,
    skip,
)
from mcserver.gcode.computing.line_template import LineTemplate
from mcserver.gcode.computing.o_words import Instruction, Routine
from mcserver.gcode.line_faults import Span

# numbers that DO may have, and so the depth of nested loops in one program
_LOOPS = (1, 2, 3)
MOST_REPEATS = 9999
# values closer than this are equal
_EQUAL = 1e-8
_COMMENT = re.compile(r"\([^()]*\)?|;.*")
_HEAD = re.compile(r"[ \t]*(?:/[1-9]?)?[ \t]*(?:N[ \t]*([0-9]+))?[ \t]*", re.IGNORECASE)
_PROGRAM = re.compile(r"[ \t]*[O:][ \t]*([0-9]+)[ \t]*\Z", re.IGNORECASE)
_O_WORD = re.compile(r"O[ \t]*(?:<|[0-9]+[ \t]*[A-Z]{2})", re.IGNORECASE)
_WORD = re.compile(
    r"(IF|WHILE)[ \t]*(?=\[)|(GOTO)|(DO|END)[ \t]*([0-9]+)|(G[ \t]*0*65)(?![0-9.])", re.IGNORECASE
)
_THEN = re.compile(r"[ \t]*(?:(GOTO)|(THEN)[ \t]*(?=#))", re.IGNORECASE)
_DO = re.compile(r"[ \t]*DO[ \t]*([0-9]+)", re.IGNORECASE)
# G65 after other G-codes of its line, and those codes
_CALL_BEHIND = re.compile(r"((?:G[ \t]*[0-9.]+[ \t]*)*?)(G[ \t]*0*65)(?![0-9.])", re.IGNORECASE)
_CALL = re.compile(r"M[ \t]*0*(9[89])(?![0-9.])", re.IGNORECASE)
_OWN_WORD = re.compile(r"([A-Z])(?=[ \t]*[-+#\[.0-9])", re.IGNORECASE)
_STOP = re.compile(r"#[ \t]*3006[ \t]*=")
# letters of the first kind of argument list; the second continues with sets of I J K
_ARGUMENTS = MappingProxyType(
    {
        **dict(zip("ABCDEFHIJKM", (1, 2, 3, 7, 8, 9, 11, 4, 5, 6, 13), strict=True)),
        **dict(zip("QRSTUVWXYZ", range(17, 27), strict=True)),
    }
)
LOCALS = 33


def _compared(test: Callable[[float, float], bool]) -> Callable[[float, float], float]:
    """Return an equality comparison that tells unset parameters from 0."""

    def compare(left: float, right: float) -> float:
        null = isinstance(left, Null), isinstance(right, Null)
        return float(test(0.0, 0.0 if null[0] == null[1] else 1.0) if any(null) else test(left, right))

    return compare


def _of_bits(compute: Callable[[int, int], int]) -> Callable[[float, float], float]:
    def computed(left: float, right: float) -> float:
        bits = round(left), round(right)
        if min(bits) < 0 or abs(left - bits[0]) > _EQUAL or abs(right - bits[1]) > _EQUAL:
            raise ValueError("bits are of whole numbers")
        return float(compute(*bits))

    return computed


_OPERATORS: Operators = MappingProxyType(
    {
        **{name: NGC.operators[name] for name in ("*", "/", "+", "-", "GT", "GE", "LT", "LE")},
        "MOD": (4, lambda left, right: math.fmod(round(left), round(right))),
        "AND": (4, _of_bits(lambda left, right: left & right)),
        "OR": (3, _of_bits(lambda left, right: left | right)),
        "XOR": (3, _of_bits(lambda left, right: left ^ right)),
        "EQ": (2, _compared(lambda left, right: abs(left - right) < _EQUAL)),
        "NE": (2, _compared(lambda left, right: abs(left - right) >= _EQUAL)),
    }
)
MACRO_B = Language(
    _OPERATORS,
    MappingProxyType(
        {
            **NGC.functions,
            "FIX": lambda value: float(math.trunc(value)),
            "FUP": lambda value: math.copysign(math.ceil(abs(value)), value),
        }
    ),
    full_turn=True,
    null=True,
)


def blank_comments(text: str) -> str:
    """Replace a line's comments by blanks, so that columns stay."""
    return _COMMENT.sub(lambda found: " " * len(found[0]), text)


def program_number(text: str) -> str | None:
    """Return the number of the program that begins at a line; None if none does."""
    found = _PROGRAM.match(blank_comments(text))
    return None if found is None else str(int(found[1]))


@dataclass(slots=True, eq=False)
class Step(Instruction):
    """A step of a program in macro B.

    Attributes:
        kind: those of `Instruction`; ``goto``, ``program`` (M98), ``macro`` (G65), ``end`` (M99).
        values: block number for ``goto`` and ``end``; program number and repeats for calls.
        arguments: of a macro, by parameter number. text: of a line without expressions.
    """

    arguments: dict[int, Value] = field(default_factory=dict)
    text: str = ""


class MacroProgram(Routine):
    """A program in macro B that is compiled line by line.

    Attributes:
        closed: it is complete. labels: by block number, indexes of the blocks' first instructions.
    """

    def __init__(self, name: str, first: int) -> None:
        super().__init__(name, first)
        self.closed = False
        self.labels: dict[int, list[int]] = {}
        # open loops: number of DO, index to return to, and the test
        self._loops: list[tuple[int, int, Step | None]] = []

    @property
    def in_loop(self) -> bool:
        """Whether a DO is open."""
        return bool(self._loops)

    def clear(self) -> None:
        """Remove all lines."""
        self.code.clear()
        self.labels.clear()
        self._loops.clear()

    def cut(self, line: int) -> None:
        """Remove the last line, and the loop that it opens."""
        while self.code and self.code[-1].line == line:
            self.code.pop()
        length = len(self.code)
        self.labels = {n: kept for n, at in self.labels.items() if (kept := [i for i in at if i < length])}
        self._loops = [each for each in self._loops if each[1] < length]

    def add(self, text: str, line: int) -> None:
        """Compile the next line.

        Raises:
            ComputingError: MC140, MC160, MC181; the line is not added.
        """
        code = blank_comments(text)
        head = _HEAD.match(code)
        assert head is not None
        steps = self._compile(text, code, head.end(), line)
        if head[1] is not None:
            self.labels.setdefault(int(head[1]), []).append(len(self.code))
        self.code += steps
        self.last = line

    def _compile(self, text: str, code: str, at: int, line: int) -> list[Step]:
        word = _WORD.match(code, at)
        if word is None:
            return _plain(text, code, at, line)
        span = (word.start() + 1, word.end() + 1)
        if word[5] is not None:
            return [_macro_call(code, word.end(), line, span)]
        if word[2] is not None:
            return [_goto(code, word, line)]
        if word[3] is not None:
            return self._loop(code, word[3].upper(), int(word[4]), word.end(), line, span)
        condition, end = read_value(code, word.end(), 0, MACRO_B)
        test = Step("test", line, span, (condition,))
        if word[1].upper() == "WHILE":
            do = _DO.match(code, end)
            if do is None:
                raise _faulty("DO is missing behind WHILE", span, "write WHILE [...] DO1")
            return self._loop(code, "DO", int(do[1]), do.end(), line, span, test)
        then = _THEN.match(code, end)
        if then is None:
            raise _faulty(
                "IF asks for GOTO or THEN", span, "write IF [...] GOTO 100, or IF [...] THEN #1 = 2"
            )
        test.target = len(self.code) + 2
        if then[1] is not None:
            return [test, _goto(code, then, line)]
        template = LineTemplate(" " * then.end() + text[then.end() :], MACRO_B)
        return [test, Step("line", line, span, template=template)]

    def _loop(
        self, code: str, word: str, number: int, end: int, line: int, span: Span, test: Step | None = None
    ) -> list[Step]:
        """Open or close a loop."""
        _ends_at(code, end)
        start = len(self.code)
        if word == "DO":
            if number not in _LOOPS or any(each[0] == number for each in self._loops):
                raise _faulty(f"DO{number} stands within DO{number}, or is not 1 to 3", span, "DO1 … DO3")
            self._loops.append((number, start, test))
            return [Step("line", line, span) if test is None else test]
        if not self._loops or self._loops[-1][0] != number:
            open_loop = f"DO{self._loops[-1][0]} is open" if self._loops else "no DO is open"
            raise _faulty(f"END{number} belongs to no DO: {open_loop}", span, "loops end from within")
        _, turn, begun = self._loops.pop()
        if begun is not None:
            begun.target = start + 1
        return [Step("jump", line, span, target=turn)]


def _faulty(message: str, span: Span, hint: str) -> ComputingError:
    return ComputingError("MC181", message, span, hint)


def _ends_at(code: str, at: int) -> None:
    rest = code[at:]
    if rest.strip():
        begin = at + len(rest) - len(rest.lstrip())
        shown = (begin + 1, len(code.rstrip()) + 1)
        raise _faulty("nothing stands behind a macro statement", shown, "give it a line of its own")


def _goto(code: str, word: re.Match[str], line: int) -> Step:
    value, end = read_value(code, word.end(), 0, MACRO_B)
    _ends_at(code, end)
    return Step("goto", line, (word.start() + 1, end + 1), (value,))


def _plain(text: str, code: str, at: int, line: int) -> list[Step]:
    """Compile a line that moves or sets, with M98 or M99 at its end."""
    if _O_WORD.match(code, at):
        raise _faulty(
            "O-words are not read beside macro B", (at + 1, len(code.rstrip()) + 1), "see D-91: macros"
        )
    macro = _CALL_BEHIND.match(code, at)
    if macro is not None:
        span = (macro.start(2) + 1, macro.end(2) + 1)
        ahead = _line(text[: macro.start(2)], code[: macro.start(2)], at, line)
        return [ahead, _macro_call(code, macro.end(), line, span)]
    call = _CALL.search(code)
    if call is None:
        return [_line(text, code, at, line)]
    span = (call.start() + 1, call.end() + 1)
    taken = [(call.start(), call.end())]
    values: dict[str, Value] = {}
    for found in _OWN_WORD.finditer(code, at):
        if found[1].upper() in ("PL" if call[1] == "98" else "P"):
            value, end = read_value(code, found.end(), 0, MACRO_B)
            values[found[1].upper()] = value
            taken.append((found.start(), end))
    rest = list(text)
    for begin, end in taken:
        rest[begin:end] = " " * (end - begin)
    steps = []
    if code[at:].strip() and blank_comments("".join(rest))[at:].strip():
        steps.append(_line("".join(rest), blank_comments("".join(rest)), at, line))
    if call[1] == "99":
        return [*steps, Step("end", line, span, tuple(values.values()))]
    if "P" not in values:
        raise _faulty("M98 does not say which program", span, "such as M98 P1000, or M98 P1000 L3")
    return [*steps, Step("program", line, span, tuple(values[each] for each in "PL" if each in values))]


def _line(text: str, code: str, at: int, line: int) -> Step:
    if _STOP.match(code, at):
        # a stop with a message
        said = _COMMENT.search(text)
        return Step("line", line, text=f"M0 {said[0] if said else ''}")
    step = Step("line", line, text=text)
    if ("#" in code or "[" in code) and not code.lstrip().startswith("%"):
        step.template = LineTemplate(text, MACRO_B)
    return step


def _macro_call(code: str, at: int, line: int, span: Span) -> Step:
    """Compile G65, whose arguments become parameters of the called program."""
    step = Step("macro", line, span)
    own: dict[str, Value] = {}
    # sets of I J K: a letter that is not after the one before it begins a new set
    nested, before = 0, ""
    at = skip(code, at)
    while at < len(code.rstrip()):
        letter = code[at].upper()
        if letter not in "PL" and letter not in _ARGUMENTS:
            raise _faulty(f"'{letter}' is no argument of G65", (at + 1, at + 2), "G L N O and P are none")
        value, end = read_value(code, at + 1, 0, MACRO_B)
        if letter in "PL":
            own[letter] = value
        else:
            number = _ARGUMENTS[letter]
            if letter in "IJK":
                nested += bool(before) and letter <= before
                before = letter
                number += 3 * nested
            if number > LOCALS:
                raise _faulty("G65 has more than ten I J K", (at + 1, end + 1), "#33 is the last of them")
            step.arguments[number] = value
        at = skip(code, end)
    if "P" not in own:
        raise _faulty("G65 does not say which program", span, "such as G65 P1000 A1")
    step.values = tuple(own[each] for each in "PL" if each in own)
    return step
