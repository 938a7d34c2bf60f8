"""A picture of a simulated run, as SVG: its path from above and from the front, and its axes over time.

It holds numbers and axis letters only: nothing that whoever wrote the program could put into a page.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

LETTERS = "XYZABC"
# what counts as motion [mm or deg]
STILL = 1e-6
MAX_CHARTS = 12
CHART_POINTS = 400
WIDTH, MARGIN, GAP = 720, 16, 24
VIEW_WIDTH, VIEW_HEIGHT = 320, 240
CHART_HEIGHT = 46
COLOURS = ("#1d4ed8", "#b45309", "#047857", "#7c3aed")
START, END = "#15803d", "#b91c1c"

Track = Sequence[Sequence[float]]


class Box(NamedTuple):
    """A rectangle of the picture [px]."""

    left: float
    top: float
    width: float
    height: float


def axis_label(index: int) -> str:
    """``X`` for axis 0, ``[7]`` where there is no letter, as programs write them."""
    return LETTERS[index] if index < len(LETTERS) else f"[{index}]"


def run_picture(preview: Mapping[str, Any]) -> str:
    """Draw a run.

    Args:
        preview: the map of a `RunPreviewReply`.

    Returns:
        SVG, with a description for who does not see it.
    """
    run, path = preview["run"], preview["path"]
    times = [float(each) for each in path["time_s"]]
    positions = {
        int(axis): [float(value) for value in values]
        for axis, values in zip(run["axes"], path["positions"], strict=False)
        if len(values) == len(times) > 0
    }
    extents = {int(each["axis"]): each for each in run["extents"]}
    tracks = _tracks(positions, path["tools"], len(times))
    views = _views(tracks)
    moving = [axis for axis, each in extents.items() if each["high"] - each["low"] > STILL]
    charts = [axis for axis in moving if axis in positions][:MAX_CHARTS]
    parts: list[str] = []
    for row, (across, up) in enumerate(views):
        top = MARGIN + row * (VIEW_HEIGHT + GAP)
        box = Box(MARGIN, top, VIEW_WIDTH, VIEW_HEIGHT)
        parts += _view(tracks, across, up, box)
    left = MARGIN + VIEW_WIDTH + GAP if views else MARGIN
    for row, axis in enumerate(charts):
        box = Box(left, MARGIN + row * CHART_HEIGHT, WIDTH - MARGIN - left, CHART_HEIGHT - 18)
        parts += _chart(axis, times, positions[axis], extents[axis], box)
    below = MARGIN + len(charts) * CHART_HEIGHT
    note = f"{float(run['duration_s']):.3f} s"
    if len(moving) > len(charts):
        note += f"; {len(moving) - len(charts)} further axes move"
    parts.append(_text(left, below + 12, note))
    height = max(below + 20, MARGIN + len(views) * (VIEW_HEIGHT + GAP)) + MARGIN
    description = ", ".join(
        f"{axis_label(axis)} {extents[axis]['low']:.3f} to {extents[axis]['high']:.3f}" for axis in moving
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" width="{WIDTH}" '
        f'height="{height:g}" style="max-width:100%;height:auto" '
        'role="img" font-family="sans-serif" font-size="12">'
        f"<title>Simulated run: {description or 'nothing moves'}</title>"
        f'<rect width="100%" height="100%" fill="#ffffff"/>{"".join(parts)}</svg>\n'
    )


def _tracks(positions: Mapping[int, Sequence[float]], tools: Iterable[Any], moments: int) -> list[Track]:
    """X, Y and Z of what travels in space: the tools, or the axes X Y Z."""
    tracks = [each["position"] for each in tools if all(len(row) == moments for row in each["position"])]
    still = [0.0] * moments
    return tracks or [[positions.get(axis, still) for axis in range(3)]]


def _views(tracks: Sequence[Track]) -> list[tuple[int, int]]:
    """Pairs of directions in which the path has a form: from above first."""
    moves = [any(row and max(row) - min(row) > STILL for row in rows) for rows in zip(*tracks, strict=True)]
    return [pair for pair in ((0, 1), (0, 2), (1, 2)) if moves[pair[0]] and moves[pair[1]]][:2]


def _view(tracks: Sequence[Track], across: int, up: int, box: Box) -> list[str]:
    """Return the paths seen along one direction, at one scale both ways."""
    rows = [(track[across], track[up]) for track in tracks]
    low = [min(min(row[at]) for row in rows) for at in (0, 1)]
    high = [max(max(row[at]) for row in rows) for at in (0, 1)]
    inner = Box(box.left + 44, box.top + 8, box.width - 52, box.height - 44)
    scale = min(inner.width / (high[0] - low[0]), inner.height / (high[1] - low[1]))
    width, height = scale * (high[0] - low[0]), scale * (high[1] - low[1])
    left, bottom = inner.left + (inner.width - width) / 2, inner.top + (inner.height + height) / 2
    parts = [_frame(Box(left, bottom - height, width, height))]
    for number, (right, upward) in enumerate(rows):
        points = [
            (left + scale * (x - low[0]), bottom - scale * (y - low[1]))
            for x, y in zip(right, upward, strict=True)
        ]
        parts += [_line(points, COLOURS[number % len(COLOURS)]), *_ends(points)]
    names = f"{LETTERS[across]} {low[0]:.3f} … {high[0]:.3f} mm"
    parts.append(_text(left, bottom + 16, names))
    parts.append(_text(left, bottom + 30, f"{LETTERS[up]} {low[1]:.3f} … {high[1]:.3f} mm (up)"))
    return parts


def _chart(
    axis: int, times: Sequence[float], values: Sequence[float], extent: Mapping[str, Any], box: Box
) -> list[str]:
    """One axis over time, between the extents of every cycle."""
    low, high = float(extent["low"]), float(extent["high"])
    unit = "deg" if extent["unit"] == "deg" else "mm"
    until = times[-1] or 1.0
    step = max(1, len(times) // CHART_POINTS)
    kept = [*range(0, len(times) - 1, step), len(times) - 1]
    points = [
        (
            box.left + box.width * times[at] / until,
            box.top + 14 + box.height * (high - values[at]) / (high - low),
        )
        for at in kept
    ]
    label = f"{axis_label(axis)} {low:.3f} … {high:.3f} {unit}"
    return [
        _text(box.left, box.top + 10, label),
        _frame(Box(box.left, box.top + 14, box.width, box.height)),
        _line(points, COLOURS[0]),
    ]


def _frame(box: Box) -> str:
    return (
        f'<rect x="{box.left:.1f}" y="{box.top:.1f}" width="{box.width:.1f}" height="{box.height:.1f}" '
        'fill="none" stroke="#9ca3af" stroke-dasharray="3 3"/>'
    )


def _line(points: Iterable[tuple[float, float]], colour: str) -> str:
    placed = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return (
        f'<polyline points="{placed}" fill="none" stroke="{colour}" stroke-width="1.5" '
        'stroke-linejoin="round"/>'
    )


def _ends(points: Sequence[tuple[float, float]]) -> list[str]:
    (begin_x, begin_y), (end_x, end_y) = points[0], points[-1]
    return [
        f'<circle cx="{begin_x:.1f}" cy="{begin_y:.1f}" r="5" fill="none" stroke="{START}" '
        'stroke-width="2"/>',
        f'<rect x="{end_x - 3.5:.1f}" y="{end_y - 3.5:.1f}" width="7" height="7" fill="{END}"/>',
    ]


def _text(x: float, y: float, words: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" fill="#111827">{words}</text>'
