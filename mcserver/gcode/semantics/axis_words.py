"""Read the words of one command and resolve its axis words without a tool."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from mcserver.gcode.profiles.codes import LARGEST_FEED_PER_TURN
from mcserver.gcode.semantics.arc_plane import PLANES
from mcserver.gcode.semantics.block_state import ASSUMED_FEED, ASSUMED_TOOL, BlockState
from mcserver.gcode.semantics.modal import SMALLEST_FEED, apply_setting, read_feed, smallest_feed
from mcserver.gcode.semantics.program_places import WordValue, ends_of
from mcserver.gcode.semantics.program_units import length_scale
from mcserver.gcode.text.syntax import Command, Setting
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, Word
from mcserver.machine.axis import Axis
from mcserver.units import MM


class ModalWord(msgspec.Struct, frozen=True, gc=False):
    """A word with the units and distance mode in force at its place."""

    word: Word
    inch: bool
    incremental: bool


class Words(msgspec.Struct, frozen=True):
    """Words of a motion command: axis words in reading order, I J K by 0 1 2, R and P."""

    axes: tuple[ModalWord, ...]
    offsets: Mapping[int, ModalWord]
    radius: ModalWord | None
    turns: Word | None

    @property
    def any(self) -> bool:
        """Return whether the command has a motion, and does not just set a motion code."""
        return bool(self.axes or self.offsets or self.radius or self.turns)


class Target(msgspec.Struct, frozen=True):
    """An axis and its commanded end [m or rad]."""

    axis: Axis
    end: float
    word: Word


def read_words(block: BlockState, command: Command) -> Words:
    """Apply the command's settings, F and T from left to right, and collect the other words (D-01a)."""
    axes: list[ModalWord] = []
    offsets: dict[int, ModalWord] = {}
    radius: ModalWord | None = None
    turns: Word | None = None
    for item in command.items:
        if isinstance(item, Setting):
            _apply_setting_item(block, item)
            continue
        letter = item.letter
        if item.axis >= 0 or letter == "[":
            incremental = (
                block.modal.incremental or letter in INCREMENTAL_LETTERS or item.axis in block.modal.relative
            )
            axes.append(ModalWord(item, block.modal.inch, incremental))
        elif letter in "IJK":
            offsets["IJK".index(letter)] = ModalWord(item, block.modal.inch, not block.modal.absolute_centres)
        elif letter == "R":
            radius = ModalWord(item, block.modal.inch, False)
        elif letter == "P":
            turns = item
        elif letter == "F":
            _apply_feed_word(block, item)
        elif letter == "T":
            _apply_tool_word(block, item)
    return Words(tuple(axes), offsets, radius, turns)


def _apply_setting_item(block: BlockState, setting: Setting) -> None:
    """Apply a modal code; the P of G64 must not be negative."""
    argument = setting.argument
    tolerance: float | None = None
    plane, turned = setting.spec.number, block.modal.transformation
    if turned is not None and turned.needs_plane and plane in PLANES and PLANES[plane] != turned.needs_plane:
        block.faults.add(
            "MC185",
            f"another plane does not go together with {turned.names}",
            block.parsed.span(setting.index),
            f"end that by {turned.enders} first",
        )
    if argument is not None and argument.value == argument.value:
        tolerance = argument.value
        if tolerance < 0.0:
            block.faults.add(
                "MC116",
                f"a path tolerance of {argument.shown[1:]} is negative",
                block.span(argument),
                "P0 keeps the exact path; G64 alone takes the machine file's tolerance",
            )
            tolerance = None
        elif tolerance * length_scale(block.modal.inch) < block.setup.machine.shaping_deviation:
            most = block.setup.machine.shaping_deviation / MM
            block.faults.add(
                "MC116",
                f"a path tolerance of {argument.shown[1:]} cannot be kept: the shapers of this machine leave "
                f"a path by up to {most:.3f} mm",
                block.span(argument),
                f"give {most:.3f} mm or more, or G61, which stops exactly on every corner",
            )
            tolerance = None
    block.modal = apply_setting(setting.spec.number, block.modal, tolerance)


