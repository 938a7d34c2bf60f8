"""``[axis.homing]`` and ``[probe]``: the reference of an axis, and the input that ends a probing move."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Mapping
from types import MappingProxyType
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from mcserver.machine.drive import CanDrive, Drive
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path

Method = Literal["switch", "index", "hard-stop", "absolute", "drive", "manual"]

_Positive = Annotated[float, Meta(gt=0.0, description="give a number above 0")]
_Number = Annotated[int, Meta(ge=0, le=255, description="the number of an [[input]]")]

# Longest approach, as a multiple of the axis's travel, without `travel`.
SEARCH_MARGIN = 1.1
# Longest way off a switch that is active at the start, in back-off distances.
RELEASE_BACK_OFFS = 5.0

# The letters that name axes in every dialect.
LETTERS = MappingProxyType({letter: axis for axis, letter in enumerate("XYZABC")})

# Methods that move the axis by the server's setpoints, and those without motion.
SEARCHING = frozenset({"switch", "index", "hard-stop"})
STANDING = frozenset({"absolute", "manual"})


class HomingSection(msgspec.Struct, frozen=True):
    """``[axis.homing]`` as written: mm, deg and seconds.

    Attributes:
        method: kind of the reference. direction: towards it.
        velocity: of the search. latch_velocity: of the final approach. back_off: distance between the two.
        position: of the axis at the reference. then_move_to: target after homing.
        order: lower numbers first, equal ones together.
        input: number of the [[input]] with the switch; None: the drive's home switch (60FDh bit 2).
        invert: the drive's switch is active at 0.
        index: after the switch, continue to the encoder's index.
        torque: at which the hard stop counts as reached [N·m].
        travel: longest search; release_travel: longest way off a switch that is active at the start.
        encoder: "absolute" keeps its reading without power, so that the reference is permanent.
        required: programs may move the axis only after homing. jog_velocity: highest before that.
    """

    method: Method
    direction: Literal["negative", "positive"] = "negative"
    velocity: _Positive = 10.0
    latch_velocity: _Positive = 1.0
    back_off: _Positive = 2.0
    position: float | None = None
    then_move_to: float | None = None
    order: Annotated[int, Meta(ge=0, le=63, description="0 to 63; equal numbers home together")] = 0
    input: _Number | None = None
    invert: bool = False
    index: bool = False
    torque: Annotated[float, Meta(ge=0.0, description="above what the motion itself needs")] = 0.0
    travel: _Positive | None = None
    release_travel: _Positive | None = None
    encoder: Literal["incremental", "absolute"] = "incremental"
    required: bool = True
    jog_velocity: _Positive | None = None


class Homing(msgspec.Struct, frozen=True):
    """Homing of an axis, in SI.

    Attributes:
        direction: 1 or -1. position: at the reference [m or rad]; None: the drive's reading there.
        absolute: the reference survives a loss of power. Others as in `HomingSection`.
    """

    method: Method
    direction: float
    velocity: float
    latch_velocity: float
    back_off: float
    position: float | None
    then_move_to: float | None
    order: int
    input: int | None
    invert: bool
    index: bool
    torque: float
    travel: float
    release_travel: float
    absolute: bool
    required: bool
    jog_velocity: float

    @property
    def finds(self) -> bool:
        """Whether `home` can find the reference; else `reference` has to set it."""
        return self.method not in STANDING


class AxisLimits(msgspec.Struct, frozen=True):
    """Limits of an axis that homing depends on, in mm or deg; infinite if not limited."""

    low: float
    high: float
    max_velocity: float
    drive: Drive


def read_homing(
    section: HomingSection | None, axis: AxisLimits, scale: float, path: Path, mistakes: Mistakes
) -> Homing | None:
    """Return the homing of an axis in SI; mistakes: MC030 … MC033.

    Args:
        scale: SI for 1 mm or deg. path: of the section.
    """
    if section is None:
        return None
    method = section.method

    def bad(key: str, what: str, hint: str, code: str = "MC030") -> None:
        mistakes.add((*path, key), what, hint, code)

    _check_method(section, axis, bad)
    if section.latch_velocity > section.velocity:
        bad(
            "latch_velocity",
            f"{section.latch_velocity:g} is above velocity = {section.velocity:g}",
            "the approach that counts is the slower one",
        )
    fastest = max(section.velocity, section.jog_velocity or 0.0)
    if fastest > axis.max_velocity:
        key = "velocity" if section.velocity == fastest else "jog_velocity"
        bad(key, f"{fastest:g} is above the axis's max_velocity", f"give {axis.max_velocity:g} or less")
    for key in ("position", "then_move_to"):
        value = getattr(section, key)
        if key == "then_move_to" and value is not None and not axis.low <= value <= axis.high:
            bad(key, f"{value:g} is outside the axis's travel", "give a position inside", "MC032")
    travel = section.travel
    if travel is None:
        travel = (axis.high - axis.low) * SEARCH_MARGIN
        if method in SEARCHING and not math.isfinite(travel):
            bad(
                "travel",
                "an axis without min_position and max_position could search without end",
                "give travel = the longest distance to the reference",
                "MC031",
            )
    return Homing(
        method=method,
        direction=1.0 if section.direction == "positive" else -1.0,
        velocity=section.velocity * scale,
        latch_velocity=section.latch_velocity * scale,
        back_off=section.back_off * scale,
        position=_reference_position(section, scale),
        then_move_to=None if section.then_move_to is None else section.then_move_to * scale,
        order=section.order,
        input=section.input,
        invert=section.invert,
        index=section.index,
        torque=section.torque,
        travel=travel * scale,
        release_travel=(section.release_travel or RELEASE_BACK_OFFS * section.back_off) * scale,
        absolute=method == "absolute" or section.encoder == "absolute",
        required=section.required,
        jog_velocity=(section.jog_velocity or section.velocity) * scale,
    )


def check_inputs(
    switches: Mapping[Path, int], probe: Probe | None, digital: Container[int], mistakes: Mistakes
) -> None:
    """Refuse switches and probes on inputs that do not exist: MC033, MC035.

    Args:
        switches: path of the key → number of the input. digital: numbers of the digital inputs.
    """
    for path, number in switches.items():
        if number not in digital:
            mistakes.add(
                path, f"there is no digital input {number}", "add an [[input]] of that number", "MC033"
            )
    if probe is not None and probe.input is not None and probe.input not in digital:
        mistakes.add(
            ("probe", "input"),
            f"there is no digital input {probe.input}",
            "add an [[input]] of that number",
            "MC035",
        )


def _reference_position(section: HomingSection, scale: float) -> float | None:
    if section.position is None and section.method == "drive":
        return None
    return (section.position or 0.0) * scale


def _check_method(section: HomingSection, axis: AxisLimits, bad: Callable[..., None]) -> None:
    method = section.method
    simulated = not isinstance(axis.drive, CanDrive)
    if method == "hard-stop" and section.torque <= 0.0:
        bad(
            "torque",
            "a hard stop is found by the torque there",
            "give torque = … N·m",
        )
    if method != "hard-stop" and section.torque > 0.0:
        bad("torque", f'does not belong to method = "{method}"', 'it belongs to method = "hard-stop"')
    if method == "hard-stop" and not axis.drive.has_inertia:
        bad("method", "an ideal drive has no torque of its own", 'use kind = "simulated"')
    if (method == "index" or section.index) and not simulated:
        bad(
            "index" if section.index else "method",
            f"a drive of kind {axis.drive.kind!r} does not report its encoder's index here",
            'let the drive find it: method = "drive" with 6098h 33 or 34, or one of 1 to 14',
        )
    if section.index and method != "switch":
        bad("index", f'does not belong to method = "{method}"', 'it belongs to method = "switch"')
    if method == "switch" and section.input is None and not axis.drive.has_switches:
        bad(
            "input",
            f"the home switch of a drive of kind {axis.drive.kind!r} is not read",
            'give the number of an [[input]], or let the drive find it: method = "drive"',
            "MC033",
        )
    if method != "switch" and section.input is not None:
        bad("input", f'does not belong to method = "{method}"', 'it belongs to method = "switch"')
    if method == "drive" and not axis.drive.homes:
        bad(
            "method",
            "the drive's section does not say how it homes",
            "add [axis.drive.homing] with its method",
        )
    if method in SEARCHING and axis.drive.profiled:
        bad(
            "method",
            'with mode = "pp" the drive makes the motion: a search cannot end it where it has to',
            'let the drive find it: method = "drive"',
        )
    if method in STANDING and section.then_move_to is not None:
        bad("then_move_to", f'method = "{method}" moves nothing', "leave the key out")


class ProbeSection(msgspec.Struct, frozen=True):
    """``[probe]``: the input of a touch probe.

    Attributes:
        input: number of the [[input]]; None: simulated only. invert: the contact opens at the work.
        simulated_at: axis letter or number → position of a simulated plane of the work [mm, deg].
    """

    input: _Number | None = None
    invert: bool = False
    simulated_at: dict[str, float] = {}


class Probe(msgspec.Struct, frozen=True):
    """Probe of a machine; ``planes``: axis number → position of simulated contact [m or rad]."""

    input: int | None = None
    invert: bool = False
    planes: Mapping[int, float] = {}


def read_probe(
    section: ProbeSection | None, letters: Mapping[str, int], scales: Mapping[int, float], mistakes: Mistakes
) -> Probe | None:
    """Return the probe in SI; mistakes: MC034 unknown axis, MC035 nothing would trip it.

    Args:
        letters: axis letters to numbers. scales: SI for 1 mm or deg, by axis number.
    """
    if section is None:
        return None
    planes: dict[int, float] = {}
    for name, position in section.simulated_at.items():
        index = int(name) if name.isdecimal() else letters.get(name, -1)
        if index not in scales:
            known = [letter for letter, number in letters.items() if number in scales]
            mistakes.add(
                ("probe", "simulated_at", name),
                f"{name!r} is no axis of this machine",
                f"axes: {', '.join(known)}, or their numbers",
                "MC034",
            )
            continue
        planes[index] = position * scales[index]
    if section.input is None and not section.simulated_at:
        mistakes.add(
            ("probe",),
            "nothing would ever trip the probe",
            "give input = the number of an [[input]], or simulated_at = { Z = -3.2 }",
            "MC035",
        )
    return Probe(section.input, section.invert, planes)
