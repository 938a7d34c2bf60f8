"""Interpret one parsed line: walk its groups and commands in reading order over a copy of the state."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from mcserver.gcode.line_faults import FaultList
from mcserver.gcode.profiles.actions import Effects, act_after, act_at_end, act_before
from mcserver.gcode.profiles.diameters import refuse_beside_diameters
from mcserver.gcode.profiles.drilling import drill, repeat_action
from mcserver.gcode.profiles.nurbs import read_control_line
from mcserver.gcode.profiles.surface_speed import follow_zero, part_by_turns
from mcserver.gcode.profiles.transforming import read_polar_line, refuse_beside
from mcserver.gcode.semantics.arcs import command_number
from mcserver.gcode.semantics.axis_words import Words, read_words
from mcserver.gcode.semantics.block_state import ASSUMED_TOOL, BlockState
from mcserver.gcode.semantics.feed_time import FeedMove, feed_group
from mcserver.gcode.semantics.modal import Feed, initial_modal
from mcserver.gcode.semantics.moves import arc, line, rapid, transmit_speed, transmit_torque
from mcserver.gcode.semantics.path_checks import check_holding, check_window
from mcserver.gcode.semantics.tilted_planes import check_plane
from mcserver.gcode.semantics.tip_moves import refuse_beside_tip, tip_feed_move, tip_rapid
from mcserver.gcode.semantics.tool_moves import tool_feed_move, tool_rapid
from mcserver.gcode.text.command_table import Kind
from mcserver.gcode.text.profile_words import Action, ProfileWord, ProfileWords
from mcserver.gcode.text.syntax import Command, Group, Setting
from mcserver.gcode.text.words import MAX_AXIS, Word
from mcserver.motion import canonical
from mcserver.motion.canonical import (
    AxisLine,
    AxisOperation,
    Canonical,
    DwellGroup,
    EndLine,
    FeedGroup,
    MotionLine,
    PauseLine,
    RapidGroup,
)
from mcserver.motion.geometry.curves import Curve, LineCurve


class BlockInterpreter:
    """Builds the canonical values of a line, in the order in which they act."""

    def __init__(self, block: BlockState) -> None:
        self.block = block
        self.before: list[Canonical] = []
        self.groups: list[canonical.Group] = []
        self.after: list[Canonical] = []
        self.ended = False
        self._feed_commands = 0  # of the group, refused ones included

    def read(self) -> None:
        """Interpret the line; what follows M02 or M30 is not read (D-05)."""
        profile = self.block.parsed.profile
        before = self.block.modal.frame
        if self.block.modal.control_points is not None:
            self.after += read_control_line(self.block)
        elif profile is not None:
            self._read_profile(profile)
        else:
            self._read_groups()
        if self.block.modal.frame is not None and self.block.modal.frame.plane is not None:
            check_plane(self.block, before, self.before + self.after, self.groups)
        if self.ended:
            self.after += act_at_end(self.block)
            self.block.modal = initial_modal(self.block.setup.machine)

    def _read_profile(self, profile: ProfileWords) -> None:
        """Interpret a line that holds codes of a profile, in RS-274's order of execution (D-61)."""
        block = self.block
        effects = Effects()
        if block.modal.transformation is not None:
            refuse_beside(block, profile)
        act_before(block, profile.actions, effects)
        if block.frame.tip_tool is not None:
            refuse_beside_tip(block, profile)
        self.groups += effects.groups
        if any(isinstance(each, EndLine) for each in effects.before):
            self.ended = True
            self.before = effects.before
            return
        before = block.modal.transformation
        if profile.polar:
            read_polar_line(block)
        if profile.machine_frame:
            self._read_in_machine_frame()
        else:
            self._read_groups()
        act_after(block, profile.actions, effects)
        if profile.polar:
            block.change(transformation=before)
        if block.modal.diameter:
            refuse_beside_diameters(block, profile.polar)
        # M0 and M30 come last, also where all that moves is a cycle or G28
        effects.after += follow_zero(block)
        self.before, self.after = effects.before, [*effects.after, *self.before, *self.after]

    def _read_in_machine_frame(self) -> None:
        """Interpret a line with G53; what it says of G90 holds behind it."""
        block = self.block
        shift, incremental = block.modal.shift, block.modal.incremental
        items = [item for group in block.parsed.groups for command in group for item in command.items]
        modes = {item.spec.number for item in items if isinstance(item, Setting)} & {90, 91}
        if 91 in modes:
            block.faults.add(
                "MC153",
                "G53 gives positions of the machine, G91 in its line increments",
                (1, len(block.parsed.text) + 1),
                "write G91 behind it, in a line of its own",
            )
        before = block.transformation
        block.change(shift=None, incremental=False, transformation=None)
        self._read_groups()
        block.change(shift=shift, incremental=incremental and not modes)
        block.transformation = before.without(axis for axis in block.moved)

    def _read_groups(self) -> None:
        for group in self.block.parsed.groups:
            self._group(group)
            if self.ended:
                break

    @property
    def values(self) -> list[Canonical]:
        """Return the line's one MotionLine, with AxisLine, PauseLine and EndLine before or behind it."""
        if not self.groups:
            return self.before + self.after
        block = self.block
        motion = MotionLine(
            line=block.parsed.number,
            groups=tuple(self.groups),
            exact_stop=block.exact_stop,
            tolerance=block.tolerance,
            feed_length=block.feed_length,
        )
        return [*self.before, *part_by_turns(block, motion), *self.after]

    def _group(self, group: Group) -> None:
        feed_moves: list[FeedMove] = []
        self._feed_commands = 0
        start = self.block.commanded.path_starts()
        position = len(self.groups)
        for command in group:
            self._command(command, feed_moves)
            if self.ended:
                break
        # if a command of the group was refused, the others do not determine its duration
        if feed_moves and len(feed_moves) == self._feed_commands:
            found = feed_group(self.block, feed_moves)
            if found is not None:
                self._check_path(feed_moves[0].command, found.curves, start)
                self.groups.insert(position, found)

    def _command(self, command: Command, feed_moves: list[FeedMove]) -> None:
        spec = command.spec
        kind = None if spec is None else spec.kind
        if spec is None and not command.moves:
            read_words(self.block, command)
        elif spec is None or kind is Kind.MOVE:
            self._move(command, feed_moves)
        elif kind is Kind.DIRECT:
            self._direct(command, spec.number)
        elif kind is Kind.DWELL:
            self._dwell(command)
        elif kind is Kind.AXIS:
            assert spec.operation is not None
            self._axis_command(command, spec.operation)
        elif kind is Kind.PROGRAM and (spec.number != 1 or self.block.setup.switches.optional_stop):
            number = self.block.parsed.number
            self.ended = spec.number in (2, 30)
            self._add(EndLine(number) if self.ended else PauseLine(number))

    def _add(self, value: Canonical) -> None:
        (self.after if self.groups or self._moving else self.before).append(value)

    @property
    def _moving(self) -> bool:
        return bool(self.block.moved or self.after)

    def _check_path(
        self, command: Command | Action, curves: Sequence[Curve], start: Mapping[int, float]
    ) -> None:
        check_holding(self.block, command, curves, start)
        check_window(self.block, command, curves, start)

    def _move(self, command: Command, feed_moves: list[FeedMove]) -> None:
        block = self.block
        words = read_words(block, command)
        if command.spec is None and block.drilling:
            given = [item for item in command.items if isinstance(item, Word) and item.letter not in "FT"]
            again = repeat_action(
                [
                    ProfileWord(word.letter, word.value, word.text, word.axis, block.span(word))
                    for word in given
                ]
            )
            self.after += drill(block, again)
            return
        if command.spec is None and not self._repeats(words):
            return
        number = command_number(block, command)
        if block.modal.motion != number:
            block.change(motion=number)
        if not words.any:
            return
        if number < 2:
            self._refuse_arc_words(command, number)
        self._exact_stop(always=number == 0)
        self._feed_commands += number != 0
        tool = block.modal.tool
        if tool == ASSUMED_TOOL:
            return
        by_tip = block.frame.tip_tool is not None
        if number == 0:
            start = block.commanded.path_starts()
            if by_tip:
                group = tip_rapid(block, command, words)
            elif tool is not None:
                group = tool_rapid(block, command, words)
            else:
                group = rapid(block, command, words, wait=True)
            if group is not None:
                self._check_path(command, _curves_of(group, start), start)
                self.groups.append(group)
            return
        if by_tip:
            move = tip_feed_move(block, command, words, number)
        elif tool is not None:
            move = tool_feed_move(block, command, words, number)
        elif number == 1:
            move = line(block, command, words)
        else:
            move = arc(block, command, words)
        if move is not None:
            pace, feed = block.modal.pace, move.feed
            if pace != 1.0 and feed is not None:
                move = msgspec.structs.replace(move, feed=Feed(feed.number * pace, feed.speed * pace))
            feed_moves.append(move)

    def _repeats(self, words: Words) -> bool:
        """Return True if a motion code is in force to repeat (D-03); report that there is none."""
        block = self.block
        motion = block.modal.motion
        if motion is None:
            given = sorted(
                (entry.word for entry in (*words.axes, *words.offsets.values())), key=lambda word: word.index
            )
            first, last = given[0], given[-1]
            block.faults.add(
                "MC113",
                f"{first.shown} has no motion code, and no G00-G03 came before to be repeated",
                block.parsed.span(first.index, last.index),
                "write the code, such as G01",
            )
            block.change(motion=0)
        return motion is not None

    def _refuse_arc_words(self, command: Command, number: int) -> None:
        """Report what G00 and G01 do not take; I J K are the tool's direction under G43.5."""
        block = self.block
        by_direction = block.frame.tip_tool is not None and block.frame.by_direction
        shown = f"G0{number}" + (", which this line repeats," if command.spec is None else "")
        for word in command.items:
            if not isinstance(word, Word) or word.letter not in ("RP" if by_direction else "IJKRP"):
                continue
            hint = "write G02 or G03 if an arc is meant"
            block.faults.add("MC112", f"{shown} does not take {word.name}", block.span(word), hint)

    def _exact_stop(self, *, always: bool) -> None:
        """Set the line's exact stop and path tolerance; the first motion command uses up G09 (D-15)."""
        block = self.block
        modal = block.modal
        block.exact_stop = block.exact_stop or always or modal.exact_stop or modal.exact_next
        block.tolerance = block.path_tolerance
        if modal.exact_next:
            block.change(exact_next=False)

    def _direct(self, command: Command, number: int) -> None:
        block = self.block
        words = read_words(block, command)
        name = f"G{number}"
        if not words.axes:
            block.faults.add(
                "MC118",
                f"{name} names no axis",
                block.span(command),
                "add axis words, such as X100",
            )
            return
        if number == 1020 and block.modal.exact_next:
            block.change(exact_next=False)
        if block.modal.tool is not None:
            if block.modal.tool != ASSUMED_TOOL:
                block.faults.add(
                    "MC312",
                    f"{name} moves axes, but T{block.modal.tool} is in force and takes their words",
                    block.span(command),
                    "write G1050 before it, or move the tool by G00",
                    tool=block.modal.tool,
                )
            return
        if block.frame.tip_tool is not None:
            block.faults.add(
                "MC172",
                f"{name} does not go together with {block.frame.tip_code}",
                block.span(command),
                "write it behind G49",
            )
            return
        group: canonical.Group | None
        if number == 1020:
            start = block.commanded.path_starts()
            group = rapid(block, command, words, wait=False)
            if group is not None:
                check_window(block, command, _curves_of(group, start), start)
        elif number == 1030:
            group = transmit_speed(block, command, words)
        else:
            group = transmit_torque(block, command, words)
        if group is not None:
            self.groups.append(group)

    def _dwell(self, command: Command) -> None:
        block = self.block
        word = command.word("P")
        if word is None:
            block.faults.add(
                "MC118",
                "G04 has no P: it does not say how long",
                block.span(command),
                "give seconds, such as G04 P2.5",
            )
        elif word.value < 0.0:
            block.faults.add(
                "MC116", f"a dwell of {word.shown[1:]} s is negative", block.span(word), "give 0 s or more"
            )
        elif word.value == word.value:
            self.groups.append(DwellGroup(word.value))

    def _axis_command(self, command: Command, operation: AxisOperation) -> None:
        block = self.block
        word = command.word("P")
        coupled = dict(block.modal.coupled)
        if word is None and operation is AxisOperation.COUPLE:
            axes = self._joints_to_couple(command, coupled)
            if not axes:
                return
        elif word is None:
            axes = tuple(sorted(block.setup.leased))
            if operation is AxisOperation.UNCOUPLE:
                axes = tuple(sorted(coupled))
            elif operation is AxisOperation.CAPTURE:
                axes = tuple(axis for axis in axes if axis not in coupled)
        else:
            if word.value != word.value:
                return
            index = int(word.value)
            if index != word.value or not 0 <= index <= MAX_AXIS:
                block.faults.add(
                    "MC108",
                    f"{word.shown} does not name an axis: the number is whole and from 0 to {MAX_AXIS}",
                    block.span(word),
                    axis=None,
                )
                return
            axis = block.usable_axis(index, word, coupled=operation is not AxisOperation.CAPTURE)
            if axis is None:
                return
            if operation is AxisOperation.COUPLE and (axis.follow is None or index in coupled):
                what = "follows already" if index in coupled else "has no [axis.follow] in the machine file"
                hint = "G1061 ends it" if index in coupled else "say there what it follows, and how"
                block.faults.add("MC346", f"axis {index} {what}", block.span(word), hint, axis=index)
                return
            axes = (index,)
        together = set(axes)
        if operation is AxisOperation.COUPLE:
            coupled.update(dict.fromkeys(axes, block.parsed.number))
        elif operation is not AxisOperation.CAPTURE:
            for tool in block.setup.machine.tools:
                # a tool is let go with all its joints
                if tool.follow is not None and not together.isdisjoint(coupled.keys() & set(tool.axes)):
                    together.update(tool.axes)
            coupled = {axis: line for axis, line in coupled.items() if axis not in together}
        block.change(coupled=tuple(coupled.items()))
        if not axes:
            return
        block.commanded.invalidate(together)
        if operation is AxisOperation.UNCOUPLE:
            axes = tuple(sorted(together))
        self._add(AxisLine(block.parsed.number, operation, axes))

    def _joints_to_couple(self, command: Command, coupled: Mapping[int, int]) -> tuple[int, ...]:
        """Return the axes of the tool in force, which G1060 without P names; none after a fault."""
        block = self.block
        number = block.modal.tool
        tool = next((each for each in block.setup.machine.tools if each.number == number), None)
        if tool is None:
            if number != ASSUMED_TOOL:
                block.faults.add(
                    "MC118",
                    "G1060 has no P, and no tool is in force: it does not say what follows",
                    block.span(command),
                    "name the axis, such as G1060 P3, or choose the tool before it",
                )
            return ()
        following = not coupled.keys().isdisjoint(tool.axes)
        if following or tool.follow is None:
            what = "follows already" if following else "has no [tool.follow] in the machine file"
            hint = "G1061 ends it" if following else "say there what it follows, and how"
            block.faults.add("MC346", f"T{number} {what}", block.span(command), hint, tool=number)
            return ()
        usable = [block.usable_axis(axis, command) is not None for axis in tool.axes]
        return tool.axes if all(usable) else ()


def _curves_of(group: RapidGroup | FeedGroup, start: Mapping[int, float]) -> Sequence[Curve]:
    """Return the curves of G00, of axes that go by themselves the line; ``start``: positions before it."""
    if isinstance(group, FeedGroup):
        return group.curves
    begin = tuple(start[axis] for axis in group.axes)
    return [LineCurve(group.axes, begin, group.targets)]


def faults_of(block: BlockState) -> FaultList:
    """Collect all faults of a line, those of its text first."""
    faults = FaultList(block.parsed.number, block.parsed.origin)
    faults.found = [*block.parsed.faults, *block.faults.found]
    return faults
