"""Convert words that give diameters to radii: X under G7, and those of a thread in G76 (D-137)."""

from __future__ import annotations

from typing import TypeVar

import msgspec

from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.gcode.text.words import Word

_W = TypeVar("_W", Word, ProfileWord)


def counts_diameters(parsed: ParsedLine, before: bool) -> bool:
    """Return whether X is a diameter in a line; its own G7 or G8 counts."""
    actions = () if parsed.profile is None else parsed.profile.actions
    codes = [each.code for each in actions if each.code in ("G7", "G8")]
    return codes[-1] == "G7" if codes else before


def in_radii(parsed: ParsedLine) -> ParsedLine:
    """Return a line with radii for its diameters and its text unchanged; words of arcs are radii already."""
    profile = parsed.profile
    if profile is not None:
        actions = tuple(_halved_action(action) for action in profile.actions)
        profile = msgspec.structs.replace(profile, actions=actions)
    groups = tuple(
        tuple(
            msgspec.structs.replace(
                command,
                items=tuple(_halved(each) if isinstance(each, Word) else each for each in command.items),
            )
            for command in group
        )
        for group in parsed.groups
    )
    return parsed.with_words(groups, profile)


def refuse_beside_diameters(block: BlockState, polar: bool) -> None:
    """Refuse codes that no controller defines together with G7 (MC185)."""
    frame = block.frame
    if not (polar or frame.tip_tool is not None or block.modal.transformation is not None):
        return
    block.faults.add(
        "MC185",
        "X as a diameter (G7) does not go together with turned, scaled or polar coordinates, and G43.4",
        (1, len(block.parsed.text) + 1),
        "write G8 and radii there",
    )


def _halved(word: _W) -> _W:
    return msgspec.structs.replace(word, value=0.5 * word.value) if word.letter == "X" else word


def _halved_action(action: Action) -> Action:
    words = action.words
    if action.code == "G76":
        words = {
            letter: msgspec.structs.replace(word, value=0.5 * word.value) if letter in "IJK" else word
            for letter, word in words.items()
        }
    return msgspec.structs.replace(action, words=words, axes=tuple(_halved(word) for word in action.axes))