def _apply_feed_word(block: BlockState, word: Word) -> None:
    """Set F from its place on; F <= 0 is a fault (D-11)."""
    least = smallest_feed(block.modal)
    if block.modal.per_turn and word.value * length_scale(block.modal.inch) > LARGEST_FEED_PER_TURN * MM:
        unit = "in" if block.modal.inch else "mm"
        block.faults.add(
            "MC123",
            f"{word.shown} under G95 is {word.shown[1:]} {unit} for each turn of the spindle",
            block.span(word),
            "write G94 before a feed per minute",
        )
    elif word.value >= least:
        block.change(feed=read_feed(word.value, block.modal))
        return
    elif SMALLEST_FEED <= word.value < least:
        block.faults.add(
            "MC123",
            f"{word.shown} under G99 is a feed per revolution, as programs for a lathe have it; "
            f"here it would be {'in' if block.modal.inch else 'mm'} per minute",
            block.span(word),
            "write G95, or F per minute; without a canned cycle G99 has no meaning on a mill",
        )
    elif word.value == word.value:
        message = f"{word.shown} is not above zero"
        if word.value > 0.0:
            message = f"{word.shown} is below {SMALLEST_FEED:.6f}, the slowest feed rate"
        block.faults.add("MC120", message, block.span(word), "give a feed rate above zero")
    block.change(feed=ASSUMED_FEED)


def _apply_tool_word(block: BlockState, word: Word) -> None:
    """Select the tool of T until G1050 or another T (D-50)."""
    setup = block.setup
    if word.value != word.value:
        block.change(tool=ASSUMED_TOOL)
        return
    if setup.kinematics is None and setup.machine.tools:
        known = ", ".join(f"T{tool.number}" for tool in setup.machine.tools)
        block.faults.add(
            "MC313",
            f"{word.shown} needs inverse kinematics, which is not installed",
            block.span(word),
            f"pip install pin scipy; the machine's tools are {known}",
        )
        block.change(tool=ASSUMED_TOOL)
        return
    number = int(word.value)
    if number != word.value or number not in setup.chains:
        known = ", ".join(f"T{tool}" for tool in sorted(setup.chains))
        block.faults.add(
            "MC310",
            f"{word.shown} is not a tool of the machine {setup.machine.name}",
            block.span(word),
            f"its tools are {known}" if known else "it has none; add [[tool]] sections to the machine file",
        )
        number = ASSUMED_TOOL
    block.change(tool=number)
    if number != ASSUMED_TOOL:
        block.change(carried=(*(each for each in block.modal.carried if each != number), number))


def resolve_targets(block: BlockState, words: tuple[ModalWord, ...]) -> list[Target]:
    """Compute the ends of directly named axes; after a faulty word, the axis's position becomes a guess."""
    given: dict[int, WordValue] = {}
    named: dict[int, Word] = {}
    for entry in words:
        word = entry.word
        if word.axis < 0 or block.usable_axis(word.axis, word, along=True) is None:
            continue
        if word.value != word.value or (entry.incremental and word.axis in block.commanded.guessed):
            block.commanded.mark_guessed(word.axis)
            continue
        given[word.axis] = WordValue(word.value, entry.inch, entry.incremental)
        named[word.axis] = word
    if block.modal.transformation is not None:
        given = _whole(block, words, given)
    if not given:
        return []
    first = named[next(iter(given))]
    found = ends_of(block, given, first)
    if found is None:
        for axis in block.transformation.coupled(frozenset(given)):
            block.commanded.mark_guessed(axis)
        return []
    # an axis moved by a rotation alone is reported at the word that causes it
    return [
        Target(block.setup.axes[axis], end, named.get(axis, first))
        for axis, end in found.items()
        if axis in named or block.usable_axis(axis, first, along=True) is not None
    ]


def _whole(
    block: BlockState, words: tuple[ModalWord, ...], given: dict[int, WordValue]
) -> dict[int, WordValue]:
    """Drop words of coupled axes if the position of one is unknown; their positions become guesses."""
    lost = {entry.word.axis for entry in words if entry.word.axis >= 0} - given.keys()
    known = dict(given)
    for axis in given:
        together = block.transformation.coupled(frozenset((axis,)))
        absolute = {other for other in together & given.keys() if not given[other].incremental}
        if (together & lost) or block.commanded.guessed & (together - absolute):
            for other in together:
                block.commanded.mark_guessed(other)
            del known[axis]
    return known
