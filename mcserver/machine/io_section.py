"""Inputs and outputs of a machine: ``[[input]]``, ``[[output]]`` and ``[dialect.outputs]``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal

import msgspec
from msgspec import Meta

from mcserver.machine.io_object import (
    DIGITAL_INPUTS,
    DIGITAL_OUTPUTS,
    IoObject,
    IoObjectSection,
    read_object,
)
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path

if TYPE_CHECKING:
    from mcserver.machine.drive import Drive

# Most channels of each kind: range of P in M62 to M66 and of E in M66 to M68.
MAX_CHANNELS = 64

Level = bool | float
Kind = Literal["digital", "analog"]
Number = Annotated[int, Meta(ge=0, lt=MAX_CHANNELS, description="number each kind from 0 to 63")]
Name = Annotated[
    str,
    Meta(
        pattern=r"^[A-Za-z0-9]([A-Za-z0-9 _.-]{0,38}[A-Za-z0-9])?$",
        description="40 letters, digits, blanks, '-', '_' or '.' at the most",
    ),
]
# ---------------------------------------------------------------- as written


class ScriptSection(msgspec.Struct, frozen=True):
    """One entry of ``simulated``: a value of the input from a time on."""

    at_s: Annotated[float, Meta(ge=0.0, description="seconds from the start, 0 or more")]
    value: Level


class ChannelSection(msgspec.Struct, frozen=True):
    """Keys that ``[[input]]`` and ``[[output]]`` have in common."""

    number: Number
    name: Name
    kind: Kind = "digital"
    unit: Annotated[str, Meta(max_length=12, description="12 characters at the most")] = ""
    scale: float = 1.0
    offset: float = 0.0
    invert: bool = False


class InputSection(ChannelSection, frozen=True):
    """``[[input]]``."""

    debounce_ms: Annotated[float, Meta(ge=0.0, le=10_000.0, description="5 is usual for switches")] = 0.0
    initial: Level = 0.0
    simulated: list[ScriptSection] = []
    source: IoObjectSection | None = None
    hold_on: bool | None = None
    hold_below: float | None = None
    hold_above: float | None = None
    stop_on: bool | None = None
    stop_below: float | None = None
    stop_above: float | None = None


class OutputSection(ChannelSection, frozen=True):
    """``[[output]]``."""

    min: float | None = None
    max: float | None = None
    initial: Level = 0.0
    safe: bool | float | Literal["keep"] | None = None
    laser: bool = False
    target: IoObjectSection | None = None


# ---------------------------------------------------------------- the model


class ScriptedValue(msgspec.Struct, frozen=True):
    """``value`` of a simulated input from ``at_s`` on, in seconds of the executor's time."""

    at_s: float
    value: float


class Channel(msgspec.Struct, frozen=True):
    """Attributes that inputs and outputs have in common; values of digital ones are 0 and 1.

    Attributes:
        number: within its kind, as P (digital) and E (analog) name it.
        unit, scale, offset: value = raw · scale + offset [unit].
        invert: a digital one is 1 if its source or target is 0.
    """

    number: int
    name: str
    digital: bool = True
    unit: str = ""
    scale: float = 1.0
    offset: float = 0.0
    invert: bool = False


class Input(Channel, frozen=True):
    """One input.

    Attributes:
        debounce: least duration of a change [s].
        initial, script: of a simulated one, as seen by the program, before debouncing.
        source: None: simulated.
        hold_below, hold_above, stop_below, stop_above: thresholds beyond which it holds or stops the machine.
    """

    debounce: float = 0.0
    initial: float = 0.0
    script: tuple[ScriptedValue, ...] = ()
    source: IoObject | None = None
    hold_below: float = -math.inf
    hold_above: float = math.inf
    stop_below: float = -math.inf
    stop_above: float = math.inf

    def value_of(self, raw: float) -> float:
        """Convert the source's number to a value."""
        if self.digital:
            return float((raw != 0.0) is not self.invert)
        return raw * self.scale + self.offset

    def holds(self, value: float) -> bool:
        """Return whether this value holds the machine's programs."""
        return not self.hold_below <= value <= self.hold_above

    def stops(self, value: float) -> bool:
        """Return whether this value stops the machine."""
        return not self.stop_below <= value <= self.stop_above


