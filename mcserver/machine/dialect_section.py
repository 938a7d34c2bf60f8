"""``[dialect]``: the dialect of a machine's programs, a profile and overrides of its parts."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from pathlib import Path
from typing import Literal

import msgspec

from mcserver.machine.io_section import Input, Output
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.sections import CutterSection, DialectSection, RetractionSection
from mcserver.machine.subroutines import read_subroutines
from mcserver.units import MM

Profile = Literal["reference", "cnc", "printer", "robot"]


# codes that have an effect of their own and cannot be mapped to outputs
_OWN = frozenset({*range(3), 6, 30, 60, *range(62, 69), 82, 83, *range(97, 100), 207, 208, 600})


class CodeOutput(msgspec.Struct, frozen=True):
    """Effect of a code on an output, by column; ``value`` None: it follows the word S."""

    column: int
    value: float | None


class CodeWait(msgspec.Struct, frozen=True):
    """Digital input that a code waits for, by column: longest wait, and pause before the first look [s]."""

    column: int
    timeout: float
    settle: float


class Cutter(msgspec.Struct, frozen=True):
    """One line of the tool table: length along Z and diameter [m]."""

    length: float
    diameter: float = 0.0


class Retraction(msgspec.Struct, frozen=True):
    """Firmware retraction of a printer by G10 and G11 (D-115).

    Attributes:
        length: of filament [m]. speed: of retraction [m/s]. hop: lift of Z [m].
        recover_speed: of G11 [m/s]. extra: filament of G11 beyond ``length`` [m].
    """

    length: float
    speed: float
    hop: float
    recover_speed: float
    extra: float


class Dialect(msgspec.Struct, frozen=True):
    """The dialect of a machine's programs; the defaults are the reference's strict dialect.

    Attributes:
        profile: family of programs. letters: additional axis letters, to axis numbers.
        auto_capture: the first move of a program energizes its leased axes.
        ignore: codes and macros accepted without effect, besides the profile's own.
        spindle: axis turned by M3, M4, M5 and S; None: they have no effect.
        thread_tolerance: allowed deviation of axes from the spindle's angle in a thread [m].
        dwell_unit: of G04 P [s].
        tool_change: effect of M6 if the tool differs from the last one; "ask": also at the first tool.
        outputs: effect of codes such as ``M8`` on outputs. waits: inputs that they then wait for.
        channels: the machine has inputs or outputs.
        systems: initial work coordinate systems of programs, number → axis → [m or rad].
        straight_rapids: G00 is a straight line, as fast as its slowest axis; else each axis is independent.
        subroutines: texts of subprograms in the machine's folder, by name or number.
        macros: the language of programs that compute, if allowed (D-80, D-91).
        persistent: first and last of parameters that keep their values from program to program (D-81).
        probes: the machine has a probe, and G38.2 … G38.5 act.
        cutters: tool table of the machine file, for G43.
        retraction: of G10 and G11 until M207 and M208; None: unknown.
        leads: E has pressure advance, and its codes act.
        mesh_axis: axis of the mesh that G29 probes; None: none, and codes of a mesh do not act.
    """

    profile: Profile = "reference"
    letters: Mapping[str, int] = {}
    auto_capture: bool = False
    ignore: frozenset[str] = frozenset()
    spindle: int | None = None
    thread_tolerance: float = 0.05 * MM
    dwell_unit: float = 1.0
    tool_change: Literal["pause", "ask", "ignore"] = "pause"
    cutters: Mapping[int, Cutter] = {}
    systems: Mapping[int, Mapping[int, float]] = {}
    straight_rapids: bool = False
    macros: Literal["linuxcnc", "fanuc"] = "linuxcnc"
    subroutines: Mapping[str, str] = {}
    persistent: tuple[tuple[int, int], ...] = ()
    probes: bool = False
    outputs: Mapping[str, tuple[CodeOutput, ...]] = {}
    waits: Mapping[str, CodeWait] = {}
    channels: bool = False
    retraction: Retraction | None = None
    leads: bool = False
    mesh_axis: int | None = None

    @property
    def mapped(self) -> frozenset[str]:
        """Codes that the machine file maps to outputs and inputs."""
        return frozenset({*self.outputs, *self.waits})

    @property
    def extruder(self) -> int | None:
        """A printer's axis E, which G10 and G11 retract; None without one."""
        return self.letters.get("E") if self.profile == "printer" else None

    @property
    def homed(self) -> frozenset[int]:
        """Axes that G28 and G30 without words move: X to C without spindle and additional letters."""
        return frozenset(range(6)) - {*self.letters.values(), self.spindle}

    @property
    def reference(self) -> bool:
        """Whether the profile is the reference's own, whatever parts are overridden."""
        return self.profile == "reference"

    @property
    def fanuc(self) -> bool:
        """Whether codes with two meanings have the one of Fanuc's controllers."""
        return self.macros == "fanuc"

    @property
    def computes(self) -> bool:
        """Whether programs may have expressions, parameters and O-words (D-80)."""
        return self.profile == "cnc"

    @property
    def strict(self) -> bool:
        """Whether programs are read exactly by the reference's grammar."""
        widened = self.letters or self.ignore or self.spindle is not None or self.channels or self.probes
        return self.profile == "reference" and not widened


