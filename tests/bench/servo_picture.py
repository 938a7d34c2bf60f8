"""Draw targets and what follows them: ``python -m tests.bench.servo_picture docs/images/servo.png``."""

from __future__ import annotations

import math
import sys

import matplotlib as mpl
import numpy as np

from mcserver.executor.entries import Control, ControlKind
from mcserver.service.target_stream import Now, TargetMessage, TargetStream
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.bench.machines import ideal
from tests.bench.servo_streams import CAPTURE

# Cycles between targets, and of the whole picture; where a point is wrong, a step comes, and silence.
PERIOD, CYCLES = 40, 4200
WRONG, STEP, SILENCE = 1000, 2000, 3400


def target_at(cycle: int) -> float | None:
    """Return the target of a cycle [mm]; None: nothing is sent."""
    if cycle % PERIOD or cycle >= SILENCE:
        return None
    if cycle == WRONG:
        return -130.0
    if cycle < STEP:
        return 60.0 * math.sin(math.pi * cycle * 1e-3)
    return 150.0 - 80.0 * math.sin(math.pi * max(cycle - STEP - 800, 0) * 1e-3)


def main() -> None:
    """Play the stream and draw it."""
    mpl.use("Agg")
    from matplotlib import pyplot

    machine = ideal(axes=1, velocity=400.0, acceleration=4000.0, jerk=40_000.0)
    executor, stream = VirtualExecutor(machine), TargetStream(machine.axes, machine.cycle_s)
    ring = executor.open_slot(0)
    for kind in (ControlKind.AXIS, ControlKind.FOLLOW, ControlKind.FINISH):
        ring.put_control(Control(kind, 0.0, 0, axes=1, operation=CAPTURE))
    executor.step()
    setpoints, sent = np.zeros(CYCLES), []
    for cycle in range(CYCLES):
        target, now = target_at(cycle), executor.executor.time
        if target is not None:
            message = TargetMessage(cycle // PERIOD + 1, now, 0.12, np.array([[target * 1e-3]]), None, None)
            taken = stream.take(message, Now(now))
            sent.append((cycle * 1e-3, target, taken is not None))
            if taken is not None:
                ring.targets.put(taken)
        executor.step()
        setpoints[cycle] = executor.executor.row.setpoint[0] * 1e3
    executor.close()
    time_s = (np.arange(CYCLES) + 1) * 1e-3
    figure, (place, speed) = pyplot.subplots(
        2, 1, figsize=(10.0, 5.6), sharex=True, height_ratios=(2.0, 1.0), layout="constrained"
    )
    for counts, colour, name in (
        (True, "tab:blue", "targets, 25 Hz"),
        (False, "tab:red", "dropped (jumped)"),
    ):
        points = [(at, value) for at, value, each in sent if each is counts]
        place.plot(*zip(*points, strict=True), ".", color=colour, markersize=5, label=name)
    place.plot(time_s, setpoints, color="black", linewidth=1.2, label="setpoint, 1 kHz")
    place.axvline(SILENCE * 1e-3, color="grey", linestyle=":", label="silence from here")
    place.set_ylabel("position [mm]")
    place.legend(loc="lower left", fontsize=9)
    speed.plot(time_s[1:], np.diff(setpoints) / 1e-3, color="black", linewidth=1.0)
    for limit in (-400.0, 400.0):
        speed.axhline(limit, color="tab:red", linewidth=0.8)
    speed.set_ylabel("velocity [mm/s]")
    speed.set_xlabel("time [s]")
    for panel in (place, speed):
        panel.grid(alpha=0.3)
    figure.savefig(sys.argv[1], dpi=110)


if __name__ == "__main__":
    main()
