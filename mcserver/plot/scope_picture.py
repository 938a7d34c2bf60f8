"""A scope's trace as a picture: signals of a unit together, the following error by itself."""

from __future__ import annotations

from typing import Any, BinaryIO

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mcserver.canopen.scope import FOLLOWING_ERROR, ScopeTrace
from mcserver.plot.theme import FAINT_INK, LIMIT, LINE_COLOURS, STYLE

WIDTH, ROW, HEAD = 11.0, 1.9, 0.9
DOTS_PER_INCH = 110
# Words and states without a unit, each in a row of its own; those that stay the same have none.
MOST_PLAIN_ROWS = 4


def draw_scope(trace: ScopeTrace, stream: BinaryIO, title: str) -> None:
    """Draw a trace as PNG, over the time from the trigger on [s]."""
    rows = panels_of(trace)
    style: Any = dict(STYLE)
    with mpl.rc_context(style):
        height = HEAD + ROW * len(rows)
        figure = Figure(figsize=(WIDTH, height))
        FigureCanvasAgg(figure)
        figure.set_layout_engine("constrained")
        figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold")
        panels = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
        for panel, (name, columns) in zip(panels, rows, strict=True):
            for order, column in enumerate(columns):
                values = trace.values[:, column]
                # commands first and below: the reading lies on them
                panel.plot(
                    trace.time_s,
                    values,
                    color=LINE_COLOURS[order % len(LINE_COLOURS)],
                    linewidth=1.1,
                    label=trace.names[column],
                    drawstyle="default" if trace.units[column] else "steps-post",
                )
            panel.axvline(0.0, color=LIMIT, linewidth=0.9, linestyle=(0, (4, 3)))
            panel.set_title(name)
            panel.margins(x=0.01)
            if len(columns) > 1:
                panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(columns), fontsize=8)
            else:
                peak = float(np.nanmax(np.abs(trace.values[:, columns[0]])))
                panel.set_title(
                    f"peak {peak:.4g}", loc="right", fontsize=8, fontweight="normal", color=FAINT_INK
                )
        panels[-1].set_xlabel("time from the trigger [s]")
        figure.savefig(
            stream, format="png", dpi=DOTS_PER_INCH, metadata={"Software": "mcserver drives scope"}
        )


def panels_of(trace: ScopeTrace) -> list[tuple[str, list[int]]]:
    """Title and columns of each row; columns in which nothing ever came have none."""
    seen = [at for at in range(len(trace.names)) if np.isfinite(trace.values[:, at]).any()]
    found: list[tuple[str, list[int]]] = []
    units = list(dict.fromkeys(trace.units[at] for at in seen if trace.units[at]))
    for unit in units:
        together = [at for at in seen if trace.units[at] == unit and trace.names[at] != FOLLOWING_ERROR]
        if together:
            name = trace.names[together[0]] if len(together) == 1 else _common_name(unit)
            found.append((f"{name} [{unit}]", together))
    found += [
        (f"Following error [{trace.units[at]}]", [at]) for at in seen if trace.names[at] == FOLLOWING_ERROR
    ]
    plain = [at for at in seen if not trace.units[at] and _varies(trace, at)]
    return found + [(trace.names[at], [at]) for at in plain[:MOST_PLAIN_ROWS]]


def _common_name(unit: str) -> str:
    return {"mm": "Position", "deg": "Position", "N·m": "Torque", "‰": "Torque"}.get(unit, "Velocity")


def _varies(trace: ScopeTrace, column: int) -> bool:
    values = trace.values[:, column]
    known = values[np.isfinite(values)]
    return bool(known.size and np.ptp(known) > 0.0)
