"""Assign words to commands (D-01a) and check their combinations (D-01, D-02, D-24, D-31, D-40)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mcserver.errors import Edit
from mcserver.gcode.line_faults import FaultList, Span
from mcserver.gcode.text.command_table import UNKNOWN, CommandSpec, Kind, find_command, nearest_command
from mcserver.gcode.text.syntax import Command, Group, Item, Setting
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, Word

SpanOf = Callable[..., Span]
_LED: Final = frozenset((Kind.MOVE, Kind.DIRECT))
_ACTING: Final = frozenset((Kind.MOVE, Kind.DIRECT, Kind.DWELL))
_FEED_CODES: Final = frozenset((1, 2, 3))
# letters allowed without a code: F and T alone; the rest only with axis words (D-03)
_LOOSE: Final = frozenset("FT")
_OFFSETS: Final = "IJK"
_LOOSE_MOVE: Final = frozenset("FTIJKRP")


class _OpenCommand:
    """A command that is still collecting words."""

    __slots__ = ("first", "items", "last", "moves", "setting", "spec")

    def __init__(self, spec: CommandSpec | None, first: int) -> None:
        self.spec = spec
        self.items: list[Item] = []
        self.moves = False
        self.first = first
        self.last = first
        self.setting = -1  # index of the last setting among the items

    def add(self, item: Item) -> None:
        if isinstance(item, Setting):
            self.setting = len(self.items)
        self.items.append(item)
        self.last = item.index

    def finish(self) -> Command:
        return Command(self.spec, tuple(self.items), self.moves, self.first, self.last)


def group_commands(
    groups: list[list[Word]], faults: FaultList, span: SpanOf, *, offsets_move: bool = False
) -> tuple[Group, ...]:
    """Build the commands of each comma group; report faults of grammar to ``faults``.

    Args:
        groups: words of each group, in reading order.
        span: returns the columns of a token, or from one token to another.
        offsets_move: in the profiles I J K without a code repeat a motion as axis words do, and their meaning
            for G00 and G01 depends on the state (D-61, D-140).
    """
    moving = _OFFSETS if offsets_move else ""
    found = tuple(_group(words, faults, span, moving) for words in groups if words)
    _check_line(found, faults, span)
    return found


def _group(words: list[Word], faults: FaultList, span: SpanOf, moving: str) -> Group:
    opened: list[_OpenCommand] = []
    current: _OpenCommand | None = None
    for word in words:
        if word.letter in "GM":
            spec = _lookup(word, faults, span)
            if spec.kind is Kind.SETTING:
                if current is None or not _absorbs_setting(current):
                    current = _OpenCommand(None, word.index)
                    opened.append(current)
                current.add(Setting(spec, word.index))
            else:
                current = _OpenCommand(spec, word.index)
                opened.append(current)
            continue
        if current is None:
            current = _OpenCommand(None, word.index)
            opened.append(current)
        if word.letter == "P" and _give_to_g64(current, word):
            continue
        current.add(word)
        if word.axis >= 0 or word.letter == "[" or (word.letter in moving and current.spec is None):
            current.moves = True
    commands = tuple(command.finish() for command in opened)
    _check_group(commands, faults, span, moving)
    return commands


def _lookup(word: Word, faults: FaultList, span: SpanOf) -> CommandSpec:
    spec = find_command(word.letter, word.text)
    if spec is None:
        if word.value == word.value:
            faults.add(
                "MC110",
                f"{word.shown} is not a code of this dialect",
                span(word.index),
                nearest_command(word.letter, word.text),
            )
        return UNKNOWN
    return spec


def _absorbs_setting(command: _OpenCommand) -> bool:
    """Return whether a modal code here is part of the command, and does not end it (D-01a)."""
    if command.moves:
        return False
    return command.spec is None or command.spec.kind in _LED


def _give_to_g64(command: _OpenCommand, word: Word) -> bool:
    """Assign P as the tolerance of G64: directly after it, or anywhere after it without a motion code."""
    place = command.setting
    if place < 0 or command.moves or (command.spec is not None and place != len(command.items) - 1):
        return False
    setting = command.items[place]
    if not isinstance(setting, Setting) or setting.spec.name != "G64" or setting.argument is not None:
        return False
    command.items[place] = Setting(setting.spec, setting.index, word)
    command.last = word.index
    return True


def _check_group(commands: Group, faults: FaultList, span: SpanOf, moving: str) -> None:
    acting = [command for command in commands if command.spec is not None and command.spec.kind in _ACTING]
    unknown = any(command.spec is UNKNOWN for command in commands)
    implied: Command | None = None
    for command in commands:
        if command.spec is None and command.moves:
            if not acting and implied is None:
                implied = command
            elif not unknown:
                _report_orphan_axes(command, acting[0] if acting else implied, faults, span)
        _check_words(command, command is implied, faults, span, moving)
    for command in acting:
        spec = command.spec
        assert spec is not None
        if spec.kind is Kind.DWELL:
            others = [other for other in commands if other is not command]
            if others:
                faults.add(
                    "MC115",
                    f"{spec.name} stands alone in its group",
                    span(command.first, command.last),
                    "put it on a line of its own, or behind a comma",
                )
        elif len(acting) > 1 and (spec.kind is not Kind.MOVE or spec.number not in _FEED_CODES):
            if any(other.spec is not None and other.spec.kind is Kind.DWELL for other in acting):
                continue
            faults.add(
                "MC115",
                f"{spec.name} cannot share one duration with other commands: only G01, G02 and G03 can",
                span(command.first, command.last),
                "separate it by a comma, or put it on a line of its own",
            )


def _report_orphan_axes(command: Command, other: Command | None, faults: FaultList, span: SpanOf) -> None:
    words = [
        item
        for item in command.items
        if isinstance(item, Word) and (_is_axis(item) or item.letter in _OFFSETS)
    ]
    before = other is not None and command.first < other.first
    faults.add(
        "MC113",
        f"{words[0].shown} belongs to no command: a command is a code and the words that follow it",
        span(words[0].index, words[-1].index),
        "write the words after their code" if before else "write the motion code again before these words",
    )


def _is_axis(word: Word) -> bool:
    return word.axis >= 0 or word.letter == "["


def _check_words(command: Command, implied: bool, faults: FaultList, span: SpanOf, moving: str) -> None:
    """Report words that the command does not take, and repeated words."""
    spec = command.spec
    if spec is UNKNOWN:
        return
    seen: dict[str | int, Word] = {}
    for item in command.items:
        if isinstance(item, Setting):
            continue
        key: str | int = item.axis if item.axis >= 0 else item.letter
        before = seen.get(key) if item.letter != "[" or item.axis >= 0 else None
        if before is not None:
            if item.axis >= 0 and before.letter != item.letter:
                faults.add(
                    "MC114",
                    f"{before.name} and {item.name} are both axis {item.axis}",
                    span(item.index),
                    _twice_hint(before, item),
                    axis=item.axis,
                )
            else:
                faults.add(
                    "MC111",
                    f"{item.name} stands twice in one command",
                    span(item.index),
                    "keep one of them",
                    edit=Edit(*span(item.index), "") if item.text == before.text else None,
                )
            continue
        seen[key] = item
        if _is_axis(item):
            if spec is not None and not spec.takes_axes:
                _report_not_taken(spec, item, faults, span)
        elif spec is not None:
            if item.letter not in spec.words and not (item.letter in moving and spec.kind is Kind.MOVE):
                _report_not_taken(spec, item, faults, span)
        elif implied:
            if item.letter not in _LOOSE_MOVE:
                _report_orphan_word(item, faults, span)
        elif item.letter not in _LOOSE and not command.moves:
            _report_orphan_word(item, faults, span)


def _twice_hint(before: Word, word: Word) -> str:
    if word.letter in INCREMENTAL_LETTERS or before.letter in INCREMENTAL_LETTERS:
        return "U V W are X Y Z as increments; keep one of the two"
    return "X Y Z A B C are [0] to [5]; keep one of the two"


def _report_not_taken(spec: CommandSpec, word: Word, faults: FaultList, span: SpanOf) -> None:
    hint = "take it out"
    if spec.kind is Kind.AXIS and word.axis >= 0:
        hint = f"name the axis by P{word.axis}"
    elif spec.kind is Kind.DWELL and word.letter in "FXUS":
        hint = f"give the seconds by P, such as P{word.text.lstrip('+')}" if word.letter != "F" else hint
    elif word.letter in "IJKR" and spec.takes_axes:
        hint = "R and I J K belong to G02 and G03"
    elif word.letter == "T":
        hint = "T stands alone or with G00-G03"
    elif word.letter == "F":
        hint = "F stands alone, beside G93 or G94, or in a motion command"
    faults.add("MC112", f"{spec.name} does not take {word.name}", span(word.index), hint)


def _report_orphan_word(word: Word, faults: FaultList, span: SpanOf) -> None:
    hint = "write the motion code before it"
    if word.letter == "P":
        hint = "P belongs to G02, G03, G04, G64 and the axis commands"
    faults.add("MC113", f"{word.shown} belongs to no command", span(word.index), hint)


def _check_line(groups: tuple[Group, ...], faults: FaultList, span: SpanOf) -> None:
    """Check a whole line: axis commands exclude motion (D-01a), a pause is only allowed at its ends."""
    everything = [command for group in groups for command in group]
    acts = [
        place
        for place, command in enumerate(everything)
        if (command.spec is not None and command.spec.kind in _ACTING)
        or (command.spec is None and command.moves)
    ]
    for place, command in enumerate(everything):
        if command.spec is None or not acts:
            continue
        if command.spec.kind is Kind.AXIS:
            faults.add(
                "MC115",
                f"{command.spec.name} shares its line with no motion",
                span(command.first, command.last),
                "put it on a line of its own",
            )
        elif command.spec.name in ("M00", "M01") and acts[0] < place < acts[-1]:
            faults.add(
                "MC115",
                f"{command.spec.name} cannot stand between motions that start together",
                span(command.first, command.last),
                "put it on a line of its own",
            )
