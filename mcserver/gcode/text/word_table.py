"""The table of words: what each letter means, its unit, and the rules that apply."""

from __future__ import annotations

import msgspec


class WordSpec(msgspec.Struct, frozen=True):
    """Letters with one meaning.

    Attributes:
        letters: upper case; ``[n]`` is an axis by its number.
        title: what the number is.
        unit: of the number; empty for a plain count.
        rules: rules of the dialect (docs/dialect.md), the main one first.
    """

    letters: tuple[str, ...]
    title: str
    unit: str
    rules: tuple[str, ...]


WORDS: tuple[WordSpec, ...] = (
    WordSpec(
        ("X", "Y", "Z"), "axes 0, 1 and 2, or the tool's point", "mm or inches, degrees", ("D-02", "D-50")
    ),
    WordSpec(
        ("A", "B", "C"),
        "axes 3, 4 and 5, or the tool's Euler angles",
        "degrees, mm or inches",
        ("D-02", "D-51"),
    ),
    WordSpec(("U", "V", "W"), "X, Y and Z as increments", "as X Y Z", ("D-02", "D-14")),
    WordSpec(("[n]",), "axis n, 0 to 63", "mm or inches, degrees", ("D-02", "D-52")),
    WordSpec(("I", "J", "K"), "an arc's centre from its start along X, Y and Z", "mm or inches", ("D-22",)),
    WordSpec(("R",), "an arc's radius; negative: the major arc", "mm or inches", ("D-22",)),
    WordSpec(
        ("P",),
        "seconds, turns of an arc, an axis, or the tolerance of G64",
        "by its code",
        ("D-24", "D-22", "D-40", "D-35"),
    ),
    WordSpec(
        ("F",), "feed", "mm, inches or degrees per minute; moves per minute under G93", ("D-11", "D-30")
    ),
    WordSpec(("T",), "the tool in force", "", ("D-50",)),
    WordSpec(("N",), "line number, without effect", "", ("D-01",)),
)


def find_word(letter: str) -> WordSpec | None:
    """Look up a word by its letter (``[n]`` for an axis by number); None if the dialect lacks it."""
    return next((spec for spec in WORDS if letter in spec.letters), None)
