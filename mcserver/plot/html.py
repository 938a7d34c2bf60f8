"""A page that stands alone: the run's data and the code that draws it, nothing loaded from anywhere."""

from __future__ import annotations

import html
import math
from importlib import resources
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from mcserver.plot.scene import AxisTrace, PathTrace, Scene
from mcserver.plot.theme import colours_of

MAX_POINTS = 6000
QUANTITIES = ("velocity", "acceleration", "jerk")


def page_of(scene: Scene) -> str:
    """Return the page: pan, zoom, turn in space, and a cursor in time that all panels share."""
    template = resources.files("mcserver.plot").joinpath("page.html").read_text("utf-8")
    embedded = msgspec.json.encode(_facts(scene)).decode()
    # inside a script element only these could end it or open a comment
    embedded = embedded.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    return template.replace("{{title}}", html.escape(scene.title)).replace("{{facts}}", embedded)


def _facts(scene: Scene) -> dict[str, Any]:
    colours = colours_of(scene.line.tolist() + [each.line for each in scene.timed_lines])
    rows = _rows(len(scene.time))
    return {
        "title": scene.title,
        "duration": scene.duration_s,
        "feedLength": scene.feed_length_mm,
        "colours": {str(number): colour for number, colour in colours.items()},
        "time": _short(scene.time[rows]),
        "line": scene.line[rows].tolist(),
        "paths": [_path(path) for path in scene.paths],
        "zeros": [{"name": zero.name, "at": list(zero.at)} for zero in scene.zeros],
        "axes": [_axis(trace, scene, rows) for trace in scene.axes],
        "timed": [
            {
                "line": each.line,
                "start": each.start_s,
                "end": each.end_s,
                "asked": each.requested_s,
                "bound": each.bound_by,
                "source": each.source,
            }
            for each in scene.timed_lines
        ],
    }


def _rows(count: int) -> NDArray[np.int64]:
    return np.unique(np.linspace(0, max(count - 1, 0), min(count, MAX_POINTS)).astype(np.int64))


def _path(path: PathTrace) -> dict[str, Any]:
    rows = _rows(len(path.time))
    return {
        "label": path.label,
        "names": path.names,
        "time": _short(path.time[rows]),
        "line": path.line[rows].tolist(),
        "setpoint": [_short(column) for column in path.setpoint[rows].T],
        "actual": [_short(column) for column in path.actual[rows].T],
        "speed": _short(path.speed()[rows]),
        "deviation": _short(_extremes(path.deviation(), rows)),
    }


def _axis(trace: AxisTrace, scene: Scene, rows: NDArray[np.int64]) -> dict[str, Any]:
    series = {"position": _short(trace.setpoint[rows]), "actual": _short(trace.actual[rows])}
    for name, values in zip(QUANTITIES, trace.derivatives(scene.cycle_s), strict=True):
        series[name] = _short(_extremes(values, rows))
    series["following error"] = _short(_extremes(trace.following_error, rows))
    limits = {
        name: limit if math.isfinite(limit) else None
        for name, limit in zip(QUANTITIES, trace.limits, strict=True)
    }
    return {"name": trace.name, "unit": trace.unit, "series": series, "limits": limits}


def _extremes(values: NDArray[np.float64], rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Of each stretch between rows the value farthest from zero, so that no peak is lost by thinning."""
    if len(rows) == 0:
        return values
    high = np.maximum.reduceat(values, rows)
    low = np.minimum.reduceat(values, rows)
    return np.where(high >= -low, high, low)


def _short(values: NDArray[np.float64]) -> list[float]:
    """Six significant digits are more than a screen shows."""
    return [float(f"{value:.6g}") for value in values.tolist()]
