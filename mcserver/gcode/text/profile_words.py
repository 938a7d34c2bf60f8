"""Actions of a profile's line besides the reference's words (D-60)."""

from __future__ import annotations

import msgspec

from mcserver.gcode.line_faults import Span


class ProfileWord(msgspec.Struct, frozen=True, gc=False):
    """One word with its columns; ``axis`` is -1 unless it is an axis word."""

    letter: str
    value: float
    text: str
    axis: int
    span: Span


class Action(msgspec.Struct, frozen=True, gc=False):
    """A code that the reference does not have, with its own words.

    Attributes:
        code: as `mcserver.gcode.profiles.codes` names it; ``S`` and ``T`` for these words.
        words: by letter. axes: its axis words.
    """

    code: str
    span: Span
    words: dict[str, ProfileWord]
    axes: tuple[ProfileWord, ...] = ()


class ProfileWords(msgspec.Struct, frozen=True, gc=False):
    """The codes of a line that the reference's grammar does not read.

    Attributes:
        actions: in RS-274's order of execution. machine_frame: G53. ignored: codes without effect.
        polar: X and Y are radius and angle, written as @ and ^.
        tilting: which of G68.2 and G53.1 stand in the line, whether they are read or not.
    """

    actions: tuple[Action, ...] = ()
    machine_frame: bool = False
    ignored: tuple[str, ...] = ()
    polar: bool = False
    tilting: frozenset[str] = frozenset()
