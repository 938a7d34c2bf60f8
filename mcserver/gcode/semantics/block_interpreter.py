"""What one parsed line means: walks its groups and commands in reading order over a draft of the state."""

from __future__ import annotations

from mcserver.gcode.line_faults import FaultList
from mcserver.gcode.semantics.arcs import command_number
from mcserver.gcode.semantics.axis_words import Words, act_on_feed, act_on_setting, act_on_tool, read_words
from mcserver.gcode.semantics.block_state import ASSUMED_TOOL, Draft
from mcserver.gcode.semantics.feed_time import FeedMove, feed_group
from mcserver.gcode.semantics.modal import INITIAL
from mcserver.gcode.semantics.moves import arc, line, rapid, transmit_speed, transmit_torque
from mcserver.gcode.semantics.tool_moves import tool_feed_move, tool_rapid
from mcserver.gcode.text.command_table import Kind
from mcserver.gcode.text.syntax import Command, Group
from mcserver.gcode.text.words import MAX_AXIS, Word
from mcserver.motion import canonical
from mcserver.motion.canonical import (
    AxisLine,
    AxisOperation,
    Canonical,
    DwellGroup,
    EndLine,
    MotionLine,
    PauseLine,
)


class LineMeaning:
    """The canonical values of a line, in the order in which they act."""

    def __init__(self, draft: Draft) -> None:
        self.draft = draft
        self.before: list[Canonical] = []
        self.groups: list[canonical.Group] = []
        self.after: list[Canonical] = []
        self.ended = False
        self._asked = 0  # commands of the group that ask for a coordinated motion

    def read(self) -> None:
        """Walks the line; what follows M02 or M30 is not read (D-05)."""
        for group in self.draft.parsed.groups:
            self._group(group)
            if self.ended:
                break
        if self.ended:
            self.draft.modal = INITIAL

    @property
    def values(self) -> list[Canonical]:
        """AxisLine, PauseLine and EndLine where they stand before or after the line's one MotionLine."""
        if not self.groups:
            return self.before + self.after
        draft = self.draft
        motion = MotionLine(
            line=draft.parsed.number,
            groups=tuple(self.groups),
            exact_stop=draft.exact_stop,
            tolerance=draft.tolerance,
            feed_length=draft.feed_length,
        )
        return [*self.before, motion, *self.after]

    def _group(self, group: Group) -> None:
        feed_moves: list[FeedMove] = []
        self._asked = 0
        place = len(self.groups)
        for command in group:
            self._command(command, feed_moves)
            if self.ended:
                break
        # where a command of the group was refused, the rest says nothing about its time
        if feed_moves and len(feed_moves) == self._asked:
            found = feed_group(self.draft, feed_moves)
            if found is not None:
                self.groups.insert(place, found)

    def _command(self, command: Command, feed_moves: list[FeedMove]) -> None:
        spec = command.spec
        kind = None if spec is None else spec.kind
        if spec is None and not command.moves:
            self._settings(command)
        elif spec is None or kind is Kind.MOVE:
            self._move(command, feed_moves)
        elif kind is Kind.DIRECT:
            self._direct(command, spec.number)
        elif kind is Kind.DWELL:
            self._dwell(command)
        elif kind is Kind.AXIS:
            assert spec.operation is not None
            self._axis_command(command, spec.operation)
        elif kind is Kind.PROGRAM:
            number = self.draft.parsed.number
            self.ended = spec.number in (2, 30)
            self._add(EndLine(number) if self.ended else PauseLine(number))

    def _add(self, value: Canonical) -> None:
        (self.after if self.groups or self._moving else self.before).append(value)

    @property
    def _moving(self) -> bool:
        return bool(self.draft.moved)

    def _settings(self, command: Command) -> None:
        for item in command.items:
            if not isinstance(item, Word):
                act_on_setting(self.draft, item)
            elif item.letter == "F":
                act_on_feed(self.draft, item)
            elif item.letter == "T":
                act_on_tool(self.draft, item)

    def _move(self, command: Command, feed_moves: list[FeedMove]) -> None:
        draft = self.draft
        words = read_words(draft, command)
        if command.spec is None and not self._repeats(command, words):
            return
        number = command_number(draft, command)
        if draft.modal.motion != number:
            draft.change(motion=number)
        if not words.any:
            return
        self._exact_stop(always=number == 0)
        self._asked += number != 0
        tool = draft.modal.tool
        if tool == ASSUMED_TOOL:
            return
        if number == 0:
            group = (
                rapid(draft, command, words, wait=True) if tool is None else tool_rapid(draft, command, words)
            )
            if group is not None:
                self.groups.append(group)
            return
        if tool is not None:
            move = tool_feed_move(draft, command, words, number)
        elif number == 1:
            move = line(draft, command, words)
        else:
            move = arc(draft, command, words)
        if move is not None:
            feed_moves.append(move)

    def _repeats(self, command: Command, words: Words) -> bool:
        """Whether there is a motion code to repeat (D-03) that takes the words."""
        draft = self.draft
        motion = draft.modal.motion
        if motion is None:
            first, last = words.axes[0].word, words.axes[-1].word
            draft.faults.add(
                "MC113",
                f"{first.shown} has no motion code, and no G00-G03 came before to be repeated",
                draft.parsed.span(first.index, last.index),
                "write the code, such as G01",
            )
            draft.change(motion=0)
        elif motion < 2:
            for word in command.items:
                if isinstance(word, Word) and word.letter in "IJKRP" and word.axis < 0:
                    draft.faults.add(
                        "MC112",
                        f"G0{motion}, which this line repeats, does not take {word.name}",
                        draft.span(word),
                        "write G02 or G03 if an arc is meant",
                    )
        return motion is not None

    def _exact_stop(self, *, always: bool) -> None:
        """The line's exact stop and path tolerance; G09 is used up by the first motion command (D-15)."""
        draft = self.draft
        modal = draft.modal
        draft.exact_stop = draft.exact_stop or always or modal.exact_stop or modal.exact_next
        draft.tolerance = draft.setup.machine.path_tolerance if modal.tolerance is None else modal.tolerance
        if modal.exact_next:
            draft.change(exact_next=False)

    def _direct(self, command: Command, number: int) -> None:
        draft = self.draft
        words = read_words(draft, command)
        name = f"G{number}"
        if not words.axes:
            draft.faults.add(
                "MC118",
                f"{name} names no axis",
                draft.span(command),
                "add axis words, such as X100",
            )
            return
        if number == 1020 and draft.modal.exact_next:
            draft.change(exact_next=False)
        if draft.modal.tool is not None:
            if draft.modal.tool != ASSUMED_TOOL:
                draft.faults.add(
                    "MC312",
                    f"{name} moves axes, but T{draft.modal.tool} is in force and takes their words",
                    draft.span(command),
                    "write G1050 before it, or move the tool by G00",
                    tool=draft.modal.tool,
                )
            return
        group: canonical.Group | None
        if number == 1020:
            group = rapid(draft, command, words, wait=False)
        elif number == 1030:
            group = transmit_speed(draft, command, words)
        else:
            group = transmit_torque(draft, command, words)
        if group is not None:
            self.groups.append(group)

    def _dwell(self, command: Command) -> None:
        draft = self.draft
        word = command.word("P")
        if word is None:
            draft.faults.add(
                "MC118",
                "G04 has no P: it does not say how long",
                draft.span(command),
                "give seconds, such as G04 P2.5",
            )
        elif word.value < 0.0:
            draft.faults.add(
                "MC116", f"a dwell of {word.shown[1:]} s is negative", draft.span(word), "give 0 s or more"
            )
        elif word.value == word.value:
            self.groups.append(DwellGroup(word.value))

    def _axis_command(self, command: Command, operation: AxisOperation) -> None:
        draft = self.draft
        word = command.word("P")
        if word is None:
            axes = tuple(sorted(draft.setup.leased))
        else:
            if word.value != word.value:
                return
            index = int(word.value)
            if index != word.value or not 0 <= index <= MAX_AXIS:
                draft.faults.add(
                    "MC108",
                    f"{word.shown} does not name an axis: the number is whole and from 0 to {MAX_AXIS}",
                    draft.span(word),
                    axis=None,
                )
                return
            if draft.usable_axis(index, word) is None:
                return
            axes = (index,)
        draft.commanded.lose(axes)
        self._add(AxisLine(draft.parsed.number, operation, axes))


def faults_of(draft: Draft) -> FaultList:
    """All faults of the draft's line, those of its text first."""
    faults = FaultList(draft.parsed.number)
    faults.found = [*draft.parsed.faults, *draft.faults.found]
    return faults
