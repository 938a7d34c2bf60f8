"""Random programs of an arm's tool as text: points and turns, chords, arcs, G93 and G94, every tolerance.

Judged at the joints, whose limits hold at every cycle, and at the tip, by forward kinematics of its own: F,
the path within the tolerance, and the end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import msgspec
import numpy as np

from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.motion.geometry.curves import Array
from mcserver.simulation.simulation import simulate
from tests.bench.override import Run, play
from tests.bench.text_programs import orders_of
from tests.golden.urdf_tips import tips
from tests.limits import broken_limits, limits_of
from tests.motion.measure import VELOCITY_SLACK

START = np.array([460.0, 0.0, 675.0])
# Where the points of a program are [mm], and the angles A B C at most [degrees].
LEAST, MOST, MOST_TURN = np.array([340.0, -220.0, 430.0]), np.array([560.0, 220.0, 720.0]), 25.0
CIRCLE_CHORDS = 720
LENGTHS = (0.05, 1.0, 8.0, 60.0)
CHORDS = (0.1, 0.5, 2.0)
TOLERANCES = (0.02, 0.1, 1.0)
# What inverse kinematics may be away from the path [mm], and what the bow between two cycles adds.
SOLVED = 0.012
OUT_OF_REACH = "MC303"


class _Writer:
    """Writes a program, and keeps account of the tip's points."""

    def __init__(self, rng: np.random.Generator, tolerance: float) -> None:
        self._rng = rng
        self.here, self.turned = START.copy(), np.zeros(3)
        self.lines = [f"T1 G64 P{tolerance}"]
        # of each line that moves, from line 2 on, behind G1010: chords of its path; and F [mm/s] or T [s]
        self.paths: dict[int, list[tuple[Array, Array]]] = {}
        self.feeds: dict[int, float] = {}
        self.times: dict[int, float] = {}
        self._timed = False

    def _line(self, code: str, length: float, words: str, target: Array) -> None:
        """One line of a length [mm]; G93 where the section asks for times."""
        speed = float(self._rng.choice([2.0, 30.0, 200.0, 1000.0]))
        number = len(self.lines) + 2
        if self._timed:
            minutes = max(length / speed, 0.004) / 60.0
            feed = f"F{1.0 / minutes:.4f}"
            self.times[number] = 60.0 / float(feed[1:])
        else:
            feed = f"F{60.0 * speed:g}"
            self.feeds[number] = speed
        self.lines.append(f"{code} {words} {feed}")
        if code == "G01":
            self.paths[number] = [(self.here.copy(), target.copy())]
        self.here = target

    def _words(self, target: Array) -> str:
        return " ".join(f"{name}{value:.4f}" for name, value in zip("XYZ", target.tolist(), strict=True))

    def _turn(self) -> str:
        self.turned = np.clip(self.turned + self._rng.normal(size=3) * 6.0, -MOST_TURN, MOST_TURN)
        return " ".join(f"{name}{value:.3f}" for name, value in zip("ABC", self.turned.tolist(), strict=True))

    def walk(self) -> None:
        """Points about the box, straight on or about corners, with turns or without."""
        length, turns = float(self._rng.choice(LENGTHS)), self._rng.random() < 0.5
        along = self._rng.normal(size=3)
        for _ in range(int(self._rng.integers(1, 8))):
            along = self._rng.normal(size=3) if self._rng.random() < 0.5 else along
            step = length * along / np.linalg.norm(along)
            target = np.round(np.clip(self.here + step, LEAST, MOST), 4)
            travel = float(np.linalg.norm(target - self.here))
            if travel < 1e-3:
                continue
            self._line("G01", travel, f"{self._words(target)} {self._turn() if turns else ''}", target)

    def chords(self) -> None:
        """Chords of a circle in a plane of its own."""
        count, chord = int(self._rng.integers(4, 30)), float(self._rng.choice(CHORDS))
        radius = float(self._rng.choice([4.0, 25.0]))
        frame = np.linalg.qr(self._rng.normal(size=(3, 3)))[0]
        origin, turned = self.here.copy(), self._rng.random() < 0.3
        for index in range(1, count + 1):
            angle = index * chord / radius
            target = origin + radius * (math.sin(angle) * frame[0] + (1.0 - math.cos(angle)) * frame[1])
            target = np.round(target, 4)
            travel = float(np.linalg.norm(target - self.here))
            if (target < LEAST - 60.0).any() or (target > MOST + 30.0).any():
                return
            self._line("G01", travel, f"{self._words(target)} {self._turn() if turned else ''}", target)

    def circle(self) -> None:
        """A full circle in the plane XY."""
        radius = float(self._rng.choice([3.0, 20.0]))
        turn = np.linspace(0.0, 2.0 * math.pi, CIRCLE_CHORDS + 1)[:, None]
        points = self.here + radius * np.hstack((1.0 - np.cos(turn), np.sin(turn), 0.0 * turn))
        self.paths[len(self.lines) + 2] = list(itertools.pairwise(points))
        self._line("G17 G02", 2.0 * math.pi * radius, f"I{radius} J0", self.here.copy())

    def write(self, sections: int) -> None:
        for _ in range(sections):
            self._timed = bool(self._rng.random() < 0.35)
            self.lines.append("G93" if self._timed else "G94")
            kinds = (self.walk, self.walk, self.chords, self.circle)
            kinds[int(self._rng.integers(len(kinds)))]()