class Output(Channel, frozen=True):
    """One output.

    Attributes:
        low, high: least and greatest value [unit].
        initial: when the executor starts. safe: after an emergency stop, and if whoever set it is lost; None:
            it keeps its value.
        laser: it is 0 while the program that set it does not move along a path (D-77).
        target: None: simulated.
    """

    low: float = 0.0
    high: float = 1.0
    initial: float = 0.0
    safe: float | None = 0.0
    laser: bool = False
    target: IoObject | None = None

    def raw_of(self, value: float) -> float:
        """Convert a value to the number for the target."""
        if self.digital:
            return float((value != 0.0) is not self.invert)
        return (value - self.offset) / self.scale


def read_inputs(
    sections: Sequence[InputSection | None],
    buses: set[str],
    mistakes: Mistakes,
    drives: Mapping[int, Drive] = MappingProxyType({}),
) -> tuple[Input, ...]:
    """Return the inputs of ``[[input]]``, digital ones first, each kind by number.

    Args:
        sections: None for one with a mistake. buses: names of the file's buses. drives: by axis.
    """
    found: list[Input] = []
    for position, section in enumerate(sections):
        if section is None:
            continue
        path: Path = ("input", position)
        digital = section.kind == "digital"
        common = _common(section, path, mistakes)
        _check_interlocks(section, path, mistakes)
        if section.source is not None and section.simulated:
            mistakes.add(
                (*path, "simulated"),
                "belongs to a simulated input, and this one has a source",
                "remove one of the two",
            )
        script = tuple(
            sorted(
                (
                    ScriptedValue(
                        each.at_s, _level(each.value, digital, (*path, "simulated", at, "value"), mistakes)
                    )
                    for at, each in enumerate(section.simulated)
                ),
                key=lambda each: each.at_s,
            )
        )
        found.append(
            Input(
                **common,
                debounce=section.debounce_ms * 1e-3,
                initial=_level(section.initial, digital, (*path, "initial"), mistakes),
                script=script,
                source=read_object(
                    section.source, digital, (*path, "source"), (buses, drives), DIGITAL_INPUTS, mistakes
                ),
                hold_below=_threshold(section.hold_on, False, section.hold_below, -math.inf),
                hold_above=_threshold(section.hold_on, True, section.hold_above, math.inf),
                stop_below=_threshold(section.stop_on, False, section.stop_below, -math.inf),
                stop_above=_threshold(section.stop_on, True, section.stop_above, math.inf),
            )
        )
    _check_unique("input", found, sections, mistakes)
    return tuple(sorted(found, key=lambda each: (not each.digital, each.number)))


def read_outputs(
    sections: Sequence[OutputSection | None],
    inputs: Sequence[Input],
    buses: set[str],
    mistakes: Mistakes,
    drives: Mapping[int, Drive] = MappingProxyType({}),
) -> tuple[Output, ...]:
    """Return the outputs of ``[[output]]``, digital ones first, each kind by number.

    Args:
        sections: None for one with a mistake. inputs: whose names are taken. buses: names of the file's.
        drives: by axis.
    """
    found: list[Output] = []
    names = {each.name for each in inputs}
    for position, section in enumerate(sections):
        if section is None:
            continue
        path: Path = ("output", position)
        digital = section.kind == "digital"
        common = _common(section, path, mistakes)
        for key in ("min", "max"):
            if digital and getattr(section, key) is not None:
                mistakes.add((*path, key), "belongs to an analog output", 'leave it out, or kind = "analog"')
        low = 0.0 if section.min is None or digital else section.min
        high = 1.0 if section.max is None or digital else section.max
        if not low < high:
            mistakes.add((*path, "max"), f"{high:g} is not above min, {low:g}", "exchange the two")
        initial = _level(section.initial, digital, (*path, "initial"), mistakes)
        safe: float | None = initial
        if section.safe == "keep":
            safe = None
        elif section.safe is not None:
            safe = _level(section.safe, digital, (*path, "safe"), mistakes)
        for key, value in (("initial", initial), ("safe", safe)):
            if value is not None and not low <= value <= high and low < high:
                mistakes.add(
                    (*path, key), f"{value:g} is outside min … max", f"give {low:g} … {high:g}, or widen it"
                )
        if section.laser and not initial == safe == low == 0.0:
            mistakes.add(
                (*path, "laser"), "min, initial and safe of a laser are 0", "leave the three of them out"
            )
        if section.name in names:
            mistakes.add(
                (*path, "name"), f'"{section.name}" is an input\'s name', "name each input and output once"
            )
        found.append(
            Output(
                **common,
                low=low,
                high=high,
                initial=initial,
                safe=safe,
                laser=section.laser,
                target=read_object(
                    section.target, digital, (*path, "target"), (buses, drives), DIGITAL_OUTPUTS, mistakes
                ),
            )
        )
    _check_unique("output", found, sections, mistakes)
    return tuple(sorted(found, key=lambda each: (not each.digital, each.number)))


