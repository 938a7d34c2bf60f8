"""Speed over time, each axis against its limits, and times asked and taken."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.ticker import EngFormatter

from mcserver.plot.scene import AxisTrace, Scene, TimedLine
from mcserver.plot.strokes import runs_of
from mcserver.plot.theme import FAINT_INK, INK, LIMIT

MAX_BARS = 20
LEAST_BARS = 8
# Share of a limit from which on it is drawn without being asked for.
NEAR_LIMIT = 0.6
MOST_ERRORS = 3
# Longest name of an axis in the legend of following errors, and in a title.
LONGEST_IN_LEGEND = 6
LONGEST_IN_TITLE = 8
SHADES = ("#4477aa", "#ee6677", "#228833")
QUANTITIES = ("velocity", "acceleration", "jerk")


def draw_speed(axes: Any, scene: Scene, colours: Mapping[int, str]) -> None:
    """Speed along the path, the area below coloured by line; without a path, of the fastest axis."""
    if scene.paths:
        for path in scene.paths:
            speed = path.speed()
            for number, first, end in runs_of(path.line):
                part = slice(first, end + 1)
                axes.plot(path.time[part], speed[part], color=colours[number], linewidth=1.6)
                if len(scene.paths) == 1:
                    axes.fill_between(
                        path.time[part], speed[part], color=colours[number], alpha=0.22, linewidth=0
                    )
        axes.set_title("Speed along the path [mm/s]")
    else:
        for trace in scene.axes:
            velocity, _, _ = trace.derivatives(scene.cycle_s)
            for number, first, end in runs_of(scene.line):
                part = slice(first, end + 1)
                axes.plot(scene.time[part], np.abs(velocity[part]), color=colours[number], linewidth=1.4)
        units = sorted({f"{trace.unit}/s" for trace in scene.axes})
        axes.set_title(f"Speed of each axis [{', '.join(units)}]")
    axes.set_ylim(bottom=0.0)
    axes.margins(x=0.01)
    axes.set_xlabel("time [s]")


def draw_derivative(axes: Any, scene: Scene, trace: AxisTrace, order: int, *, to_limit: bool) -> None:
    """Velocity (0), acceleration (1) or jerk (2) of one axis.

    Args:
        to_limit: scale to the limit; else to the motion, and the limit is drawn where it is near.
    """
    values = trace.derivatives(scene.cycle_s)[order]
    limit = trace.limits[order]
    axes.fill_between(scene.time, values, color="#4477aa", alpha=0.18, linewidth=0)
    axes.plot(scene.time, values, color="#4477aa", linewidth=0.9)
    peak = float(np.abs(values).max(initial=0.0))
    unit = f"{trace.unit}/s" + ("", "²", "³")[order]
    if math.isfinite(limit):
        if to_limit or peak > NEAR_LIMIT * limit:
            for bound in (limit, -limit):
                axes.axhline(bound, color=LIMIT, linewidth=1.0, linestyle=(0, (5, 3)))
            axes.set_ylim(-1.18 * max(limit, peak), 1.18 * max(limit, peak))
        said = f"{peak:,.0f} of {limit:,.0f} {unit} ({100.0 * peak / limit:.0f} %)"
    else:
        said = f"peak {peak:,.0f} {unit}, not limited"
    axes.set_title(f"{_short_name(trace, LONGEST_IN_TITLE)} {QUANTITIES[order]}")
    axes.set_title(said.replace(",", "\u2009"), loc="right", fontsize=8, fontweight="normal", color=FAINT_INK)
    axes.yaxis.set_major_formatter(EngFormatter(sep="\u2009"))
    axes.margins(x=0.01)


def _short_name(trace: AxisTrace, longest: int) -> str:
    return trace.name if len(trace.name) <= longest else f"axis {trace.index}"


def draw_following_errors(axes: Any, scene: Scene) -> None:
    """Setpoint minus encoder of the three axes with the greatest errors."""
    errors = sorted(
        ((float(np.abs(trace.following_error).max(initial=0.0)), trace) for trace in scene.axes),
        key=lambda each: -each[0],
    )[:MOST_ERRORS]
    for (peak, trace), shade in zip(errors, SHADES, strict=False):
        label = f"{_short_name(trace, LONGEST_IN_LEGEND)}: ±{peak:.3g}"
        axes.plot(scene.time, trace.following_error, color=shade, linewidth=1.0, label=label)
    if errors:
        # above the panel, where it hides nothing
        axes.legend(
            loc="lower right",
            bbox_to_anchor=(1.0, 1.0),
            borderaxespad=0.1,
            fontsize=7.5,
            ncols=3,
            handlelength=1.2,
            columnspacing=1.2,
            frameon=False,
        )
    units = " or ".join(sorted({trace.unit for _, trace in errors}))
    axes.set_title(f"Following error [{units}]" if units else "Following error")
    axes.set_xlabel("time [s]")
    axes.margins(x=0.01)


def draw_deviation(axes: Any, scene: Scene, colours: Mapping[int, str]) -> None:
    """Distance of the encoders' path from the setpoints' path."""
    peak = 0.0
    for path in scene.paths:
        deviation = path.deviation()
        peak = max(peak, float(deviation.max(initial=0.0)))
        for number, first, end in runs_of(path.line):
            part = slice(first, end + 1)
            axes.plot(path.time[part], deviation[part], color=colours[number], linewidth=1.2)
    axes.set_title("Path deviation [mm]")
    axes.set_title(f"peak {peak:.3g} mm", loc="right", fontsize=8, fontweight="normal", color=FAINT_INK)
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("time [s]")
    axes.margins(x=0.01)


def draw_times(axes: Any, scene: Scene, colours: Mapping[int, str]) -> None:
    """Each line's time: the bar is the time taken, the black mark the time asked."""
    shown = _most_telling(scene.timed_lines)
    places = np.arange(len(shown), dtype=float)
    taken = np.array([each.end_s - each.start_s for each in shown])
    shades = [colours.get(each.line, INK) for each in shown]
    axes.barh(places, taken, height=0.66, color=shades, alpha=0.4, linewidth=0)
    longest = max(
        float(taken.max(initial=0.0)), max((each.requested_s or 0.0 for each in shown), default=0.0)
    )
    for place, each, length in zip(places, shown, taken, strict=True):
        if each.requested_s is not None:
            axes.plot([each.requested_s] * 2, [place - 0.4, place + 0.4], color=INK, linewidth=2.0)
        said = f"{length:.3f} s" + (f", {each.bound_by}" if each.bound_by else "")
        # at the bar's left, but where the mark would cut the text
        crossed = 0.0 < (each.requested_s or 0.0) < 0.25 * longest
        left = max(length, each.requested_s or 0.0) + 0.01 * longest if crossed else 0.015 * longest
        axes.text(left, place, said, va="center", fontsize=7.5, color=INK)
    axes.set_yticks(places, [f"{each.line}" for each in shown])
    axes.set_ylim(max(len(shown), LEAST_BARS) - 0.4, -0.6)
    axes.grid(axis="y", visible=False)
    axes.set_xlim(0.0, max(longest * 1.05, 1e-3))
    axes.set_xlabel("time [s]")
    axes.set_ylabel("line")
    rest = len(scene.timed_lines) - len(shown)
    share = f" ({len(shown)} of {len(scene.timed_lines)})" if rest else ""
    axes.set_title(f"Time of each line, | asked{share}")


def _most_telling(lines: tuple[TimedLine, ...]) -> list[TimedLine]:
    if len(lines) <= MAX_BARS:
        return list(lines)

    def added(each: TimedLine) -> float:
        return each.end_s - each.start_s - (each.requested_s if each.requested_s is not None else 0.0)

    return sorted(sorted(lines, key=added)[-MAX_BARS:], key=lambda each: each.start_s)
