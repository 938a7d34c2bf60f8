"""What shapers leave of a vibration over its frequency, and the ring that it was measured by: a picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, BinaryIO

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mcserver.executor.entries import Array
from mcserver.machine.shaper_section import RESIDUAL
from mcserver.plot.theme import LIMIT, LINE_COLOURS, STYLE
from mcserver.simulation.resonance import Resonance, ShaperCost

DOTS_PER_INCH = 110
# Frequencies that are drawn, as shares of the measured one.
FROM, TO = 0.5, 1.5


def draw_resonance(
    found: Resonance, costs: Sequence[ShaperCost], ring: Array, step_s: float, stream: BinaryIO, title: str
) -> None:
    """Draw as PNG; ``ring``: shape (n,), in units of its own."""
    style: Any = dict(STYLE)
    with mpl.rc_context(style):
        figure = Figure(figsize=(11.0, 5.6))
        FigureCanvasAgg(figure)
        figure.set_layout_engine("constrained")
        figure.suptitle(title, x=0.01, ha="left", fontsize=13, fontweight="bold")
        over_time, over_frequency = figure.subplots(2, 1, height_ratios=(1.0, 1.6))
        over_time.plot(np.arange(len(ring)) * step_s, ring, color=LINE_COLOURS[0], linewidth=1.1)
        over_time.set_title(f"{found.frequency_hz:.2f} Hz, damping {found.damping:.4f}")
        over_time.set_xlabel("time [s]")
        frequencies = np.linspace(FROM, TO, 201) * found.frequency_hz
        for order, cost in enumerate(costs):
            left = [100.0 * cost.shaper.residual(each, found.damping) for each in frequencies.tolist()]
            path, stop = 1e3 * cost.delay_s, 1e3 * cost.length_s
            name = f"{cost.shaper.type}: path {path:.0f} ms, stop {stop:.0f} ms later"
            over_frequency.plot(frequencies, left, color=LINE_COLOURS[order % len(LINE_COLOURS)], label=name)
        over_frequency.axhline(100.0 * RESIDUAL, color=LIMIT, linewidth=0.9, linestyle=(0, (4, 3)))
        over_frequency.set_title("residual vibration [%]")
        over_frequency.set_xlabel("frequency of the axis [Hz]")
        over_frequency.set_ylim(0.0, 60.0)
        over_frequency.legend(loc="upper center", fontsize=8)
        figure.savefig(stream, format="png", dpi=DOTS_PER_INCH, metadata={"Software": "mcserver resonance"})
