"""Read O-words, and compile the lines of their blocks to instructions (D-83)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

from mcserver.gcode.computing.expressions import ComputingError, Value, read_value, skip
from mcserver.gcode.computing.line_template import LineTemplate
from mcserver.gcode.line_faults import Span
from mcserver.gcode.text.source import split_lines

# limits of one block of O-words: lines, and characters of their text
MOST_LINES = 100_000
MOST_CHARACTERS = 8 << 20
# depth of nested O-words
DEEPEST = 64
MOST_ARGUMENTS = 30

_WORDS = (
    "sub",
    "endsub",
    "return",
    "call",
    "while",
    "endwhile",
    "do",
    "if",
    "elseif",
    "else",
    "endif",
    "repeat",
    "endrepeat",
    "break",
    "continue",
)
_O_WORD = re.compile(
    r"[ \t]*/?[ \t]*(?:N[0-9]+[ \t]*)?O[ \t]*(?:<([^<>]*)>|([0-9]+)|(?=[\[#]))", re.IGNORECASE
)
# longer words first; blanks may stand anywhere: "else if" is elseif (LinuxCNC)
_SPACED = "|".join(r"[ \t]*".join(word) for word in sorted(_WORDS, key=len, reverse=True))
_KEYWORD = re.compile(rf"[ \t]*({_SPACED})(?![A-Z])", re.IGNORECASE)
# M70 to M73 act between two lines (D-138)
_SAVING = re.compile(r"[ \t]*(?:N[0-9]+[ \t]*)?(M[ \t]*0*7[0-3])[ \t\r]*", re.IGNORECASE)
_COMMENT = re.compile(r"\([^()]*\)|;.*")
# O-words with one value, and those with an optional one
_ASKS = frozenset({"while", "if", "elseif", "repeat"})
_MAY_ASK = frozenset({"return", "endsub"})
# lines without code in the file of a subprogram: empty, a percent sign, the end of a program
_NO_CODE = re.compile(r"[ \t]*(?:%.*|M0?2|M30)?[ \t\r]*", re.IGNORECASE)
_OPENING = {"sub": "endsub", "while": "endwhile", "do": "while", "if": "endif", "repeat": "endrepeat"}
_BEGIN_BLOCKS = frozenset({"sub", "while", "do", "if", "repeat"})


class Statement(NamedTuple):
    """An O-word.

    Attributes:
        name: its number or name; empty if ``number`` computes it. values: conditions or arguments.
        span: of the O-word itself.
    """

    word: str
    name: str
    number: Value | None
    values: tuple[Value, ...]
    line: int
    span: Span


def read_statement(text: str, line: int) -> Statement | None:
    """Read the O-word at the start of a line; None if there is none, or only the number of a program.

    Raises:
        ComputingError: MC160, MC161.
    """
    found = _O_WORD.match(text)
    if found is None:
        return None
    number: Value | None = None
    at = found.end()
    if found[1] is None and found[2] is None:
        number, at = read_value(text, at)
    name = "".join((found[1] or "").split()).lower() if found[2] is None else str(int(found[2]))
    keyword = _KEYWORD.match(text, at)
    start = found.start() + len(found[0]) - len(found[0].lstrip(" \t/")) + 1
    if keyword is None:
        if number is None and found[2] is not None and not _COMMENT.sub("", text[at:]).strip():
            return None
        raise ComputingError(
            "MC161",
            "the O-word does not say what it is",
            (start, max(at, start) + 1),
            f"there are {' '.join(_WORDS)}",
        )
    word = "".join(keyword[1].split()).lower()
    span = (start, keyword.end() + 1)
    if number is not None and word != "call":
        raise ComputingError("MC161", f"the number of {word} is computed", span, "only call computes one")
    values, at = _read_values(text, keyword.end())
    rest = _COMMENT.sub(lambda match: " " * len(match[0]), text[at:])
    if rest.strip():
        begin = at + len(rest) - len(rest.lstrip())
        raise ComputingError(
            "MC161",
            f"nothing stands behind {word} and its values",
            (begin + 1, len(rest.rstrip()) + at + 1),
            "give it a line of its own",
        )
    least, most = (1, 1) if word in _ASKS else (0, 1) if word in _MAY_ASK else (0, 0)
    if word == "call":
        most = MOST_ARGUMENTS
    if not least <= len(values) <= most:
        asked = f"{least} value{'s' * (least != 1)}" if least == most else f"at most {most}"
        raise ComputingError("MC161", f"{word} has {len(values)} values, it takes {asked}", span)
    return Statement(word, name, number, tuple(values), line, span)


def _read_values(text: str, at: int) -> tuple[list[Value], int]:
    values = []
    while text[skip(text, at) : skip(text, at) + 1] == "[":
        value, at = read_value(text, at)
        values.append(value)
    return values, at


@dataclass(slots=True, eq=False)
class Instruction:
    """A step of a routine.

    Attributes:
        kind: ``line``, ``state`` (M70 to M73, in ``name``), or an O-word's; ``test`` jumps to ``target`` if
            its value is 0, ``jump`` always, ``again`` while repetitions are left of the loop that begins
            at ``target`` - 1.
        span: columns for faults.
    """

    kind: str
    line: int
    span: Span = (1, 2)
    values: tuple[Value, ...] = ()
    target: int = -1
    template: LineTemplate | None = None
    name: str | Value = ""


class Routine:
    """Instructions of one block of O-words, or of a subprogram.

    Attributes:
        name: of a subprogram; else empty. first, last: its lines. file: file of the machine's with the lines.
    """

    def __init__(self, name: str, first: int) -> None:
        self.name = name
        self.first = first
        self.last = first
        self.file = ""
        self.code: list[Instruction] = []


@dataclass(eq=False)
class _Open:
    """An O-word that has not been closed.

    Attributes:
        out, next: jumps to its end, and to its next turn. test: the one that jumps to the next branch.
    """

    statement: Statement
    start: int
    out: list[Instruction] = field(default_factory=list)
    next: list[Instruction] = field(default_factory=list)
    test: Instruction | None = None
    has_else: bool = False

    @property
    def word(self) -> str:
        return self.statement.word


class BlockCompiler:
    """Compiles the lines of a block, from the O-word that opens it to the one that closes it.

    Raises:
        ComputingError: for a line, which is not added then; MC161, MC164.
    """

    def __init__(self, first: Statement) -> None:
        self.routine = Routine(first.name if first.word == "sub" else "", first.line)
        self._open: list[_Open] = []
        self._characters = 0
        self._lines = 0
        self._add_statement(first)

    @property
    def closed(self) -> bool:
        """Whether the block is complete."""
        return not self._open

    def unclosed(self) -> ComputingError:
        """Return the fault of a text that ends inside the block."""
        innermost = self._open[-1].statement
        word = _OPENING[innermost.word]
        return ComputingError(
            "MC161",
            f"o{shown_name(innermost.name)} {innermost.word} in line {innermost.line} is not closed",
            innermost.span,
            f"write o{shown_name(innermost.name)} {word} behind its lines",
        )

    def add(self, text: str, line: int, statement: Statement | None) -> None:
        """Add the next line; ``statement``: its O-word."""
        if statement is not None:
            self._add_statement(statement)
            return
        self._lines += 1
        self._characters += len(text)
        if self._lines > MOST_LINES or self._characters > MOST_CHARACTERS:
            raise ComputingError(
                "MC164",
                f"more than {MOST_LINES} lines or {MOST_CHARACTERS >> 20} MB stand in one block of O-words",
                (1, len(text) + 1),
                "let the main part of the program stand outside of O-words",
            )
        self.routine.code.append(_line_step(text, line))

    def _add_statement(self, statement: Statement) -> None:
        word = statement.word
        if word == "sub" and self._open:
            raise _structure(statement, "a subprogram stands within another block", "put it ahead of that")
        inner = self._open[-1].statement if self._open else statement
        if word == "while" and (inner.word, inner.name) == ("do", statement.name):
            self._close(statement)
        elif word in _BEGIN_BLOCKS:
            if len(self._open) >= DEEPEST:
                raise ComputingError("MC164", f"O-words stand more than {DEEPEST} deep", statement.span)
            self._begin(statement)
        elif word in ("elseif", "else"):
            self._branch(statement)
        elif word in ("break", "continue"):
            self._leave(statement)
        elif word in ("call", "return"):
            if word == "return" and self._open[0].word != "sub":
                raise _structure(statement, "return stands outside of a subprogram", "take it out")
            self._step(word, statement).name = statement.number or statement.name
        else:
            self._close(statement)
        self.routine.last = statement.line

    def _step(self, kind: str, statement: Statement, target: int = -1) -> Instruction:
        step = Instruction(kind, statement.line, statement.span, statement.values, target)
        self.routine.code.append(step)
        return step

    def _begin(self, statement: Statement) -> None:
        opened = _Open(statement, len(self.routine.code))
        if statement.word in ("while", "if"):
            opened.test = self._step("test", statement)
        elif statement.word == "repeat":
            opened.out.append(self._step("repeat", statement))
        self._open.append(opened)

    def _innermost(self, statement: Statement, *words: str) -> _Open:
        opened = self._open[-1]
        if opened.word not in words or opened.statement.name != statement.name:
            inner = opened.statement
            raise _structure(
                statement,
                f"o{shown_name(statement.name)} {statement.word} stands within o{shown_name(inner.name)}"
                f" {inner.word} of line {inner.line}",
                f"o{shown_name(inner.name)} {_OPENING[inner.word]} comes first",
            )
        return opened

    def _branch(self, statement: Statement) -> None:
        opened = self._innermost(statement, "if")
        if opened.has_else:
            raise _structure(statement, f"{statement.word} stands behind else", "else comes last")
        opened.out.append(self._step("jump", statement))
        assert opened.test is not None
        opened.test.target = len(self.routine.code)
        opened.test = None
        if statement.word == "elseif":
            opened.test = self._step("test", statement)
        else:
            opened.has_else = True

    def _leave(self, statement: Statement) -> None:
        loops = ("while", "do", "repeat")
        for opened in reversed(self._open):
            if opened.word in loops and opened.statement.name == statement.name:
                step = self._step("jump", statement)
                (opened.out if statement.word == "break" else opened.next).append(step)
                return
        raise _structure(
            statement,
            f"{statement.word} names no loop that it stands in",
            "give it the number of its while, do or repeat",
        )

    def _close(self, statement: Statement) -> None:
        ends = {"endsub": "sub", "endwhile": "while", "while": "do", "endif": "if", "endrepeat": "repeat"}
        opened = self._innermost(statement, ends[statement.word])
        code = self.routine.code
        turn = len(code)
        if opened.word == "sub":
            self._step("return", statement)
        elif opened.word == "while":
            turn = opened.start
            self._step("jump", statement, opened.start)
        elif opened.word == "do":
            opened.test = self._step("test", statement)
            self._step("jump", statement, opened.start)
        elif opened.word == "repeat":
            self._step("again", statement, opened.start + 1)
        for step in opened.next:
            step.target = turn
        if opened.test is not None:
            opened.out.append(opened.test)
        for step in opened.out:
            step.target = len(code)
        self._open.pop()
        self.routine.last = statement.line


def shown_name(name: str) -> str:
    """Return a name as written after the letter O."""
    return name if name.isdigit() else f"<{name}>"


def _structure(statement: Statement, message: str, hint: str) -> ComputingError:
    return ComputingError("MC161", message, statement.span, hint)


def call_routine(statement: Statement) -> Routine:
    """Return the routine of a call in the main program.

    Raises:
        ComputingError: MC161 for another O-word, which has to be in a block.
    """
    if statement.word != "call":
        raise _structure(
            statement,
            f"o{shown_name(statement.name)} {statement.word} has nothing to belong to",
            "its first O-word is missing above, or has another number",
        )
    name = statement.number or statement.name
    routine = Routine("", statement.line)
    routine.code.append(Instruction("call", statement.line, statement.span, statement.values, name=name))
    return routine


def line_routine(text: str, line: int) -> Routine:
    """Return the routine of a line that computes.

    Raises:
        ComputingError: MC140, MC160.
    """
    routine = Routine("", line)
    routine.code.append(_line_step(text, line))
    return routine


def saves(text: str) -> bool:
    """Return whether a line is one of M70 to M73."""
    return _SAVING.match(text) is not None and _SAVING.fullmatch(_COMMENT.sub("", text)) is not None


def _line_step(text: str, line: int) -> Instruction:
    found = _SAVING.match(text)
    if found is not None and saves(text):
        return Instruction("state", line, (found.start(1) + 1, found.end(1) + 1), name=f"M{found[1][-2:]}")
    return Instruction("line", line, template=LineTemplate(text))


def file_routine(name: str, text: str) -> Routine:
    """Compile a file that holds one subprogram, which has its name.

    Raises:
        ComputingError: with its line in the file.
    """
    compiler: BlockCompiler | None = None
    number = 0
    try:
        for number, line in enumerate(split_lines(text), start=1):
            statement = read_statement(line, number)
            if compiler is not None and not compiler.closed:
                compiler.add(line, number, statement)
            elif statement is not None:
                if compiler is not None or (statement.word, statement.name) != ("sub", name):
                    raise _structure(statement, "another O-word stands outside of the subprogram", "")
                compiler = BlockCompiler(statement)
            elif not _NO_CODE.fullmatch(_COMMENT.sub("", line)):
                raise ComputingError("MC161", "a line stands outside of the subprogram", (1, len(line) + 1))
        if compiler is not None and not compiler.closed:
            raise compiler.unclosed()
    except ComputingError as error:
        error.line = error.line or number
        raise
    if compiler is None:
        raise ComputingError("MC161", f"there is no o{shown_name(name)} sub", (1, 2), line=1)
    return compiler.routine
