"""Random programs as text: units, planes, increments, comma lines, concatenations, stops, dwells and rapids.

The writer keeps its own account of where the program is, so that its end is known from outside.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mcserver.machine.machine_file import Machine
from mcserver.motion.geometry.curves import Array
from tests.motion.support import AxisSpec, machine_of

WORDS = "XYZAB"
INCH = 25.4
# Lengths of lines [mm], and of chords.
LENGTHS = (1e-3, 0.05, 0.5, 3.0, 20.0)
CHORDS = (0.02, 0.1, 0.5)
TOLERANCES = (0.005, 0.05, 0.3)
# Least and longest time that a line may ask for [s].
SHORTEST, LONGEST = 2e-3, 0.6
# Planes with their words and offsets.
PLANES = (("G17", "XY", "IJ"), ("G18", "ZX", "KI"), ("G19", "YZ", "JK"))


@dataclass(frozen=True)
class Asked:
    """What a line asks of the columns whose path its F counts: a speed [mm/s or degrees/s], or a T [s].

    Attributes:
        travel: length of that path [mm or degrees].
    """

    line: int
    columns: tuple[int, ...]
    travel: float
    speed: float | None
    duration: float | None


@dataclass(frozen=True)
class Text:
    """A machine and a program for it.

    Attributes:
        lines: from line 2 of the program on, behind the one that energizes all axes. asked: by them.
        end: where the program ends [mm or degrees], shape (K,).
    """

    machine: Machine
    lines: list[str]
    asked: list[Asked]
    end: Array


class _Writer:
    """Writes a program, section by section."""

    def __init__(self, rng: np.random.Generator, machine: Machine, *, tolerance: float) -> None:
        self._rng = rng
        self._machine = machine
        self.here = np.zeros(len(machine.axes))
        self.lines: list[str] = []
        self.asked: list[Asked] = []
        self._inches = self._increments = self._timed = False
        self._tolerance = tolerance
        self._modes()

    def _say(self, *words: str) -> None:
        self.lines.append(" ".join(words))

    def _pick(self, values: tuple[float, ...]) -> float:
        return float(self._rng.choice(values))

    def _unit(self, column: int) -> float:
        return INCH if self._inches and column < 3 else 1.0

    def _modes(self) -> None:
        """Choose units, increments, G93 or G94 and how lines meet."""
        rng = self._rng
        self._inches, self._increments = bool(rng.random() < 0.3), bool(rng.random() < 0.4)
        self._timed = bool(rng.random() < 0.4)
        self._say("G20" if self._inches else "G21", "G91" if self._increments else "G90")
        self._say("G93" if self._timed else "G94")
        if rng.random() < 0.15:
            self._say("G61")
        else:
            self._say("G64", f"P{self._tolerance / (INCH if self._inches else 1.0):.6f}")

    def _word(self, column: int, target: float) -> str:
        """Return the word of an axis near a target [mm or degrees]; the axis is where it says, then."""
        unit, digits = self._unit(column), int(self._rng.integers(3, 6))
        base = self.here[column] if self._increments else 0.0
        number = round((target - base) / unit, digits)
        self.here[column] = base + number * unit
        return f"{WORDS[column]}{number:.{digits}f}"

    def _travel(self, columns: list[int], length: float) -> Array:
        heading = self._rng.normal(size=len(columns))
        heading *= length / np.linalg.norm(heading)
        slowest = min(self._machine.axes[column].max_velocity for column in columns)
        # a degree counts as a millimetre here
        scale = 1e3 if columns[0] < 3 else math.degrees(1.0)
        return heading * min(1.0, 0.5 * slowest * scale * LONGEST / length)

    def _feed(self, columns: list[int], length: float) -> str:
        """Return the word F for a path over columns [mm or degrees]."""
        slowest = min(self._machine.axes[column].max_velocity for column in columns)
        scale = 1e3 if columns[0] < 3 else math.degrees(1.0)
        lasts = length / (slowest * scale) / self._pick((0.05, 0.3, 0.9, 2.0))
        lasts = min(max(lasts, SHORTEST), LONGEST)
        if self._timed:
            number = round(60.0 / lasts, 4)
            self._ask(columns, length, None, 60.0 / number)
            return f"F{number:.4f}"
        unit = self._unit(columns[0])
        number = round(max(60.0 * length / lasts / unit, 0.01), 4)
        self._ask(columns, length, number * unit / 60.0, None)
        return f"F{number:.4f}"

    def _ask(self, columns: list[int], travel: float, speed: float | None, duration: float | None) -> None:
        """Note what the line that is written next asks for."""
        self.asked.append(Asked(len(self.lines) + 2, tuple(columns), travel, speed, duration))

    def _move(self, columns: list[int], length: float, *, feed: bool = True) -> str:
        """Return one G01 over columns."""
        before = self.here.copy()
        travel = self._travel(columns, length)
        words = [self._word(c, before[c] + d) for c, d in zip(columns, travel.tolist(), strict=True)]
        if not feed:
            return " ".join(["G01", *words])
        went = float(np.linalg.norm((self.here - before)[columns]))
        return " ".join(["G01", *words, self._feed(columns, max(went, 1e-3))])

    def _group(self) -> list[int]:
        """Columns that one F can be for."""
        rng = self._rng
        if len(self.here) > 3 and rng.random() < 0.25:
            return [int(rng.integers(3, len(self.here)))]
        return [int(c) for c in rng.permutation(3)[: int(rng.integers(1, 4))]]

    def walk(self) -> None:
        for _ in range(int(self._rng.integers(1, 10))):
            self._say(self._move(self._group(), self._pick(LENGTHS)))

    def beside(self) -> None:
        """Comma lines: groups of their own F or T, started together."""
        for _ in range(int(self._rng.integers(1, 6))):
            groups = [[int(c) for c in self._rng.permutation(2)], [2]]
            if len(self.here) > 3:
                groups.append([3])
            moves = [self._move(group, self._pick(LENGTHS)) for group in groups]
            self._say(", ".join(moves[int(i)] for i in self._rng.permutation(len(moves))))

    def together(self) -> None:
        """Concatenations: several commands of one T."""
        if len(self.here) < 4:
            self.walk()
            return
        for _ in range(int(self._rng.integers(1, 5))):
            first = self._move([0, 1], self._pick(LENGTHS))
            self._say(first, self._move([3], self._pick(LENGTHS), feed=False))

    def chords(self) -> None:
        """Short lines of one F, the code in the first alone."""
        count, chord = int(self._rng.integers(5, 60)), self._pick(CHORDS)
        radius, turn = self._pick((2.0, 10.0, 60.0)), float(self._rng.choice([-1.0, 1.0]))
        angle = turn * np.arange(1, count + 1) * chord / radius
        origin = self.here.copy()
        along = radius * np.stack([np.sin(np.abs(angle)), np.sign(turn) * (1.0 - np.cos(angle))], axis=1)
        plane = [int(c) for c in self._rng.permutation(3)[:2]]
        feed = self._feed(plane, chord)
        asked = self.asked.pop()
        for index, point in enumerate(along):
            words = [self._word(c, origin[c] + d) for c, d in zip(plane, point.tolist(), strict=True)]
            self._ask(plane, chord, asked.speed, asked.duration)
            self._say(*(["G01"] if index == 0 else []), *words, feed if index == 0 else "")

    def arc(self) -> None:
        """Arcs and helices in a plane, by their centre or their radius."""
        code, words, offsets = PLANES[int(self._rng.integers(3))]
        self._say(code)
        first, second = WORDS.index(words[0]), WORDS.index(words[1])
        for _ in range(int(self._rng.integers(1, 4))):
            radius, angle = self._pick((0.5, 4.0, 20.0)), float(self._rng.uniform(-3.0, 3.0))
            sweep = self._pick((0.4, 1.5, 2.8, 4.5)) * float(self._rng.choice([-1.0, 1.0]))
            unit = self._unit(0)
            offset = [round(-radius * part / unit, 5) for part in (math.cos(angle), math.sin(angle))]
            start = self.here[[first, second]].copy()
            centre = start + np.array(offset) * unit
            ends = centre + float(np.hypot(*(start - centre))) * np.array(
                [math.cos(angle + sweep), math.sin(angle + sweep)]
            )
            by_radius = abs(sweep) < 3.0 and self._rng.random() < 0.4
            said = [self._exactly(first, float(ends[0])), self._exactly(second, float(ends[1]))]
            length = radius * abs(sweep)
            third = ({0, 1, 2} - {first, second}).pop()
            if self._rng.random() < 0.3:
                said.append(self._exactly(third, float(self.here[third]) + self._pick((0.01, 1.0, -3.0))))
            if by_radius:
                said.append(f"R{radius / unit * (1.0 + 1e-5):.6f}")
            else:
                said += [f"{name}{value:.5f}" for name, value in zip(offsets, offset, strict=True)]
            self._say("G03" if sweep > 0.0 else "G02", *said, self._feed([first, second], length))

    def _exactly(self, column: int, target: float) -> str:
        """Return the word of an axis to five digits."""
        unit = self._unit(column)
        base = self.here[column] if self._increments else 0.0
        number = round((target - base) / unit, 5)
        self.here[column] = base + number * unit
        return f"{WORDS[column]}{number:.5f}"

    def rapid(self) -> None:
        column = int(self._rng.integers(len(self.here)))
        length = self._pick((0.01, 3.0, 20.0))
        self._say("G00", self._word(column, float(self.here[column]) + length))

    def dwell(self) -> None:
        self._say("G04", f"P{self._pick((0.001, 0.03))}")

    def write(self, sections: int) -> None:
        """Write so many sections, with new modes between some of them."""
        kinds = (self.walk, self.walk, self.beside, self.together, self.chords, self.chords, self.arc)
        others = (self.rapid, self.dwell, self._modes)
        for _ in range(sections):
            if self._rng.random() < 0.35:
                others[int(self._rng.integers(3))]()
            kinds[int(self._rng.integers(len(kinds)))]()


def text_program_of(seed: int) -> Text:
    """The program of a seed."""
    rng = np.random.default_rng((seed, 3))
    alike = rng.random() < 0.5
    specs, first = [], AxisSpec(300.0, 3000.0, 60_000.0)
    for index in range(3 + int(rng.integers(0, 3))):
        if index and alike:
            specs.append(AxisSpec(first.velocity, first.acceleration, first.jerk, rotary=index > 2))
            continue
        own = AxisSpec(
            float(rng.choice([30.0, 300.0])),
            float(rng.choice([300.0, 3000.0])),
            float(rng.choice([10_000.0, 60_000.0, 500_000.0])),
            rotary=index > 2,
        )
        first = own if index == 0 else first
        specs.append(own)
    machine = machine_of(specs)
    writer = _Writer(rng, machine, tolerance=float(rng.choice(TOLERANCES)))
    writer.write(int(rng.integers(1, 6)))
    return Text(machine, writer.lines, writer.asked, writer.here)


def orders_of(seed: int) -> tuple[list[tuple[int, float]], int]:
    """Overrides with the cycles of the motion that they come in; and the cycles between lines, 0: none."""
    rng = np.random.default_rng((seed, 4))
    every = int(rng.choice([0, 0, 3, 25]))
    often = bool(rng.random() < 0.3)
    cycles = np.cumsum(rng.integers(1, 20 if often else 400, 40 if often else 8)).tolist()
    rates = rng.choice([0.0, 0.3, 0.77, 1.0, 1.3, 2.0], len(cycles)).tolist()
    return [*zip(cycles, rates, strict=True), (cycles[-1] + 50, float(rng.choice([1.0, 1.6])))], every