def tool_program_of(seed: int) -> tuple[Machine, _Writer, float]:
    """The machine of a seed, its program, and the path tolerance [mm]."""
    rng = np.random.default_rng((seed, 6))
    machine = load_machine("arm6")
    slower, softer = float(rng.choice([1.0, 0.3])), float(rng.choice([1.0, 0.2, 10.0]))
    axes = tuple(
        msgspec.structs.replace(
            axis,
            max_velocity=axis.max_velocity * slower,
            max_acceleration=axis.max_acceleration * slower,
            max_jerk=axis.max_jerk * softer,
        )
        for axis in machine.axes
    )
    tolerance = float(rng.choice(TOLERANCES))
    writer = _Writer(rng, tolerance)
    writer.write(int(rng.integers(1, 5)))
    return msgspec.structs.replace(machine, axes=axes), writer, tolerance


def broken_laws_of_tools(seed: int, *, orders: bool) -> tuple[list[str], int, int]:
    """Name the laws that the program of a seed breaks; and return its lines and cycles.

    Args:
        orders: play it beside a planner that works meanwhile, under overrides of 0 to 200 %.
    """
    machine, program, tolerance = tool_program_of(seed)
    kinematics = build_kinematics(machine)
    text = "\n".join(["G1010", *program.lines])
    refused = [each.code for each in check_program(text, machine, kinematics=kinematics)]
    if OUT_OF_REACH in refused:
        # a point that the arm does not come to
        return [], 0, 0
    if orders:
        given, every = orders_of(seed)
        run = play(machine, program.lines, given, every=every, kinematics=kinematics)
        broken = _broken_limits(machine, run, program.here)
        if run.faults:
            broken.append(f"{run.faults} faults")
        return broken, len(program.lines), len(run.setpoint)
    found = simulate(text, machine, kinematics=kinematics, record=True)
    if found.exit_code or found.recording is None:
        return [f"refused: {found.report['diagnostics'][:1]}"], 0, 0
    joints = np.radians(found.recording.setpoint)
    broken = _broken_limits(machine, Run(joints, 0.0, [], 0, np.empty(0), 0), program.here)
    points = 1e3 * tips("arm6.urdf", "tip", joints)[0]
    lines = {line["line"]: line for line in found.report["lines"]}
    cycle = machine.cycle_s
    for number, line in lines.items():
        start, end = line["start_s"] / cycle, line["end_s"] / cycle
        rows = points[math.ceil(start - 1e-6) : math.floor(end + 1e-6) + 1]
        speed, took = program.feeds.get(number), program.times.get(number)
        if speed is not None and len(rows) > 1:
            fastest = float(np.linalg.norm(np.diff(rows, axis=0), axis=1).max()) / cycle / speed
            if fastest > VELOCITY_SLACK:
                broken.append(f"F {fastest:.6g} > {VELOCITY_SLACK} in line {number}")
        if took is not None:
            late = line["end_s"] - line["start_s"] - took
            if late < -cycle:
                broken.append(f"line {number} ends {-late:.6g} s before its T of {took:.6g}")
            if late > cycle and line["bound_by"] is None:
                broken.append(f"line {number} ends {late:.6g} s after its T of {took:.6g}, unbound")
        if number in program.paths:
            # a corner is rounded between the paths of both its lines
            moves = list(program.paths)
            at = moves.index(number)
            parts = [part for each in moves[max(at - 1, 0) : at + 2] for part in program.paths[each]]
            away = _farthest(rows, parts)
            if away > tolerance + SOLVED:
                broken.append(f"line {number} is left by {away:.6g} mm > {tolerance}")
    return broken, len(program.lines), len(joints)


def _farthest(points: Array, parts: Sequence[tuple[Array, Array]]) -> float:
    """Return the greatest distance of points from the nearest of some lines [mm]."""
    if not len(points):
        return 0.0
    nearest = np.full(len(points), math.inf)
    for start, end in parts:
        way = end - start
        share = np.clip((points - start) @ way / float(way @ way), 0.0, 1.0)
        nearest = np.minimum(nearest, np.linalg.norm(points - start - share[:, None] * way, axis=1))
    return float(nearest.max())


def _broken_limits(machine: Machine, run: Run, end: Array) -> list[str]:
    """Name the limits of the joints that setpoints pass, and a tip that is not where the program ends."""
    broken = broken_limits(run.setpoint, limits_of(machine), machine.cycle_s)
    away = float(np.linalg.norm(1e3 * tips("arm6.urdf", "tip", run.setpoint[-1:])[0][0] - end))
    if away > SOLVED:
        broken.append(f"the end is missed by {away:.3g} mm")
    return broken
