"""Draw a step without and with a shaper: ``python -m tests.bench.shaping_picture FILE.png``."""

from __future__ import annotations

import sys

import matplotlib as mpl

from mcserver.machine.machine_file import parse_machine
from mcserver.simulation.simulation import simulate

MACHINE = """
[machine]
name = "ringing"
[motion]
path_tolerance_mm = 1.0
[[axis]]
index = 0
type = "linear"
max_velocity = 300.0
max_acceleration = 5000.0
max_jerk = 1000000.0
{shaper}
[axis.drive]
flexible_hz = 48.0
flexible_damping = 0.03
bandwidth_hz = 150.0
"""
STEP = "G90 G94 G61\nG1010\nG01 X20 F18000\nG04 P0.3\nM02"
EI = 'shaper = { type = "ei", frequency_hz = 48.0, damping = 0.03 }'


def main() -> None:
    """Simulate the same step on both machines, and draw setpoints and loads."""
    mpl.use("Agg")
    from matplotlib import pyplot

    figure, (place, near, speed) = pyplot.subplots(
        3, 1, figsize=(10.0, 7.2), sharex=True, layout="constrained"
    )
    for shaper, colour, name in (("", "tab:red", "without"), (EI, "tab:blue", "shaped (EI, 48 Hz)")):
        recorded = simulate(STEP, parse_machine(MACHINE.format(shaper=shaper)), record=True).recording
        assert recorded is not None
        at, setpoint, load = recorded.time_s, recorded.setpoint[:, 0], recorded.actual[:, 0]
        place.plot(at, setpoint, color=colour, linewidth=1.0, linestyle="--")
        place.plot(at, load, color=colour, linewidth=1.2, label=name)
        near.plot(at, load - 20.0, color=colour, linewidth=1.2)
        speed.plot(at[1:], (setpoint[1:] - setpoint[:-1]) / 1e-3, color=colour, linewidth=1.0)
    place.set_ylabel("setpoint (dashed), load [mm]")
    place.set_xlim(0.0, 0.35)
    place.legend(loc="lower right", fontsize=9)
    near.set_ylim(-0.06, 0.06)
    near.set_ylabel("load beside the target [mm]")
    speed.set_ylabel("velocity of the setpoint [mm/s]")
    speed.set_xlabel("time [s]")
    for panel in (place, near, speed):
        panel.grid(alpha=0.3)
    figure.savefig(sys.argv[1], dpi=110)


if __name__ == "__main__":
    main()
