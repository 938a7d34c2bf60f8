"""The dialect that a machine reads: a profile, and its parts one by one."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Literal

import msgspec

from mcserver.machine.section_reader import Mistakes
from mcserver.machine.sections import CutterSection, DialectSection
from mcserver.units import MM

Profile = Literal["reference", "cnc", "printer", "robot"]


class Dialect(msgspec.Struct, frozen=True):
    """What a machine's programs may say; the defaults are the reference's strict dialect.

    Attributes:
        profile: the family of programs. letters: further axis letters, to axis numbers.
        auto_capture: the first move of a program energizes its leased axes.
        ignore: codes and macros that are accepted without effect, besides the profile's own.
        spindle: axis that M3, M4, M5 and S turn; None: they have no effect.
        dwell_unit: of G04 P [s]. tool_change: what M6 does where the tool differs from the one before.
        systems: work coordinate systems that programs start with, number → axis → [m or rad].
        cutters: length of each tool of the tool table, for G43 [m].
    """

    profile: Profile = "reference"
    letters: Mapping[str, int] = {}
    auto_capture: bool = False
    ignore: frozenset[str] = frozenset()
    spindle: int | None = None
    dwell_unit: float = 1.0
    tool_change: Literal["pause", "ignore"] = "pause"
    cutters: Mapping[int, float] = {}
    systems: Mapping[int, Mapping[int, float]] = {}

    @property
    def reference(self) -> bool:
        """Return True if the profile is the reference's own, whatever parts are overridden."""
        return self.profile == "reference"

    @property
    def strict(self) -> bool:
        """Return True if programs are read as the reference has it and no other way."""
        return self.profile == "reference" and not (self.letters or self.ignore or self.spindle is not None)


def read_dialect(
    section: DialectSection | None,
    cutters: list[CutterSection | None],
    axes: Container[int],
    mistakes: Mistakes,
) -> Dialect:
    """Return the dialect of ``[dialect]`` and ``[[cutter]]``.

    Args:
        section: None where there is none, or one with a mistake. cutters: None where one has a mistake.
        axes: numbers of the machine's axes.
    """
    lengths: dict[int, float] = {}
    for position, cutter in enumerate(cutters):
        if cutter is None:
            continue
        if cutter.number in lengths:
            mistakes.add(
                ("cutter", position, "number"), f"T{cutter.number} is there twice", "number each once"
            )
        lengths[cutter.number] = cutter.length_mm * MM
    if section is None:
        return Dialect(cutters=lengths)
    for letter, axis in section.letters.items():
        if len(letter) != 1 or letter not in "DEHLOQS":
            mistakes.add(
                ("dialect", "letters", letter),
                "cannot be an axis: it is a word already",
                "letters that are free for axes: D E H L O Q S",
            )
        if axis not in axes:
            mistakes.add(
                ("dialect", "letters", letter), f"the machine has no axis {axis}", "name an axis of this file"
            )
    if section.spindle_axis is not None and section.spindle_axis not in axes:
        mistakes.add(
            ("dialect", "spindle_axis"),
            f"the machine has no axis {section.spindle_axis}",
            "name an axis of this file",
        )
    capture = section.capture or ("program" if section.profile == "reference" else "auto")
    unit = section.dwell or ("ms" if section.profile == "printer" else "s")
    return Dialect(
        profile=section.profile,
        letters=section.letters,
        auto_capture=capture == "auto",
        ignore=frozenset(each.upper() for each in section.ignore),
        spindle=section.spindle_axis,
        dwell_unit=1e-3 if unit == "ms" else 1.0,
        tool_change=section.tool_change,
        cutters=lengths,
    )