def find_channel(channels: Sequence[Channel], number: int, *, digital: bool) -> int | None:
    """Return the column of a channel by its number and kind; None if the machine has no such channel."""
    for column, each in enumerate(channels):
        if each.number == number and each.digital is digital:
            return column
    return None


# ---------------------------------------------------------------- checks


def _level(value: Level | str, digital: bool, path: Path, mistakes: Mistakes) -> float:
    level = float(value)
    if digital and level not in (0.0, 1.0):
        mistakes.add(path, f"{level:g} is no value of a digital one", "give true or false")
        return 0.0
    if not digital and isinstance(value, bool):
        mistakes.add(path, "an analog value is a number", "give a number in its unit")
    return level


def _threshold(on: bool | None, value: bool, limit: float | None, default: float) -> float:
    """Return the threshold of an interlock: ``hold_on = true`` is above 0.5, false below 0.5."""
    if on is not None:
        return 0.5 if on is value else default
    return default if limit is None else limit


def _common(section: ChannelSection, path: Path, mistakes: Mistakes) -> dict[str, Any]:
    """Return the checked fields of a `Channel`."""
    digital = section.kind == "digital"
    if section.scale == 0.0:
        mistakes.add((*path, "scale"), "0 makes every value the same", "give the units of one raw step")
    if digital:
        for key, default in (("unit", ""), ("scale", 1.0), ("offset", 0.0)):
            if getattr(section, key) != default:
                mistakes.add((*path, key), "belongs to an analog one", 'leave it out, or kind = "analog"')
    elif section.invert:
        mistakes.add((*path, "invert"), "belongs to a digital one", "give a negative scale")
    shared = ("number", "name", "unit", "scale", "offset", "invert")
    return {"digital": digital} | {key: getattr(section, key) for key in shared}


def _check_interlocks(section: InputSection, path: Path, mistakes: Mistakes) -> None:
    digital = section.kind == "digital"
    foreign = ("hold_below", "hold_above", "stop_below", "stop_above") if digital else ("hold_on", "stop_on")
    for key in foreign:
        if getattr(section, key) is not None:
            other = "hold_on or stop_on" if digital else "hold_below, hold_above, stop_below or stop_above"
            mistakes.add((*path, key), f"does not belong to a {section.kind} input", f"give {other}")
    for what in ("hold", "stop"):
        low, high = getattr(section, f"{what}_below"), getattr(section, f"{what}_above")
        if low is not None and high is not None and not low < high:
            mistakes.add((*path, f"{what}_below"), f"no value is left between it and {what}_above", "")
    if not digital and section.debounce_ms:
        mistakes.add((*path, "debounce_ms"), "belongs to a digital input", "filter it at its source")


def _check_unique(
    kind: str,
    found: Sequence[Channel],
    sections: Sequence[ChannelSection | None],
    mistakes: Mistakes,
) -> None:
    places = [position for position, section in enumerate(sections) if section is not None]
    numbers: set[tuple[bool, int]] = set()
    names: set[str] = set()
    for position, each in zip(places, found, strict=True):
        what = f"{'digital' if each.digital else 'analog'} {kind} {each.number}"
        if (each.digital, each.number) in numbers:
            mistakes.add((kind, position, "number"), f"{what} is there twice", "number each of a kind once")
        if each.name in names:
            mistakes.add(
                (kind, position, "name"), f'"{each.name}" is there twice', "name each input and output once"
            )
        numbers.add((each.digital, each.number))
        names.add(each.name)
