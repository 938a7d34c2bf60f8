"""Tokens that the grammars of all dialects share, and what a machine's programs may name."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from mcserver.gcode.text.words import ABSOLUTE_LETTERS, MAX_AXIS
from mcserver.language.grammar.expressions import (
    Chars,
    Expression,
    Ref,
    Repeat,
    char,
    choice,
    many,
    opt,
    seq,
    text,
)
from mcserver.machine.machine_file import Machine
from mcserver.units import AxisType

MAX_TOOL = 99  # tools of the grammar that is for any machine
DIGIT = Chars((("0", "9"),))


class Vocabulary(msgspec.Struct, frozen=True):
    """Axes and tools that programs may name.

    Attributes:
        axes: by number. letters: axis letters without U V W, which follow X Y Z.
        linear: axes that an arc may move, and letters, likewise.
        tools: numbers.
    """

    title: str
    axes: tuple[int, ...]
    letters: frozenset[str]
    linear: tuple[int, ...]
    linear_letters: frozenset[str]
    tools: tuple[int, ...]


def vocabulary(machine: Machine | None) -> Vocabulary:
    """Return what a machine's programs may name; without a machine, everything that the dialect can name."""
    if machine is None:
        every = tuple(range(MAX_AXIS + 1))
        return Vocabulary(
            "G-code of mcserver, any machine",
            every,
            frozenset(ABSOLUTE_LETTERS),
            every,
            frozenset(ABSOLUTE_LETTERS),
            tuple(range(MAX_TOOL + 1)),
        )
    axes = tuple(sorted(axis.index for axis in machine.axes))
    linear = tuple(axis.index for axis in machine.axes if axis.type is AxisType.LINEAR)
    pose = set("XYZ") if machine.tools else set()
    if any(tool.orientation for tool in machine.tools):
        pose |= set("ABC")
    return Vocabulary(
        f"G-code of mcserver, machine {machine.name}",
        axes,
        frozenset(letter for letter, axis in ABSOLUTE_LETTERS.items() if axis in axes or letter in pose),
        tuple(sorted(linear)),
        frozenset(letter for letter, axis in ABSOLUTE_LETTERS.items() if axis in linear or letter in pose),
        tuple(sorted(tool.number for tool in machine.tools)),
    )


def common_words(known: Vocabulary) -> dict[str, Expression]:
    """Build the tokens that every dialect has: each with the blanks and comments that follow it."""
    rules: dict[str, Expression] = {}
    for letter in "IJK":
        rules[f"offset-{letter.lower()}"] = word(letter, Ref("number"))
    rules["radius"] = word("R", Ref("number"))
    rules["turns"] = word("P", Ref("count"))
    rules["seconds"] = word("P", Ref("unsigned"))
    rules["tolerance"] = word("P", Ref("unsigned"))
    rules["axis-number"] = word("P", whole(known.axes))
    if known.tools:
        rules["tool"] = word("T", whole(known.tools))
    rules["feed"] = word("F", Ref("positive"))
    rules["line-number"] = word("N", Repeat(DIGIT, 1, 9))
    rules["comma"] = seq(char(","), Ref("space"))
    unsigned = choice(seq(Repeat(DIGIT, 1, 9), opt(char("."), many(DIGIT))), seq(char("."), Repeat(DIGIT, 1)))
    nonzero = Chars((("1", "9"),))
    zeros = many(char("0"))
    rules["number"] = seq(opt(Chars((("+", "+"), ("-", "-")))), Ref("unsigned"))
    rules["unsigned"] = unsigned
    rules["positive"] = choice(
        seq(zeros, nonzero, Repeat(DIGIT, 0, 8), opt(char("."), many(DIGIT))),
        seq(zeros, char("."), Repeat(char("0"), 0, 5), nonzero, many(DIGIT)),
    )
    rules["count"] = seq(zeros, nonzero, Repeat(DIGIT, 0, 2))
    rules["space"] = many(choice(Ref("blank"), Ref("comment")))
    rules["gap"] = many(Ref("blank"))
    rules["blank"] = Chars(((" ", " "), ("\t", "\t")))
    rules["comment"] = seq(char("("), many(all_but("()\r\n")), char(")"))
    rules["remark"] = seq(char(";"), many(all_but("\r\n")))
    rules["title"] = seq(char("%"), Ref("gap"), opt(all_but("GMgm();\r\n \t"), many(all_but("();\r\n"))))
    rules["line-end"] = seq(Repeat(Chars((("\r", "\r"),)), 0, 1), Chars((("\n", "\n"),)))
    return rules


def all_but(characters: str) -> Chars:
    """Build a set of every character but these."""
    return Chars(tuple((each, each) for each in characters), negated=True)


def word(letter: str, number: Expression) -> Expression:
    """Build a word: a letter, its number, and the space behind it."""
    return seq(char(letter), Ref("gap"), number, Ref("space"))


def offsets() -> Expression:
    """Build the centre of an arc: one or two of I J K."""
    return choice(
        seq(Ref("offset-i"), opt(choice(Ref("offset-j"), Ref("offset-k")))),
        seq(Ref("offset-j"), opt(Ref("offset-k"))),
        Ref("offset-k"),
    )


def whole(numbers: Iterable[int]) -> Expression:
    """Build a choice of whole numbers, with at most two leading zeros."""
    return seq(Repeat(char("0"), 0, 2), one_of(numbers))


def one_of(numbers: Iterable[int]) -> Expression:
    """Build a choice of numbers, longer ones first: some readers take the first alternative that fits."""
    return choice(
        *(text(digits) for digits in sorted(map(str, numbers), key=lambda each: (-len(each), each)))
    )
