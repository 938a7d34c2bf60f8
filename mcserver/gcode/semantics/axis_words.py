"""Axis words of one command, and what they mean without a tool."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from mcserver.gcode.semantics.block_state import ASSUMED_FEED, ASSUMED_TOOL, Draft
from mcserver.gcode.semantics.modal import apply_setting, read_feed
from mcserver.gcode.semantics.program_units import axis_scale
from mcserver.gcode.text.syntax import Command, Setting
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, Word
from mcserver.machine.machine_file import Axis

SMALLEST_FEED = 1e-6


class Placed(msgspec.Struct, frozen=True, gc=False):
    """A word with the units and the mode in force where it stands."""

    word: Word
    inch: bool
    incremental: bool


class Words(msgspec.Struct, frozen=True):
    """Words of a motion command: axis words in reading order, I J K by 0 1 2, R and P."""

    axes: tuple[Placed, ...]
    offsets: Mapping[int, Placed]
    radius: Placed | None
    turns: Word | None

    @property
    def any(self) -> bool:
        """Whether the command asks for a motion, rather than choosing a motion code only."""
        return bool(self.axes or self.offsets or self.radius or self.turns)


class Target(msgspec.Struct, frozen=True):
    """An axis and its commanded end [m or rad]."""

    axis: Axis
    end: float
    word: Word


def read_words(draft: Draft, command: Command) -> Words:
    """Acts on the command's settings, F and T from left to right and gathers the other words (D-01a)."""
    axes: list[Placed] = []
    offsets: dict[int, Placed] = {}
    radius: Placed | None = None
    turns: Word | None = None
    for item in command.items:
        if isinstance(item, Setting):
            act_on_setting(draft, item)
            continue
        letter = item.letter
        if item.axis >= 0 or letter == "[":
            incremental = draft.modal.incremental or letter in INCREMENTAL_LETTERS
            axes.append(Placed(item, draft.modal.inch, incremental))
        elif letter in "IJK":
            offsets["IJK".index(letter)] = Placed(item, draft.modal.inch, True)
        elif letter == "R":
            radius = Placed(item, draft.modal.inch, False)
        elif letter == "P":
            turns = item
        elif letter == "F":
            act_on_feed(draft, item)
        elif letter == "T":
            act_on_tool(draft, item)
    return Words(tuple(axes), offsets, radius, turns)


def act_on_setting(draft: Draft, setting: Setting) -> None:
    """A modal code; the P of G64 must not be negative."""
    argument = setting.argument
    tolerance: float | None = None
    if argument is not None and argument.value == argument.value:
        tolerance = argument.value
        if tolerance < 0.0:
            draft.faults.add(
                "MC116",
                f"a path tolerance of {argument.shown[1:]} is negative",
                draft.span(argument),
                "P0 keeps the exact path; G64 alone takes the machine file's tolerance",
            )
            tolerance = None
    draft.modal = apply_setting(setting.spec.number, draft.modal, tolerance)


def act_on_feed(draft: Draft, word: Word) -> None:
    """F, modal from where it stands; F <= 0 is a fault (D-11)."""
    if word.value >= SMALLEST_FEED:
        draft.change(feed=read_feed(word.value, draft.modal))
        return
    if word.value == word.value:
        message = f"{word.shown} is not above zero"
        if word.value > 0.0:
            message = f"{word.shown} is below {SMALLEST_FEED:.6f}, the slowest feed rate"
        draft.faults.add("MC120", message, draft.span(word), "give a feed rate above zero")
    draft.change(feed=ASSUMED_FEED)


def act_on_tool(draft: Draft, word: Word) -> None:
    """T, modal until G1050 or another T (D-50)."""
    setup = draft.setup
    if word.value != word.value:
        draft.change(tool=ASSUMED_TOOL)
        return
    if setup.kinematics is None and setup.machine.tools:
        known = ", ".join(f"T{tool.number}" for tool in setup.machine.tools)
        draft.faults.add(
            "MC313",
            f"{word.shown} needs inverse kinematics, which is not installed",
            draft.span(word),
            f"install the extra 'mcserver[kinematics]'; the machine's tools are {known}",
        )
        draft.change(tool=ASSUMED_TOOL)
        return
    number = int(word.value)
    if number != word.value or number not in setup.chains:
        known = ", ".join(f"T{tool}" for tool in sorted(setup.chains))
        draft.faults.add(
            "MC310",
            f"{word.shown} is not a tool of the machine {setup.machine.name}",
            draft.span(word),
            f"its tools are {known}" if known else "it has none; add [[tool]] sections to the machine file",
        )
        number = ASSUMED_TOOL
    draft.change(tool=number)


def resolve_targets(draft: Draft, words: tuple[Placed, ...]) -> list[Target]:
    """Ends of directly named axes; a faulty word gives none and leaves the axis's position a guess."""
    targets: list[Target] = []
    for placed in words:
        word = placed.word
        if word.axis < 0:
            continue
        axis = draft.usable_axis(word.axis, word)
        if axis is None:
            continue
        if word.value != word.value or (placed.incremental and word.axis in draft.commanded.assumed):
            draft.commanded.assume(word.axis)
            continue
        end = word.value * axis_scale(axis.type, placed.inch)
        if placed.incremental:
            end += draft.commanded.positions[word.axis]
        targets.append(Target(axis, end, word))
    return targets
