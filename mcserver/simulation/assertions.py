"""What a run has to keep to, given with the request and judged on every setpoint of its simulation.

A closed vocabulary: each assertion bounds one quantity of the run. It is no language of expressions.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.errors import Diagnostic, Refused, UsageFault
from mcserver.machine.machine_file import Machine
from mcserver.simulation.coordinates import Array, Coordinates
from mcserver.units import MM

if TYPE_CHECKING:
    from mckinematics.solver import MachineKinematics

MOST_ASSERTIONS = 100
# Bodies that stay this much above the margin apart are not in the clearance report [mm].
REPORTED_MM = 50.0

# A bound holds that is passed by no more [mm or deg, per second].
ROUNDING = 1e-9

Quantity = Literal["end", "position", "travel", "speed", "duration", "clearance"]
_UNITS = {"duration": "s", "clearance": "mm"}
_FIELD = re.compile(r"(least|most)=(\S+)")


# value, time [s], line
_Extreme = tuple[float, float, int]


class Assertion(msgspec.Struct, frozen=True):
    """One bound of a run.

    Attributes:
        what: ``end``: where a coordinate ends; ``position``: where it is at any time; ``travel``: how far its
            greatest place is from its least; ``speed``: of an axis, or of a tool's tip (``T3``);
            ``duration`` [s]; ``clearance``: the least between bodies [mm].
        of: the coordinate: ``X``, ``7``, ``T3.X``; a speed's axis or tool; empty for duration and clearance.
        least, most: bounds, which belong to it [mm or deg, per second]; None: none to this side.
    """

    what: Quantity
    of: str = ""
    least: float | None = None
    most: float | None = None


class Judged(msgspec.Struct, frozen=True):
    """An assertion as the run keeps to it.

    Attributes:
        what, of, least, most: of the assertion. holds: whether the run keeps to it.
        value: the extreme that counts; None: bodies stay farther apart than is reported.
        time_s, line: when and in which line it has this value, or leaves the bounds of a position or speed.
    """

    what: Quantity
    of: str
    least: float | None
    most: float | None
    holds: bool
    value: float | None
    time_s: float
    line: int


def read_assertion(text: str) -> Assertion:
    """Read an assertion as the command line has it, such as ``position Z most=50``.

    Raises:
        UsageFault: MC331 it cannot be meant as it stands.
    """
    hint = f"write {', '.join(get_args(Quantity))}, the coordinate, and least=… or most=…: position Z most=50"
    what, *others = text.split() or [""]
    bounds: dict[str, float] = {}
    names = []
    for word in others:
        field = _FIELD.fullmatch(word)
        if field is None:
            names.append(word)
            continue
        try:
            bounds[field[1]] = float(field[2])
        except ValueError:
            raise UsageFault("MC331", f"{text[:80]!r}: {field[2][:20]!r} is not a number", hint) from None
    if what not in get_args(Quantity) or len(names) > 1:
        raise UsageFault("MC331", f"{text[:80]!r} is no assertion", hint)
    return msgspec.convert({"what": what, "of": "".join(names), **bounds}, Assertion)


def check_assertions(
    asked: Sequence[Assertion], machine: Machine, kinematics: MachineKinematics | None
) -> None:
    """Check that a machine has what assertions name.

    Raises:
        Refused: MC331 it has not, or an assertion bounds nothing.
    """
    if len(asked) > MOST_ASSERTIONS:
        raise Refused(
            "MC331", f"{len(asked)} assertions, {MOST_ASSERTIONS} are judged at once", "leave some out"
        )
    coordinates = Coordinates(machine, kinematics)
    row = np.array([[axis.initial_position for axis in machine.axes]])
    for each in asked:
        bounds = [bound for bound in (each.least, each.most) if bound is not None]
        if not bounds or not all(map(math.isfinite, bounds)) or bounds != sorted(bounds):
            raise Refused(
                "MC331", f"the bounds of {each.what} {each.of[:40]} do not fit", "give least, most, or both"
            )
        if each.what in _UNITS:
            if each.of:
                raise Refused(
                    "MC331", f"{each.what} is of the whole run, not of {each.of[:40]}", "leave it out"
                )
        elif each.what == "speed":
            coordinates.speed(each.of, row, machine.cycle_s)
        else:
            coordinates.of(each.of, row)
        if each.what == "clearance":
            _check_clearance(bounds, machine)


def _check_clearance(bounds: Sequence[float], machine: Machine) -> None:
    if machine.clearance is None:
        raise Refused("MC331", f"{machine.name} names no bodies, so nothing is clear", "add [clearance]")
    margin = machine.clearance.margin / MM
    if min(bounds) < margin:
        # of a pair in contact the distance of the first contact is known, not its least
        raise Refused(
            "MC331",
            f"a clearance of {min(bounds):g} mm: what is nearer than the margin, {margin:g} mm, is a contact",
            "ask for the margin or more, or make `margin_mm` of [clearance] less",
        )
    reported = REPORTED_MM + margin
    if max(bounds) > reported:
        raise Refused(
            "MC331",
            f"a clearance of {max(bounds):g} mm: distances up to {reported:g} mm are told",
            "ask for less",
        )


class _Extremes:
    """Least, greatest and newest value of a quantity with times and lines, and where it leaves its bounds."""

    def __init__(self, first: float, least: float | None, most: float | None) -> None:
        self._least = -math.inf if least is None else least - ROUNDING
        self._most = math.inf if most is None else most + ROUNDING
        self.low = self.high = self.last = (first, 0.0, 0)
        self.left: _Extreme | None = self.low if not self._least <= first <= self._most else None

    def take(self, values: Array, times: Array, lines: NDArray[np.int64]) -> None:
        def at(cycle: int) -> _Extreme:
            return float(values[cycle]), float(times[cycle]), int(lines[cycle])

        low, high = int(values.argmin()), int(values.argmax())
        if values[low] < self.low[0]:
            self.low = at(low)
        if values[high] > self.high[0]:
            self.high = at(high)
        if self.left is None and not self._least <= values[low] <= values[high] <= self._most:
            self.left = at(int(np.argmax((values < self._least) | (values > self._most))))
        self.last = at(-1)


class AssertionMeter:
    """Judges assertions on the cycles of a run, which it is shown in order.

    Args:
        machine: as it starts. asked: that `check_assertions` lets pass.
    """

    def __init__(
        self, asked: Sequence[Assertion], machine: Machine, kinematics: MachineKinematics | None
    ) -> None:
        self._asked = asked
        self._cycle = machine.cycle_s
        self._units = {each.of: _unit_of(each.of, machine, kinematics) for each in asked}
        self._coordinates = Coordinates(machine, kinematics)
        self._last = np.array([[axis.initial_position for axis in machine.axes]])
        self._extremes = [
            _Extremes(0.0, None, each.most)
            if each.what == "speed"
            else _Extremes(float(self._coordinates.of(each.of, self._last)[0]), each.least, each.most)
            if each.what not in _UNITS
            else None
            for each in asked
        ]

    def take(self, times: Array, lines: NDArray[np.int64], setpoint: Array) -> None:
        """Look at cycles in order: times [s] and lines (n,), setpoints (n, K) [SI]."""
        followed = np.concatenate((self._last, setpoint))
        for asked, extremes in zip(self._asked, self._extremes, strict=True):
            if extremes is None or not len(times):
                continue
            if asked.what == "speed":
                values = self._coordinates.speed(asked.of, followed, self._cycle)
            else:
                values = self._coordinates.of(asked.of, followed)[1:]
            extremes.take(values, times, lines)
        self._last = followed[-1:].copy()

    def judge(self, report: Mapping[str, Any]) -> list[Judged]:
        """Return what each assertion comes to; ``report``: with the run's duration and clearance."""
        return [
            self._judge(each, *self._measured(each, extremes, report))
            for each, extremes in zip(self._asked, self._extremes, strict=True)
        ]

    def faults(self, judged: Sequence[Judged]) -> list[Diagnostic]:
        """Return a fault for each assertion that does not hold, at its line (MC330)."""
        return [
            Diagnostic(
                code="MC330",
                message=f"{_said(each, self._unit(each))}, at {each.time_s:.3f} s",
                line=each.line,
                column=1 if each.line else 0,
                end_column=2 if each.line else 0,
                hint="change the program, or what is asked of it",
            )
            for each in judged
            if not each.holds
        ]

    def _judge(self, asked: Assertion, low: _Extreme, high: _Extreme, left: _Extreme | None) -> Judged:
        below = asked.least is not None and low[0] < asked.least - ROUNDING
        above = asked.most is not None and high[0] > asked.most + ROUNDING
        value, time_s, line = low if below or (asked.most is None and not above) else high
        if left is not None and (below or above):
            # the line that leaves the bounds is to be changed, however far the run goes beyond them
            time_s, line = left[1:]
        return Judged(
            what=asked.what,
            of=asked.of,
            least=asked.least,
            most=asked.most,
            holds=not below and not above,
            value=value if math.isfinite(value) else None,
            time_s=time_s,
            line=line,
        )

    def _measured(
        self, asked: Assertion, extremes: _Extremes | None, report: Mapping[str, Any]
    ) -> tuple[_Extreme, _Extreme, _Extreme | None]:
        """Return the least and the greatest value that count, and where the run leaves the bounds."""
        if extremes is None:
            duration = float(report["duration_s"])
            found = (duration, duration, int(report.get("last_line", 0)))
            if asked.what == "clearance":
                pairs = report["clearance"]["pairs"]
                nearest = pairs[0] if pairs else {"least_mm": math.inf, "time_s": 0.0, "line": 0}
                found = (float(nearest["least_mm"]), float(nearest["time_s"]), int(nearest["line"]))
            return found, found, None
        match asked.what:
            case "end":
                return extremes.last, extremes.last, None
            case "travel":
                later = max(extremes.low, extremes.high, key=lambda each: each[1])
                found = (extremes.high[0] - extremes.low[0], later[1], later[2])
                return found, found, None
            case "speed":
                # the greatest is what counts to both sides: every run begins at rest
                return extremes.high, extremes.high, extremes.left
        return extremes.low, extremes.high, extremes.left

    def _unit(self, judged: Judged) -> str:
        return _UNITS.get(judged.what) or self._units[judged.of] + ("/s" if judged.what == "speed" else "")


def _unit_of(name: str, machine: Machine, kinematics: MachineKinematics | None) -> str:
    if not name or name.startswith("T"):
        return "deg" if name.endswith((".A", ".B", ".C")) else "mm"
    return machine.axes[Coordinates(machine, kinematics).column(name)].type.unit


def _said(judged: Judged, unit: str) -> str:
    of = f" of {judged.of}" if judged.of else ""
    least = "" if judged.least is None else f"at least {judged.least:g}"
    most = "" if judged.most is None else f"at most {judged.most:g}"
    asked = " and ".join(each for each in (least, most) if each)
    return f"the {judged.what}{of} is {judged.value:.6g} {unit}, asked is {asked} {unit}"
