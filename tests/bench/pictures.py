"""Pictures of the documentation that no command draws: ``python -m tests.bench.pictures NAME FILE.png``."""

from __future__ import annotations

import math
import sys

import matplotlib as mpl
import numpy as np

from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.machine_file import parse_machine
from mcserver.service.target_stream import Now, TargetMessage, TargetStream
from mcserver.simulation.simulation import simulate
from mcserver.simulation.virtual_executor import VirtualExecutor
from mcserver.units import MM
from tests.bench.machines import ideal
from tests.bench.servo_streams import CAPTURE
from tests.executor.test_compensation import BACKLASH, Told, load_of
from tests.executor.test_superimposed import BELT, Picker
from tests.executor.test_superimposed import machine as conveyor_machine
from tests.executor.test_tool_conveyor import Worker
from tests.executor.test_tool_conveyor import begun as coupled
from tests.executor.test_tool_conveyor import machine as arm_beside_belt
from tests.executor.threading_rig import SPINDLE, Turned, lathe

mpl.use("Agg")
from matplotlib import pyplot
from matplotlib.figure import Figure

RINGING = """
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
CIRCLE = "G01 X1 Y1 F3000\nX0 Y0\nG02 X0 Y0 I50 J0\nG02 X0 Y0 I50 J0"
SIZE, TURN = 0.05, 6200
# Cycles between targets, and of the whole picture; where a point is wrong, a step comes, and silence.
PERIOD, CYCLES = 40, 4200
WRONG, LEAP, SILENCE = 1000, 2000, 3400


def shaping() -> Figure:
    """A step without and with a shaper: setpoints and loads of the same step on both machines."""
    figure, (place, near, speed) = pyplot.subplots(
        3, 1, figsize=(10.0, 7.2), sharex=True, layout="constrained"
    )
    for shaper, colour, name in (("", "tab:red", "without"), (EI, "tab:blue", "shaped (EI, 48 Hz)")):
        recorded = simulate(STEP, parse_machine(RINGING.format(shaper=shaper)), record=True).recording
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
    return figure


def backlash() -> Figure:
    """A circle of 100 mm with backlash, and compensated: how far the load is beside it."""
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
    return figure


def threading() -> Figure:
    """A pass of G33 while a load slows the spindle: Z, its distance from the helix, the speed."""
    cell = Turned(lathe(), "G21 G18 G90\nS1000 M3\nG0 X10 Z3\nG33 Z-20 K1.5\nM2")
    begin, end = 700, 850

    def load(cycle: int) -> None:
        if cycle in (begin, end):
            cell.bus.load(SPINDLE, 1500.0 if cycle == begin else 0.0)

    cell.run(load)
    along = cell.path(4)
    z, turns = np.array(cell.rows)[along, 2] / MM, cell.turns[along]
    # the wait for the spindle, at rest, left out
    moves = np.flatnonzero(np.diff(z))
    z, turns = z[moves], turns[moves]
    beside = z - 3.0 + 1.5 * turns
    beside -= 1.5 * round(float(np.median(beside)) / 1.5)
    turns = turns - turns[0]
    figure, (place, error, speed) = pyplot.subplots(
        3, 1, figsize=(8, 7), sharex=True, constrained_layout=True
    )
    place.plot(turns, z)
    place.set_ylabel("Z [mm]")
    error.plot(turns, beside / MM)
    error.set_ylim(-15.0, 15.0)
    error.set_ylabel("Z beside the helix [µm]")
    rpm = np.gradient(turns) * 60e3
    speed.plot(turns, np.convolve(np.pad(rpm, 5, mode="edge"), np.full(11, 1.0 / 11.0), "valid"))
    speed.set_ylabel("spindle [rpm]")
    speed.set_xlabel("turns of the spindle since the pass began")
    return figure


def conveyor() -> Figure:
    """A shape drawn on a belt that moves: on the machine, on the belt, and the axis over time."""
    shape = "G1 X60 Y0\nG3 X60 Y40 I0 J20\nG1 X20 Y40\nG1 X20 Y0\n"
    program = f"{BELT}G1060 P0\nG1 X20 F9000\n{shape}G1061\nM2"
    cell = Picker(conveyor_machine(), program)
    cell.play()
    x, y, belt = cell.setpoints(0) / MM, cell.setpoints(1) / MM, cell.offsets / MM
    (moving,) = np.nonzero(np.diff(y))
    along, end = slice(moving[0] - 350, moving[-1]), moving[-1]
    figure, (plan, time) = pyplot.subplots(
        1, 2, figsize=(11.0, 3.6), layout="constrained", width_ratios=(2, 1)
    )
    plan.plot(x[along], y[along], color="tab:red", label="on the machine")
    plan.plot((x - belt)[along] - (x - belt)[end] + 20.0, y[along], color="tab:blue", label="on the belt")
    plan.set_xlabel("X [mm]")
    plan.set_ylabel("Y [mm]")
    plan.set_aspect("equal")
    plan.legend(fontsize=9, loc="center", bbox_to_anchor=(0.62, 0.6))
    seconds = np.arange(len(x)) * 1e-3
    time.plot(seconds, x, color="tab:red", label="X")
    time.plot(seconds, belt, color="tab:gray", label="belt")
    time.set_xlabel("time [s]")
    time.set_ylabel("place [mm]")
    time.legend(fontsize=9)
    return figure


def arm_conveyor() -> Figure:
    """A shape drawn by an arm on a belt that moves, and what of their limits its joints use."""
    drawn = "G1 X500 Y-150\nG3 X500 Y-110 I0 J20\nG1 X440 Y-110\nG1 X440 Y-150\nG1 X460 Y-150\n"
    made = arm_beside_belt(**{"-150.0, 250.0": "-50.0, 400.0"})
    cell = Worker(made, f"{coupled(600.0, -150.0)}{drawn}G1061\nM2")
    cell.play()
    tip, piece = cell.tip(cell.rows)[0] / MM, cell.tip(cell.ordered)[0] / MM
    (moving,) = np.nonzero(np.abs(np.diff(piece[:, 0])) + np.abs(np.diff(piece[:, 1])))
    shown = slice(int(moving[moving > cell.following.start][0]), cell.following.stop)
    figure, (plan, time) = pyplot.subplots(1, 2, figsize=(11.0, 4.2), layout="constrained")
    plan.plot(tip[shown, 1], tip[shown, 0], color="tab:red", label="the tip")
    on_belt = tip[shown, 1] - (cell.belt[shown] - cell.belt[shown.start]) / MM
    plan.plot(on_belt, tip[shown, 0], color="tab:blue", label="on the belt")
    plan.set_xlabel("Y, along the belt [mm]")
    plan.set_ylabel("X [mm]")
    plan.set_aspect("equal")
    plan.legend(fontsize=9)
    speeds = np.diff(np.array(cell.rows)[:, :6], axis=0) / 1e-3 / cell.whole[0]
    seconds = np.arange(len(speeds)) * 1e-3
    for joint in range(6):
        time.plot(seconds, speeds[:, joint], linewidth=1.0, label=f"joint {joint + 1}")
    time.set_xlim(seconds[cell.following.start] - 0.3, seconds[-1])
    time.set_ylim(-0.25, 0.25)
    time.set_xlabel("time [s]")
    time.set_ylabel("velocity, share of the joint's limit")
    time.legend(fontsize=8, ncols=3)
    return figure


def target_at(cycle: int) -> float | None:
    """Return the target of a cycle [mm]; None: nothing is sent."""
    if cycle % PERIOD or cycle >= SILENCE:
        return None
    if cycle == WRONG:
        return -130.0
    if cycle < LEAP:
        return 60.0 * math.sin(math.pi * cycle * 1e-3)
    return 150.0 - 80.0 * math.sin(math.pi * max(cycle - LEAP - 800, 0) * 1e-3)


def servo() -> Figure:
    """Targets and what follows them."""
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
    return figure


def main(name: str, path: str) -> None:
    """Draw one of them."""
    figures = (servo, shaping, backlash, threading, conveyor, arm_conveyor)
    figure = {each.__name__: each for each in figures}[name]()
    for panel in figure.axes:
        if name != "backlash":
            panel.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
