"""Faults of the programs of ``[[button]]``, at their places in the machine file."""

from __future__ import annotations

import re

import msgspec

from mcserver.errors import Diagnostic
from mcserver.machine.button_section import PLACE, Button, filled
from mcserver.machine.machine_file import Machine
from mcserver.machine.toml_positions import Position, find_positions
from mcserver.planning.start_state import StartState
from mcserver.simulation.foresight import check_text


def find_button_faults(machine: Machine, source: str) -> list[Diagnostic]:
    """Return what is wrong with the text of each button: profile, words, geometry and travel.

    Each is checked from the axes' initial positions with the least, the first and the greatest numbers that
    may be given; the first of these that has a fault at a place is named.

    Args:
        source: text of the machine file.
    """
    positions = find_positions(source)
    found: list[Diagnostic] = []
    for number, button in enumerate(machine.buttons):
        places: set[tuple[str, int]] = set()
        for values in _values(button):
            for fault in check_text(filled(button.text, values), machine, StartState.of(machine)):
                if (fault.code, fault.line) in places:
                    continue
                places.add((fault.code, fault.line))
                given = ", ".join(f"{name} = {value:g}" for name, value in values.items())
                said = f'button "{button.name}"{f" with {given}" if given else ""}: {fault.message}'
                key = positions[("button", number, "text")]
                line, column, end = _place(source, key, button.text, fault, values)
                found.append(
                    msgspec.structs.replace(
                        fault, message=said, line=line, column=column, end_column=end, edit=None
                    )
                )
    return found


def _values(button: Button) -> list[dict[str, float]]:
    """Return the numbers that a button is checked with."""
    found: list[dict[str, float]] = []
    for each in (
        {argument.name: argument.first for argument in button.argument},
        {argument.name: argument.low for argument in button.argument},
        {argument.name: argument.high for argument in button.argument},
    ):
        if each not in found:
            found.append(each)
    return found


def _place(
    source: str, key: Position, text: str, fault: Diagnostic, values: dict[str, float]
) -> tuple[int, int, int]:
    """Return line, column and end column of a fault in the file; the key's, where escapes hide the place."""
    written, lines = source.replace("\r\n", "\n").split("\n"), text.split("\n")
    opening = re.match(r"\s*=\s*('''|\"\"\"|'|\")", written[key.line - 1][key.end_column - 1 :])
    if opening is None or not 1 <= fault.line <= len(lines):
        return key
    before = key.end_column - 1 + opening.end()
    # the newline behind opening quotes of three is no part of the text
    begins_below = len(opening[1]) == 3 and written[key.line - 1][before:] == ""
    line = key.line + begins_below + fault.line - 1
    shift = before if fault.line == 1 and not begins_below else 0
    content = lines[fault.line - 1]
    if line > len(written) or not written[line - 1][shift:].startswith(content):
        return key
    column, end = (_column(content, each, values) for each in (fault.column, fault.end_column))
    return line, shift + column, shift + end


def _column(content: str, column: int, values: dict[str, float]) -> int:
    """Return the column as written of a column of the line with its numbers in their places."""
    for place in PLACE.finditer(content):
        width = len(filled(place[0], values))
        if column <= place.start() + 1:
            break
        if column < place.start() + 1 + width:
            return place.start() + 1
        column += len(place[0]) - width
    return column
