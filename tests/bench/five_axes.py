"""The flank of an S-shaped wall on five axes, led by the tip, beside the least time for the path itself.

In the manner of the S-shaped test piece of ISO 10791-7: a ruled surface between two S-shaped rails, whose
tilt changes on the way. The rails are curves of this file, not those of the standard.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from tests.bench.analytic import least_time
from tests.bench.figures import Figure
from tests.simulation.five_axes import LENGTH, LIMITS, TABLE_TABLE, Array

TOLERANCE = 0.02
ZERO = (0.0, 0.0, -300.0)
# rails at the foot and at the top of the wall, 30 mm above it [mm]
FOOT = ((-45, -60), (10, -66), (48, -45), (38, -12), (0, 0), (-38, 12), (-48, 45), (-10, 66), (45, 60))
TOP = ((-46, -64), (11, -71), (54, -47), (42, -9), (2, 5), (-34, 16), (-43, 43), (-8, 61), (46, 56))
HEIGHT = 30.0
DENSE = 20_001


def measure() -> list[Figure]:
    """Chords of 0.5 and 1 mm at 3 and 6 m/min, with a jerk limit."""
    return [_figure(chord, feed) for chord in (0.5, 1.0) for feed in (50.0, 100.0)]


def _figure(chord: float, feed: float) -> Figure:
    from mcserver.machine.machine_kinematics import build_kinematics
    from mcserver.simulation.simulation import simulate

    tips, turns = wall()
    with tempfile.TemporaryDirectory() as folder:
        machine = TABLE_TABLE.machine(Path(folder), tolerance=TOLERANCE)
        kinematics = build_kinematics(machine)
    found = simulate(program(tips, turns, chord, feed), machine, kinematics=kinematics, record=True)
    assert found.report["ok"], found.report["diagnostics"]
    assert found.recording is not None
    cutting = found.recording.line > 5
    positions = {axis.index: found.recording.setpoint[:, at] for at, axis in enumerate(machine.axes)}
    reached = TABLE_TABLE.tip(positions)[cutting] - _origin()
    off = max(float(np.linalg.norm(tips - point, axis=1).min()) for point in reached[::7])
    jerk = max(
        float(np.abs(np.diff(values[cutting], 3)).max()) * 1e9 / LIMITS["rotary" if axis > 2 else "linear"][2]
        for axis, values in positions.items()
    )
    what = f"{chord:g} mm, {feed:g} mm/s: tip off {1e3 * off:.1f} µm, jerk {100.0 * jerk:.0f} %"
    took = float(cutting.sum()) * machine.cycle_s
    return Figure(what, took, "s", bound(tips, turns, feed), "the path, by linear programs", "≤ 1.10 ×")


def wall() -> tuple[Array, Array]:
    """Places of the tip along the foot, shape (n, 3) [mm]; A and C, cutter along the wall, (n, 2) [deg]."""
    share = np.linspace(0.0, 1.0, len(FOOT))
    t = np.linspace(0.0, 1.0, DENSE)
    foot, top = (make_interp_spline(share, np.array(rail, dtype=float), k=5)(t) for rail in (FOOT, TOP))
    tips = np.column_stack((foot, np.full(len(t), 20.0)))
    along = np.column_stack((top - foot, np.full(len(t), HEIGHT)))
    x, y, z = (along / np.linalg.norm(along, axis=1)[:, None]).T
    # the cutter's direction on the table is (sin C sin A, -cos C sin A, cos A)
    turns = np.column_stack((np.degrees(np.arccos(z)), np.degrees(np.unwrap(np.arctan2(x, -y)))))
    return tips, turns


def program(tips: Array, turns: Array, chord: float, feed: float) -> str:
    """Chords along the wall."""
    along = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(tips, axis=0), axis=1))))
    at = np.linspace(0.0, along[-1], round(along[-1] / chord) + 1)
    rows = np.column_stack([np.interp(at, along, column) for column in (*tips.T, *turns.T)])
    lines = ["X{:.4f} Y{:.4f} Z{:.4f} A{:.4f} C{:.4f}".format(*row) for row in rows]
    zero = " ".join(f"{letter}{value:g}" for letter, value in zip("XYZ", ZERO, strict=True))
    head = [
        f"G10 L2 P1 {zero}",
        "G54 G64",
        "G43.4 H1",
        f"F{60.0 * feed:g}",
        f"G0 {lines[0]}",
        f"G1 {lines[1]}",
    ]
    return "\n".join([*head, *lines[2:]])


def bound(tips: Array, turns: Array, feed: float) -> float:
    """Least time along the wall under F at the tip and the limits of all axes [s]."""
    positions = TABLE_TABLE.axes_at(tips + _origin(), {3: turns[:, 0], 5: turns[:, 1]})
    (speed, acceleration, jerk), rotary = LIMITS["linear"], LIMITS["rotary"]
    # in units of which all axes have the limits of a linear one: their ratios are the same
    assert rotary[2] / rotary[1] == jerk / acceleration
    scaled = np.column_stack(
        [q * (acceleration / rotary[1] if axis > 2 else 1.0) for axis, q in positions.items()]
    )
    tip, joints = (np.linalg.norm(np.gradient(each, axis=0), axis=1) for each in (tips, scaled))
    fastest = np.full(len(tips), np.inf)
    for axis, q in positions.items():
        top = rotary[0] if axis > 2 else speed
        fastest = np.minimum(fastest, top / np.maximum(np.abs(np.gradient(q)), 1e-12))
    return least_time(scaled, joints * np.minimum(fastest, feed / tip), acceleration, jerk)


def _origin() -> Array:
    still = {axis: np.array([place]) for axis, place in enumerate((*ZERO, 0.0, 0.0, 0.0))}
    return np.asarray(TABLE_TABLE.tip(still)[0] + np.array([0.0, 0.0, LENGTH]))
