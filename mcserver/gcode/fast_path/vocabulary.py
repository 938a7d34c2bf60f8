"""The words that lines in columns may have; lines with other words go to the block interpreter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mcserver.gcode.profiles.io_codes import is_scaled, keeps_to_path
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, axis_letters
from mcserver.machine.machine_file import Machine


class Vocabulary(NamedTuple):
    """The words of a dialect that lines in columns may have.

    Attributes:
        axes: letter → axis. indexed: ``[n]`` names one too. codes: number of a motion code as written → the
            code that it stands for.
        feed_of_axes: F counts the named axes (D-30); otherwise X Y Z first (D-66).
        tools: T is the number of the tool that moves (D-50).
        idle: letters without effect on motion: S if no output follows it, E without an extruder.
        speed: S is stored in the frame. outputs: by direction of the spindle, the outputs that follow S with
            the motion of its line: column, and whether scaled.
    """

    axes: Mapping[str, int]
    indexed: bool
    codes: Mapping[bytes, int]
    feed_of_axes: bool
    tools: bool
    idle: str
    speed: bool
    outputs: Mapping[int, tuple[tuple[int, bool], ...]]


def vocabulary_of(machine: Machine) -> Vocabulary:
    """Return the vocabulary of a machine's dialect."""
    dialect = machine.dialect
    axes = {
        letter: axis
        for letter, axis in axis_letters(dialect).items()
        if letter not in INCREMENTAL_LETTERS or letter in dialect.letters
    }
    printer = dialect.profile == "printer"
    # printers move alike with G0 and G1 (D-61)
    codes = {0: 1 if printer else 0, 1: 1, 2: 2, 3: 3}
    outputs = {
        direction: tuple(
            (each.column, is_scaled(machine.outputs[each.column], code))
            for each in dialect.outputs.get(code, ())
            if each.value is None
        )
        for direction, code in ((1, "M3"), (-1, "M4"))
    }
    followers = {column for each in outputs.values() for column, _ in each}
    # other outputs change only at rest (D-73)
    at_rest = any(not keeps_to_path(machine, machine.outputs[column]) for column in followers)
    speed = not (dialect.reference or dialect.spindle is not None or at_rest or "S" in axes)
    return Vocabulary(
        axes,
        True,
        {(b"0" * zeros) + b"%d" % code: meant for code, meant in codes.items() for zeros in range(3)},
        dialect.reference,
        bool(machine.tools) and dialect.profile in ("reference", "robot"),
        ("S" if speed and not followers else "") + ("E" if printer and "E" not in axes else ""),
        speed,
        outputs,
    )