def read_dialect(
    section: DialectSection | None,
    cutters: list[CutterSection | None],
    axes: Container[int],
    outputs: Sequence[Output],
    mistakes: Mistakes,
    *,
    inputs: Sequence[Input] = (),
    folder: Path | None = None,
) -> Dialect:
    """Return the dialect of ``[dialect]`` and ``[[cutter]]``.

    Args:
        section: None if missing or faulty. cutters: None for a faulty one.
        axes: numbers of the machine's axes. outputs, inputs: of the machine.
        folder: of the machine file; None: it is not on disk.
    """
    table: dict[int, Cutter] = {}
    for position, cutter in enumerate(cutters):
        if cutter is None:
            continue
        if cutter.number in table:
            mistakes.add(
                ("cutter", position, "number"), f"T{cutter.number} is there twice", "number each once"
            )
        table[cutter.number] = Cutter(cutter.length_mm * MM, cutter.diameter_mm * MM)
    if section is None:
        return Dialect(cutters=table, channels=bool(inputs or outputs))
    # U V W are increments wherever the reference's words are read
    free = "DEHLOQSUVW" if section.profile in ("cnc", "printer") else "DEHLOQS"
    for letter, axis in section.letters.items():
        if len(letter) != 1 or letter not in free:
            mistakes.add(
                ("dialect", "letters", letter),
                "cannot be an axis: it is a word already",
                f"letters that are free for axes: {' '.join(free)}",
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
    if section.rapids == "straight" and section.profile == "reference":
        mistakes.add(
            ("dialect", "rapids"),
            "the reference's G00 moves every axis by itself (D-20)",
            'straight rapids are for the profiles: profile = "cnc"',
        )
    for key, given in (
        ("macros", section.macros == "fanuc"),
        ("subroutines", section.subroutines),
        ("persistent", section.persistent),
    ):
        if given and section.profile != "cnc":
            mistakes.add(("dialect", key), "only the profile cnc computes", 'add profile = "cnc"')
    capture = section.capture or ("program" if section.profile == "reference" else "auto")
    unit = section.dwell or ("ms" if section.profile == "printer" else "s")
    return Dialect(
        profile=section.profile,
        letters=section.letters,
        auto_capture=capture == "auto",
        ignore=frozenset(each.upper() for each in section.ignore),
        spindle=section.spindle_axis,
        thread_tolerance=section.thread_tolerance_mm * MM,
        dwell_unit=1e-3 if unit == "ms" else 1.0,
        tool_change=section.tool_change,
        cutters=table,
        straight_rapids=section.rapids == "straight",
        macros=section.macros,
        subroutines=read_subroutines(section.subroutines, folder, mistakes),
        persistent=_read_persistent(section, mistakes),
        outputs=_read_code_outputs(section, outputs, mistakes),
        waits=_read_code_waits(section, inputs, mistakes),
        channels=bool(inputs or outputs),
        retraction=_read_retraction(section, mistakes),
    )


def _read_persistent(section: DialectSection, mistakes: Mistakes) -> tuple[tuple[int, int], ...]:
    """Return ``persistent``, and #500 to #999 of macro B, which controllers keep."""
    fanuc = section.macros == "fanuc"
    low, high = (100, 199) if fanuc else (31, 5000)
    for position, (first, last) in enumerate(section.persistent):
        if not low <= first <= last <= high:
            mistakes.add(
                ("dialect", "persistent", position),
                f"#{first} to #{last} are no parameters that can stay",
                f"give the first and the last of some from #{low} to #{high}, such as [{low}, {low + 9}]"
                + ("; #500 to #999 stay in any case" if fanuc else ""),
            )
    return (*section.persistent, *([(500, 999)] if fanuc else []))


def _read_retraction(section: DialectSection, mistakes: Mistakes) -> Retraction | None:
    """Return ``[dialect.retraction]`` in SI; None without one."""
    given: RetractionSection | None = section.retraction
    if given is None:
        return None
    if section.profile != "printer" or "E" not in section.letters:
        mistakes.add(
            ("dialect", "retraction"),
            "only printers with an extruder retract",
            'add profile = "printer" and letters = { E = 3 }, with the number of its axis',
        )
    return Retraction(
        length=given.length_mm * MM,
        speed=given.speed * MM,
        hop=given.hop_mm * MM,
        recover_speed=(given.recover_speed or given.speed) * MM,
        extra=given.extra_mm * MM,
    )


def _read_code_outputs(
    section: DialectSection, outputs: Sequence[Output], mistakes: Mistakes
) -> dict[str, tuple[CodeOutput, ...]]:
    """Return ``[dialect.outputs]``: code → its effects on outputs."""
    columns = {output.name: column for column, output in enumerate(outputs)}
    found: dict[str, tuple[CodeOutput, ...]] = {}
    for written, settings in section.outputs.items():
        path = ("dialect", "outputs", written)
        name = _free_code(written, path, mistakes)
        if name is None:
            continue
        if name in found:
            mistakes.add(path, f"{name} is there twice", "write all its outputs in one table")
        each: list[CodeOutput] = []
        for output_name, value in settings.items():
            column = columns.get(output_name)
            if column is None:
                known = ", ".join(columns) or "none"
                mistakes.add((*path, output_name), "is no output of this file", f"there is {known}")
                continue
            output = outputs[column]
            if value == "S":
                if output.digital:
                    mistakes.add((*path, output_name), "a digital one cannot follow S", "give true or false")
                each.append(CodeOutput(column, None))
                continue
            level = float(value)
            if output.digital is not isinstance(value, bool):
                hint = "true or false" if output.digital else 'a number, or "S"'
                mistakes.add((*path, output_name), f"{value!r} is no value of this output", f"give {hint}")
            elif not output.low <= level <= output.high:
                mistakes.add(
                    (*path, output_name),
                    f"{level:g} is outside its min … max",
                    f"give {output.low:g} … {output.high:g}",
                )
            each.append(CodeOutput(column, level))
        found[name] = tuple(each)
    return found


def _free_code(written: str, path: tuple[str, str, str], mistakes: Mistakes) -> str | None:
    """Return an M-code without an effect of its own, as in the tables; None after a noted mistake."""
    code = re.fullmatch(r"[Mm]0*([0-9]{1,4})", written)
    if code is None:
        mistakes.add(path, "is not an M-code", "write it as M8")
        return None
    if int(code[1]) in _OWN:
        mistakes.add(path, "does something else", "M3 to M5, M7 to M9, M10, M106 and others are free")
        return None
    return f"M{int(code[1])}"


def _read_code_waits(
    section: DialectSection, inputs: Sequence[Input], mistakes: Mistakes
) -> dict[str, CodeWait]:
    """Return ``[dialect.waits]``: code → input to wait for."""
    columns = {each.name: column for column, each in enumerate(inputs) if each.digital}
    found: dict[str, CodeWait] = {}
    for written, wait in section.waits.items():
        path = ("dialect", "waits", written)
        name = _free_code(written, path, mistakes)
        if name is None:
            continue
        column = columns.get(wait.input)
        if column is None or name in found:
            known = ", ".join(columns) or "none"
            mistakes.add(
                path, f"{wait.input!r} is no digital input, or {name} is there twice", f"there is {known}"
            )
            continue
        found[name] = CodeWait(column, wait.for_s, wait.settle_s)
    return found
