"""What a parsed line is made of: groups, commands, and the settings inside them."""

from __future__ import annotations

import msgspec

from mcserver.gcode.text.command_table import CommandSpec
from mcserver.gcode.text.words import Word


class Setting(msgspec.Struct, frozen=True):
    """A modal code where it stands; ``argument`` is the P of G64."""

    spec: CommandSpec
    index: int
    argument: Word | None = None


Item = Word | Setting


class Command(msgspec.Struct, frozen=True):
    """A code and what follows it.

    Attributes:
        spec: the code; None for words that no code leads: settings, F or T alone, or axis words that
            repeat the last of G00-G03 (D-03).
        items: words and settings in reading order.
        moves: axis words stand in it.
        first, last: tokens that it spans.
    """

    spec: CommandSpec | None
    items: tuple[Item, ...]
    moves: bool
    first: int
    last: int

    def word(self, letter: str) -> Word | None:
        """The word of that letter, or None."""
        for item in self.items:
            if isinstance(item, Word) and item.letter == letter:
                return item
        return None


Group = tuple[Command, ...]
