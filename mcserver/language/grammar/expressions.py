"""Grammar expressions: the little that every notation can say. No rule may refer to itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec


class Chars(msgspec.Struct, frozen=True):
    """One character of a set.

    Attributes:
        ranges: first and last character of each range.
        negated: True for every character outside of them.
    """

    ranges: tuple[tuple[str, str], ...]
    negated: bool = False

    def holds(self, character: str) -> bool:
        """Return True if the set has the character."""
        return any(first <= character <= last for first, last in self.ranges) != self.negated


class Ref(msgspec.Struct, frozen=True):
    """The rule of that name."""

    name: str


class Seq(msgspec.Struct, frozen=True):
    """One part after the other; without parts: the empty text."""

    parts: tuple[Expression, ...]


class Choice(msgspec.Struct, frozen=True):
    """One of the parts."""

    parts: tuple[Expression, ...]


class Repeat(msgspec.Struct, frozen=True):
    """A part ``least`` to ``most`` times; ``most`` None: any number of times."""

    part: Expression
    least: int = 0
    most: int | None = None


class SomeOf(msgspec.Struct, frozen=True):
    """One rule or more, each at most once, in their order; each notation spells it out in its own fashion."""

    parts: tuple[Ref, ...]


Expression = Chars | Ref | Seq | Choice | Repeat | SomeOf


class Grammar(msgspec.Struct, frozen=True):
    """Rules by name, the start rule first.

    Attributes:
        title: one line that says what the grammar is of.
        rules: in the order in which they are shown.
        tokens: rules that are words of the dialect or less: a lexer may take each as one token.
    """

    title: str
    rules: Mapping[str, Expression]
    tokens: frozenset[str]

    @property
    def start(self) -> str:
        """Return the name of the start rule."""
        return next(iter(self.rules))


def seq(*parts: Expression) -> Expression:
    """Build a sequence; one part stands for itself."""
    return parts[0] if len(parts) == 1 else Seq(parts)


def choice(*parts: Expression) -> Expression:
    """Build a choice; one part stands for itself.

    Raises:
        ValueError: there is nothing to choose from.
    """
    if not parts:
        raise ValueError("a choice needs a part")
    return parts[0] if len(parts) == 1 else Choice(parts)


def opt(*parts: Expression) -> Expression:
    """Build a sequence that may be left out."""
    return Repeat(seq(*parts), 0, 1)


def many(*parts: Expression) -> Expression:
    """Build a sequence that may stand any number of times."""
    return Repeat(seq(*parts))


def halves(parts: Sequence[Ref]) -> Expression:
    """Spell `SomeOf` out by halves: some of the first and perhaps of the second, or some of the second.

    Without recursion and without references of its own the text grows with n·log n.
    """
    if len(parts) == 1:
        return parts[0]
    middle = len(parts) // 2
    first, second = parts[:middle], parts[middle:]
    return choice(seq(halves(first), *(opt(part) for part in second)), halves(second))


def text(literal: str) -> Expression:
    """Build a literal in which letters may have either case."""
    return seq(*(char(character) for character in literal))


def char(character: str) -> Chars:
    """Build a set of one character, a letter in either case."""
    cases = dict.fromkeys((character.upper(), character.lower()))
    return Chars(tuple((each, each) for each in cases))
