"""Colours and type of the pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

INK = "#1c2733"
FAINT_INK = "#66727f"
GRID = "#e4e8ec"
PAPER = "#ffffff"
LIMIT = "#c2334d"
ACTUAL = "#1c2733"

# Paul Tol's "bright" and "muted" hues, distinguishable by colour-blind readers too
LINE_COLOURS = (
    "#4477aa",
    "#ee6677",
    "#228833",
    "#aa3377",
    "#66ccee",
    "#ccbb44",
    "#332288",
    "#cc6677",
    "#44aa99",
    "#999933",
    "#882255",
    "#88ccee",
)

STYLE: Mapping[str, Any] = MappingProxyType(
    {
        "figure.facecolor": PAPER,
        "axes.facecolor": PAPER,
        "axes.edgecolor": GRID,
        "axes.labelcolor": FAINT_INK,
        "axes.titlecolor": INK,
        "axes.titlelocation": "left",
        "axes.titlesize": 10.5,
        "axes.titleweight": "bold",
        "axes.labelsize": 9,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "grid.color": GRID,
        "grid.linewidth": 0.8,
        "xtick.color": FAINT_INK,
        "ytick.color": FAINT_INK,
        "xtick.labelsize": 8.5,
        "ytick.labelsize": 8.5,
        "text.color": INK,
        "font.family": "DejaVu Sans",
        "legend.frameon": False,
        "legend.fontsize": 8.5,
        "lines.solid_capstyle": "round",
        "lines.solid_joinstyle": "round",
    }
)


def colours_of(lines: Sequence[int]) -> dict[int, str]:
    """Return a colour for each line of the program, neighbours distinguishable; 0 (no line runs) is faint."""
    colours = {
        number: LINE_COLOURS[order % len(LINE_COLOURS)]
        for order, number in enumerate(sorted(set(lines) - {0}))
    }
    colours[0] = "#b6bec6"
    return colours
