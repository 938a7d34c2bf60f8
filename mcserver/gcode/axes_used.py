"""Find the axes that a program names or moves, including the chains of its tools; for leases."""

from __future__ import annotations

import re

from mcserver.gcode.profiles.codes import RETRACTING
from mcserver.gcode.profiles.frame import LENGTH_AXIS
from mcserver.gcode.profiles.reader import reader_of
from mcserver.gcode.text.parser import scan_line
from mcserver.gcode.text.profile_words import Action
from mcserver.gcode.text.source import split_lines
from mcserver.gcode.text.syntax import Command
from mcserver.gcode.text.words import Word
from mcserver.machine.dialect_section import Dialect
from mcserver.machine.machine_file import Machine

_ARC_AXES = frozenset((0, 1, 2))
# variables, expressions and calls of a profile: their axes are only known when the program runs
_COMPUTED = re.compile(r"#|\[(?!\d+\])|\bO\s*[<\d]|M0*98(?!\d)|G65(?!\d)", re.IGNORECASE)
# words that turn a spindle: G74 and G84 start a stopped one
_SPINDLE = re.compile(r"(?:M0*(?:[345]|19)|G(?:74|84))(?!\d)|S\s*[-+.\d#\[]", re.IGNORECASE)


def axes_used(text: str, machine: Machine) -> tuple[int, ...]:
    """Return the axes that a program may need, sorted: all axes of the machine if it computes or calls.

    It may return an axis too many, such as the letters of a tool's pose, but never one too few. Axis commands
    without P act on the leased axes and need none of their own.
    """
    if not machine.dialect.reference and _COMPUTED.search(text):
        return tuple(sorted(axis.index for axis in machine.axes))
    return axes_named(text, machine)


def axes_named(text: str, machine: Machine) -> tuple[int, ...]:
    """Return the axes that a program's words need, and its spindle, sorted."""
    known = {axis.index for axis in machine.axes}
    dialect = machine.dialect
    chains = {tool.number: tool.axes for tool in machine.tools}
    found: set[int] = set()
    if dialect.spindle is not None and _SPINDLE.search(text):
        found.add(dialect.spindle)
    read = reader_of(dialect)
    for number, line in enumerate(split_lines(text), start=1):
        # also as the reference's dialect reads it: T of a profile may choose a tool with tip control
        for parsed in (scan_line(line, number), *([] if dialect.strict else [read(line, number)])):
            for group in parsed.groups:
                for command in group:
                    found |= _axes_of(command, chains)
            for action in () if parsed.profile is None else parsed.profile.actions:
                found |= _axes_of_action(action, dialect)
    return tuple(sorted(found & known))


def _axes_of_action(action: Action, dialect: Dialect) -> set[int]:
    named = {word.axis for word in action.axes}
    if action.code in RETRACTING.values():
        return {dialect.letters["E"], LENGTH_AXIS}
    if action.code in ("G28", "G30") and not named:
        return set(dialect.homed)
    return named


def _axes_of(command: Command, chains: dict[int, tuple[int, ...]]) -> set[int]:
    found: set[int] = set()
    on_arc = False
    for item in command.items:
        if not isinstance(item, Word) or item.value != item.value:
            continue
        if item.axis >= 0:
            found.add(item.axis)
        elif item.letter == "T":
            found.update(chains.get(int(item.value), ()))
        elif item.letter in "IJKR":
            on_arc = True
        elif item.letter == "P" and command.spec is not None and command.spec.operation is not None:
            found.add(int(item.value))
    return found | _ARC_AXES if on_arc else found
