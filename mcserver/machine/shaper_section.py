"""``shaper`` of an axis: input shaping against residual vibration of a flexible axis, and its costs.

The shaped position is a mean of past setpoints with weights that are not negative, so that limits of
velocity, acceleration, jerk and travel hold for it as for the setpoints. Impulses are those of Singer and
Seering (ZV), Singhose, Seering and Singer (EI and two-hump EI, for 5 % of residual vibration) and of Klipper
(MZV). The smooth one is a mean of a mean: a trapezoid.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
from msgspec import Meta

from mcserver.machine.advance_section import ACCELERATION_SLACK, Lead
from mcserver.machine.constraints import Damping
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path
from mcserver.units import AxisType

if TYPE_CHECKING:
    from mcserver.machine.axis import Axis

# Residual vibration that EI and 2HEI are designed for [1].
RESIDUAL = 0.05
# Longest shaper [cycles]: the history that the executor keeps of each axis.
MAX_CYCLES = 1000

# Lengths of the smooth shaper's two means [periods]: the shortest that leave `RESIDUAL` at ±10 % of the
# frequency with any damping.
SMOOTH_LONG, SMOOTH_SHORT = 1.03, 0.59
# Impulses of the smooth shaper, enough to be smooth in cycles.
SMOOTH_PARTS = 1000

ShaperType = Literal["zv", "mzv", "ei", "2hei", "smooth"]


class Shaper(msgspec.Struct, frozen=True):
    """``shaper`` as written.

    Attributes:
        frequency_hz: natural frequency of the axis. damping: its damping ratio.
    """

    type: ShaperType
    frequency_hz: Annotated[float, Meta(ge=1.0, le=500.0, description="`mcserver resonance` measures it")]
    damping: Damping = 0.1

    def impulses(self) -> tuple[tuple[float, float], ...]:
        """Return times [s], from 0, and weights, whose sum is 1."""
        root = math.sqrt(1.0 - self.damping**2)
        period = 1.0 / (self.frequency_hz * root)

        def decay(periods: float) -> float:
            """Return the decay of a vibration in a time."""
            return math.exp(-2.0 * math.pi * self.damping / root * periods)

        if self.type == "zv":
            parts = [(0.0, 1.0), (0.5, 1.0)]
        elif self.type == "mzv":
            end = 1.0 - 1.0 / math.sqrt(2.0)
            parts = [(0.0, end), (0.375, math.sqrt(2.0) - 1.0), (0.75, end)]
        elif self.type == "ei":
            parts = [(0.0, 1.0 + RESIDUAL), (0.5, 2.0 * (1.0 - RESIDUAL)), (1.0, 1.0 + RESIDUAL)]
        elif self.type == "smooth":
            step = (SMOOTH_LONG + SMOOTH_SHORT) / SMOOTH_PARTS
            parts = [
                (step * at, min(step * min(at + 1, SMOOTH_PARTS - at), SMOOTH_SHORT))
                for at in range(SMOOTH_PARTS)
            ]
        else:
            square = RESIDUAL**2
            x = (square * (math.sqrt(1.0 - square) + 1.0)) ** (1.0 / 3.0)
            outer = (3.0 * x * x + 2.0 * x + 3.0 * square) / (16.0 * x)
            parts = [(0.0, outer), (0.5, 0.5 - outer), (1.0, 0.5 - outer), (1.5, outer)]
        weights = [weight * decay(at) for at, weight in parts]
        whole = math.fsum(weights)
        return tuple((at * period, weight / whole) for (at, _), weight in zip(parts, weights, strict=True))

    def residual(self, frequency_hz: float, damping: float) -> float:
        """Return the vibration after its last impulse, as a share of that without the shaper."""
        omega, root = 2.0 * math.pi * frequency_hz, math.sqrt(1.0 - damping**2)
        impulses = self.impulses()
        end = impulses[-1][0]
        return abs(
            sum(
                cmath.rect(weight * math.exp(-damping * omega * (end - at)), omega * root * at)
                for at, weight in impulses
            )
        )

    def mean_s(self) -> float:
        """Return its mean delay of the path [s]."""
        return math.fsum(at * weight for at, weight in self.impulses())


class Shaping(msgspec.Struct, frozen=True):
    """Shapers of a machine, in cycles. All axes that follow a path have the same mean delay.

    Attributes:
        delay: mean delay [cycles].
        weights: by column, of the setpoint 0, 1, 2, … cycles ago; without a shaper 1 at ``delay``; for a
            drive that makes its own profiles 1 at 0.
        deviations: by column, greatest distance of the shaped position from the delayed one [m or rad].
        speed_changes: by column, greatest difference of the shaped velocity from the delayed one [m/s or
            rad/s].
        path_deviation: resulting deviation from a path [m]; a degree counts as a millimetre.
        tools: ``weights`` with a tool in the spindle, by its number; others have those above. The figures
            hold with every tool.
        lead: pressure advance of a printer's E, included in its figures; None without one.
    """

    delay: int
    weights: tuple[tuple[float, ...], ...]
    deviations: tuple[float, ...]
    speed_changes: tuple[float, ...]
    path_deviation: float
    tools: Mapping[int, tuple[tuple[float, ...], ...]] = {}
    lead: Lead | None = None

    @property
    def length(self) -> int:
        """Cycles from the end of the setpoints to the end of the shaped ones."""
        # one more cycle: the flow of a motion's last cycle is gone only in the next one
        lead = 0 if self.lead is None else len(self.lead.weights) + 1
        return max(lead, *(len(each) for kinds in self.kinds for each in kinds)) - 1

    @property
    def kinds(self) -> tuple[tuple[tuple[float, ...], ...], ...]:
        """By column, weights without a tool and with each of ``tools``."""
        return tuple(zip(self.weights, *self.tools.values(), strict=True))

    @classmethod
    def of(cls, axes: Sequence[Axis], cycle_s: float) -> Shaping | None:
        """Return the shaping of a machine's axes; None if drives get the setpoints unchanged.

        That is if no axis has a shaper, limits reserved for superimposed motion, or pressure advance.
        """
        tools = sorted({tool for axis in axes for tool in axis.tool_shapers})
        # the same delay for all tools, so that a change of weights at rest moves nothing
        shapers = [[axis.tool_shapers.get(tool, axis.shaper) for tool in (0, *tools)] for axis in axes]
        means = [each.mean_s() / cycle_s for kinds in shapers for each in kinds if each is not None]
        led = [axis.pressure_advance for axis in axes if axis.pressure_advance is not None]
        # the smoothing of the flow is centred on the delayed path
        means += [float(each.half(cycle_s)) for each in led]
        if not means and not any(axis.reserved for axis in axes):
            return None
        # whole cycles, so that axes without a shaper are delayed exactly
        delay = math.ceil(max(means, default=0.0) - 1e-9)
        weights, deviations, changes, path = [], [], [], 0.0
        for axis, own in zip(axes, shapers, strict=True):
            kinds = [(1.0,) if axis.profiled else _weights(each, delay, cycle_s) for each in own]
            variance = max(_moment(each, delay, 2) for each in kinds)
            spread = max(_moment(each, delay, 1) for each in kinds)
            most = 0.0 if axis.profiled else ACCELERATION_SLACK * axis.max_acceleration * cycle_s
            # Taylor's theorem about the mean, at which the first order cancels
            deviations.append(0.5 * variance * most * cycle_s)
            changes.append(spread * most)
            scale = 1.0 if axis.type is AxisType.LINEAR else 1e-3 / axis.type.si_per_unit
            path += (scale * deviations[-1]) ** 2
            if axis.pressure_advance is not None:
                # not in the path's deviation: without flow E is at its setpoint
                deviations[-1] += axis.pressure_advance.offset
                changes[-1] += axis.pressure_advance.velocity
            weights.append(kinds)
        first, *others = zip(*weights, strict=True)
        by_tool = dict(zip(tools, others, strict=True))
        lead = Lead.of(dict(enumerate(axes)), delay, cycle_s)
        return cls(delay, first, tuple(deviations), tuple(changes), math.sqrt(path), by_tool, lead)


def _moment(weights: Sequence[float], delay: int, order: int) -> float:
    """Return the absolute central moment of weights about the delay [cycles to the power of the order]."""
    return math.fsum(weight * abs(at - delay) ** order for at, weight in enumerate(weights))


def _weights(shaper: Shaper | None, delay: int, cycle_s: float) -> tuple[float, ...]:
    """Return weights by cycle of delay; an impulse between two cycles is split so that the mean stays."""
    if shaper is None:
        return (*[0.0] * delay, 1.0)
    lead = delay - shaper.mean_s() / cycle_s
    places = [(max(lead, 0.0) + at / cycle_s, weight) for at, weight in shaper.impulses()]
    weights = [0.0] * (math.floor(places[-1][0]) + 2)
    for at, weight in places:
        whole = math.floor(at)
        weights[whole] += weight * (1.0 - (at - whole))
        weights[whole + 1] += weight * (at - whole)
    if weights[-1] == 0.0:
        weights.pop()
    return tuple(weights)


def check_shapers(
    axes: Mapping[Path, Axis],
    tool_axes: frozenset[int],
    profile: str,
    cycle_s: float,
    tolerance: float,
    mistakes: Mistakes,
) -> Shaping | None:
    """Return the shaping of a machine in the order of its axes' numbers; report shapers that are not
    possible.

    Args:
        axes: by the paths of their sections. tool_axes: joints of tools. profile: of its programs.
        tolerance: of paths [m].
    """
    for path, axis in axes.items():
        own = {(*path, "tool_shapers", str(tool)): each for tool, each in axis.tool_shapers.items()}
        if axis.shaper is not None:
            own[*path, "shaper"] = axis.shaper
        if not own:
            continue
        place, longest = max(own.items(), key=lambda each: each[1].impulses()[-1][0])
        what = None
        if axis.profiled:
            what = "its drive makes the profiles itself", 'use csp or ip there: mode = "pp" goes to points'
        elif axis.index in tool_axes:
            what = (
                "it is a joint of a tool, at whose tip the deviation is not known",
                "shape axes that no [[tool]] names",
            )
        elif longest.impulses()[-1][0] > MAX_CYCLES * cycle_s:
            what = f"it is longer than {MAX_CYCLES} cycles", "give a higher frequency_hz"
        elif axis.tool_shapers and profile != "cnc":
            place = (*path, "tool_shapers")
            what = (
                f"programs of the profile {profile} change no tool in a spindle",
                'give one shaper for all, or use [dialect] profile = "cnc"',
            )
        if what is not None:
            mistakes.add(place, what[0], what[1])
            return None
    shaping = Shaping.of(sorted(axes.values(), key=lambda axis: axis.index), cycle_s)
    if shaping is not None and 0.0 < shaping.path_deviation >= tolerance:
        most = shaping.path_deviation * 1e3
        mistakes.add(
            ("motion", "path_tolerance_mm"),
            f"{tolerance * 1e3:g} mm leave nothing for corners: shapers leave a path by up to {most:.3f} mm",
            f"give more than {most:.3f}, a lower max_acceleration, or a shorter shaper, such as zv",
        )
    return shaping
