"""The syntax tree of a line: groups of commands of words and settings."""

from __future__ import annotations

import msgspec

from mcserver.gcode.text.command_table import CommandSpec
from mcserver.gcode.text.words import Word


class Setting(msgspec.Struct, frozen=True):
    """A modal code among the words; ``argument`` is the P of G64."""

    spec: CommandSpec
    index: int
    argument: Word | None = None


Item = Word | Setting


class Command(msgspec.Struct, frozen=True):
    """A code and the words that follow it.

    Attributes:
        spec: the code; None for words without a code: settings, F or T alone, or axis words that repeat
            the last of G00-G03 (D-03).
        items: words and settings in reading order.
        moves: it has axis words, or others that repeat a motion code.
        first, last: its tokens.
    """

    spec: CommandSpec | None
    items: tuple[Item, ...]
    moves: bool
    first: int
    last: int

    def word(self, letter: str) -> Word | None:
        """Return the word of a letter, or None."""
        for item in self.items:
            if isinstance(item, Word) and item.letter == letter:
                return item
        return None


Group = tuple[Command, ...]
