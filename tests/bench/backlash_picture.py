"""Draw a circle with backlash: ``python -m tests.bench.backlash_picture docs/images/backlash.png``."""

from __future__ import annotations

import sys

import matplotlib as mpl
import numpy as np

from tests.executor.test_compensation import BACKLASH, Told, load_of

CIRCLE = "G01 X1 Y1 F3000\nX0 Y0\nG02 X0 Y0 I50 J0\nG02 X0 Y0 I50 J0"
SIZE, TURN = 0.05, 6200


def main() -> None:
    """Play a circle of 100 mm on both machines, and draw how far the load is beside it."""
    mpl.use("Agg")
    from matplotlib import pyplot

    figure, panel = pyplot.subplots(
        figsize=(7.0, 6.4), subplot_kw={"projection": "polar"}, layout="constrained"
    )
    for axis, colour, name in (
        ("", "tab:red", "backlash of 20 µm"),
        ("compensation = { backlash = 0.02 }", "tab:blue", "compensated"),
    ):
        load = load_of(Told(CIRCLE, axis).play().told, BACKLASH)[-TURN:]
        away = np.hypot(load[:, 0] - SIZE, load[:, 1]) - SIZE
        panel.plot(
            np.arctan2(load[:, 1], load[:, 0] - SIZE), 1e6 * away, color=colour, linewidth=1.2, label=name
        )
    panel.set_rlim(-40.0, 20.0)
    panel.set_rticks([-20.0, -10.0, 0.0, 10.0])
    panel.set_title("load beside a circle of 100 mm at 50 mm/s [µm]")
    panel.legend(loc="lower left")
    figure.savefig(sys.argv[1], dpi=110)


if __name__ == "__main__":
    main()
