"""Random programs that compute, read here and by LinuxCNC's rs274: differences of their moves are printed.

``python -m tests.bench.rs274_programs [PROGRAMS] [SEED]``, with rs274 on the PATH or in the variable RS274
(Debian: linuxcnc-uspace). Compared are ends and centres of moves, and whether a program is refused.
"""

from __future__ import annotations

import cmath
import itertools
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from random import Random
from typing import Protocol
from unittest.mock import patch

import numpy as np

from mcserver.errors import ProgramRejected
from mcserver.gcode.computing import expressions
from mcserver.gcode.computing.macro_expansion import expansion_of
from mcserver.gcode.line_faults import Span
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.gcode.text.parser import ParsedLine
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import Canonical, FeedGroup, MotionLine, RapidGroup, ThreadLine
from mcserver.motion.geometry.curves import ArcCurve
from mcserver.motion.geometry.rational_curve import RationalCurve
from mcserver.motion.geometry.spline_curve import SplineCurve
from mcserver.motion.geometry.turned_arc import TurnedArc
from mcserver.units import MM

# rs274 prints so many decimals [mm]
_ROUNDING = 1.5e-4
# refused here alone: gouges, values that there are not, and where controllers differ
_CAUTIOUS = ("MC163", "MC169", "MC186")
_SIGNS = re.findall(r"\S+", "+ - * / + - * ** MOD EQ NE GT GE LT LE AND OR XOR")
_FUNCTIONS = re.findall(r"\S+", "ABS FIX FUP ROUND SIN COS TAN SQRT ATAN EXP ACOS ASIN LN EXISTS")
Move = tuple[float, ...]


class Writes(Protocol):
    """Writes one program."""

    def program(self) -> str:
        """Return its text."""


_AXES = "".join(
    f'[[axis]]\nindex = {index}\ntype = "linear"\nmax_velocity = 1e3\nmax_acceleration = 1e4\n'
    for index in range(3)
)
MACHINE = parse_machine(f'[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n{_AXES}')


class Writer:
    """Write one random program."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)
        self._lines: list[str] = []
        self._label = 100
        self._names = ["alpha", "beta", "_gamma"]
        self._subs: list[tuple[str, int]] = []
        # a break that skips lines makes rs274 end the next do loop at once
        self._breaks = self._random.random() < 0.5
        # rs274 computes the values of O-words that it skips: these have to be sound
        self._sound = False

    def program(self) -> str:
        """Return the text."""
        self._lines = ["G21 G90 G17 G94 F1000"]
        self._lines += [f"#{number}={self._number()}" for number in range(1, 6)]
        self._lines += [f"#<{name}>={self._number()}" for name in self._names]
        for index in range(self._random.randrange(3)):
            self._sub(index)
        for _ in range(self._random.randint(3, 9)):
            self._statement(0)
        # the longest line that rs274 reads
        self._lines = [line for line in self._lines if len(line) < 250 or line[0] == "o"]
        return "\n".join([*self._lines, "M2", ""])

    def _number(self) -> str:
        return f"{self._random.uniform(-20, 20):.{self._random.randrange(4)}f}"

    def _parameter(self) -> str:
        pick = self._random.random()
        if pick < 0.6:
            return f"#{self._random.randint(1, 6)}"
        if pick < 0.9:
            return f"#<{self._random.choice(self._names)}>"
        return self._random.choice(["#5420", "#5421", "#5422", "#<_x>", "#[2+1]", "#<_feed>", "#5220"])

    def _value(self, deep: int = 0) -> str:
        pick = self._random.random()
        if deep > 2 or pick < 0.3:
            return self._random.choice([self._number(), self._parameter(), f"-{self._parameter()}"])
        if pick < 0.65:
            inner = self._value(deep + 1)
            for _ in range(self._random.randint(1, 3)):
                sign = self._random.choice(_SIGNS)
                number = self._random.choice(["2", "3", "1.5", "-7", "0.25"])
                second = self._value(deep + 1) if sign not in ("/", "MOD", "**") else number
                second = "2" if sign == "**" else second
                if self._random.random() < 0.01 and not self._sound:
                    second = self._value(deep + 1)
                inner += f" {sign} {second}"
            return f"[{inner}]"
        name = self._random.choice(_FUNCTIONS)
        inner = self._value(deep + 1)
        if name == "ATAN":
            return f"ATAN[{inner}]/[{self._value(deep + 1)}]"
        if name == "EXISTS":
            return f"EXISTS[#<{self._random.choice([*self._names, 'nobody'])}>]"
        safe = {
            "SQRT": f"ABS[{inner}]",
            "EXP": f"{inner} MOD 5",
            "ACOS": f"SIN[{inner}]",
            "ASIN": f"COS[{inner}]",
            "LN": f"ABS[{inner}]+1",
            "TAN": f"{inner} MOD 60",
        }
        sound = self._sound or self._random.random() < 0.97
        return f"{name}[{safe.get(name, inner) if sound else inner}]"

    def _sound_value(self) -> str:
        self._sound = True
        value = self._value(2)
        self._sound = False
        return value

    def _place(self) -> str:
        return f"[[{self._value(1)}] MOD 100]"

    def _statement(self, deep: int, loop: str = "") -> None:
        pick = self._random.random()
        if pick < 0.4 or deep > 3:
            self._move()
        elif pick < 0.6:
            self._lines.append(
                f"{self._random.choice(['#1', '#2', '#3', '#<alpha>', '#<_gamma>'])}={self._place()}"
            )
        elif pick < 0.7:
            self._if(deep, loop)
        elif pick < 0.9:
            self._loop(deep)
        elif pick < 0.95 and loop and deep and self._breaks:
            self._lines.append(f"o{loop} {self._random.choice(['break', 'continue'])}")
        elif self._subs:
            name, count = self._random.choice(self._subs)
            arguments = " ".join(f"[{self._value(2)}]" for _ in range(self._random.randint(0, count)))
            self._lines += [f"o{name} call {arguments}", "#4=#<_value>"]
        else:
            self._lines.append("G91 G0 X1 Y#1" if self._random.random() < 0.5 else "G90")

    def _move(self) -> None:
        words = [f"{letter}{self._place()}" for letter in "XYZ" if self._random.random() < 0.6] or ["X1"]
        also = f" #2={self._number()}" if self._random.random() < 0.2 else ""
        self._random.shuffle(words)
        if self._random.random() < 0.15:
            self._lines.append(
                f"G90 G{self._random.choice('23')} I[ABS[{self._value(2)} MOD 9]+1] J[#1 MOD 7]"
            )
        else:
            self._lines.append(f"{self._random.choice(['G0', 'G1', 'g01'])} {' '.join(words)}{also}")

    def _body(self, deep: int, loop: str = "") -> None:
        for _ in range(self._random.randint(1, 3)):
            self._statement(deep + 1, loop)

    def _if(self, deep: int, loop: str) -> None:
        label = self._new()
        self._lines.append(f"o{label} if [{self._value(1)}]")
        self._body(deep, loop)
        for _ in range(self._random.randrange(2)):
            self._lines.append(f"o{label} elseif [{self._sound_value()}]")
            self._body(deep, loop)
        if self._random.random() < 0.5:
            self._lines.append(f"o{label} else")
            self._body(deep, loop)
        self._lines.append(f"o{label} endif")

    def _loop(self, deep: int) -> None:
        label, counter = self._new(), f"#{20 + deep}"
        kind = self._random.choice(["while", "repeat"] if self._breaks else ["while", "do", "repeat"])
        self._lines.append(f"{counter}=0")
        condition = f"[{counter} LT {self._random.randint(0, 4)}]"
        opening = {
            "while": f"while {condition}",
            "do": "do",
            "repeat": f"repeat [{self._random.randint(0, 4)}]",
        }
        self._lines += [f"o{label} {opening[kind]}", f"{counter}=[{counter}+1]"]
        # rs274 knows no break in repeat, and goes on counting one that a break of another loop has left
        self._body(deep, label if kind == "while" else "")
        self._lines.append(f"o{label} {'while ' + condition if kind == 'do' else 'end' + kind}")

    def _sub(self, index: int) -> None:
        name, count = (f"<sub{index}>", 4) if self._random.random() < 0.5 else (str(10 + index), 3)
        names, self._names = self._names, ["_gamma"]
        self._lines.append(f"o{name} sub")
        self._body(2)
        if self._random.random() < 0.3:
            self._lines.append(f"o{name} return [{self._sound_value()}]")
        self._lines.append(
            f"o{name} endsub" + (f" [{self._sound_value()}]" if self._random.random() < 0.5 else "")
        )
        self._names = names
        self._subs.append((name, count))

    def _new(self) -> str:
        self._label += 1
        return str(self._label)


def moves_here(
    text: str, machine: Machine = MACHINE, switches: Switches = AS_WRITTEN
) -> tuple[list[Move], str]:
    """Return ends (and centres) of the moves [mm], and the fault that ends them, if any."""
    interpreter = Interpreter(machine, switches=switches)
    expansion = expansion_of(interpreter)
    place = [0.0, 0.0, 0.0]
    found: list[Move] = []

    def run() -> None:
        while expansion.running and not interpreter.ended:
            parsed = expansion.next()
            if isinstance(parsed, ParsedLine):
                for value in interpreter.interpret(parsed):
                    _follow(value, place, found)

    try:
        for number, line in enumerate(text.splitlines(), start=1):
            expansion.take(line, number)
            run()
            if interpreter.ended:
                break
        else:
            expansion.close()
            run()
            for value in interpreter.finish():
                _follow(value, place, found)
    except ProgramRejected as rejected:
        fault = rejected.diagnostics[0]
        return found, f"{fault.code} line {fault.line}: {fault.message}"
    return found, ""


def _follow(value: Canonical, place: list[float], found: list[Move]) -> None:
    if isinstance(value, ThreadLine):
        before = tuple(place)
        for axis, end in zip(value.axes, value.targets, strict=True):
            place[axis] = end / MM
        found.append(tuple(place))
        if value.taps:
            # and back
            found.append(before)
            place[:] = before
    if not isinstance(value, MotionLine):
        return
    for group in value.groups:
        centre: Move = ()
        if isinstance(group, RapidGroup):
            ends = dict(zip(group.axes, group.targets, strict=True))
        elif isinstance(group, FeedGroup):
            curve = group.curves[0]
            ends = dict(zip(curve.axes, curve.end, strict=True))
            if isinstance(curve, SplineCurve | RationalCurve):
                # rs274 prints no place of a NURBS
                place[:] = [ends.get(axis, at * MM) / MM for axis, at in enumerate(place)]
                continue
            if isinstance(curve, ArcCurve):
                centre = tuple(each / MM for each in curve.centre)
            elif isinstance(curve, TurnedArc):
                centre = _centre(curve)
        else:
            continue
        for axis, end in ends.items():
            if axis < len(place):
                place[axis] = end / MM
        found.append((*place, *centre))


def _centre(curve: TurnedArc) -> Move:
    """Return the centre, by the plane's two axes, at the height of the end [mm]."""
    flat = np.array([*curve.flat.centre, *curve.flat.end[2:]])
    at = np.array(curve.zero) + np.array(curve.directions) @ flat
    return float(at[0]) / MM, float(at[1]) / MM


def moves_of_rs274(text: str, rs274: str) -> tuple[list[Move], str]:
    """Return what LinuxCNC makes of it."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder, "program.ngc")
        program.write_text(text)
        Path(folder, "tools").touch()
        command = [rs274, "-t", "tools", "-v", "variables", "-g", "program.ngc", "moves"]
        output = ""
        # beside another one rs274 may die as it starts
        for _ in range(3):
            try:
                done = subprocess.run(
                    command, cwd=folder, capture_output=True, text=True, timeout=20, check=False
                )
            except subprocess.TimeoutExpired:
                return [], "no end"
            output = Path(folder, "moves").read_text() if Path(folder, "moves").exists() else ""
            if output:
                break
    found = _moves_in(output)
    said = [line for line in done.stderr.splitlines() if line.strip() and "updating variable" not in line]
    refused = "" if "PROGRAM_END" in output else " ".join(said[-3:]) or "no end"
    return found, refused.replace("executing", "").strip() or ("" if "PROGRAM_END" in output else "refused")


def _moves_in(output: str) -> list[Move]:
    """Return the moves of canonical calls, which are in the units and zero in force, as positions [mm]."""
    found: list[Move] = []
    axes, unit = (0, 1, 2), 1.0
    zeros = {"G5X": (0.0, 0.0, 0.0), "G92": (0.0, 0.0, 0.0)}
    turn = 1.0 + 0.0j
    for kind, text in re.findall(r"(?:N[0-9]+)?([A-Z0-9_]+)\(([^)]*)\)", output):
        numbers = [float(each) for each in re.findall(r"-?[0-9]+\.[0-9]+|-?[0-9]+(?![0-9.])", text)]
        if kind == "SELECT_PLANE":
            axes = {"XY": (0, 1, 2), "XZ": (2, 0, 1), "YZ": (1, 2, 0)}[text[-2:]]
        elif kind == "USE_LENGTH_UNITS":
            unit = 25.4 if "INCHES" in text else 1.0
        elif kind.endswith("_OFFSET") and kind[4:7] in zeros:
            first = 1 if kind == "SET_G5X_OFFSET" else 0
            zeros[kind[4:7]] = tuple(unit * each for each in numbers[first : first + 3])
        elif kind == "SET_XY_ROTATION":
            turn = cmath.exp(1j * math.radians(numbers[0]))
        elif kind in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "RIGID_TAP", "ARC_FEED"):
            place = {axis: unit * number for axis, number in enumerate(numbers[:3])}
            if kind != "ARC_FEED":
                back = found[-1][:3] if found else (0.0, 0.0, 0.0)
                found += [_machine(place, turn, zeros), *([back] if kind == "RIGID_TAP" else [])]
                continue
            end, centre = [numbers[0], numbers[1], numbers[5]], numbers[2:4]
            end_of_arc = _machine(
                {axis: unit * number for axis, number in zip(axes, end, strict=True)}, turn, zeros
            )
            # the third coordinate of the centre is that of the end
            around = {axes[0]: unit * centre[0], axes[1]: unit * centre[1], axes[2]: unit * end[2]}
            middle = _machine(around, turn, zeros)
            found.append((*end_of_arc, *(middle[axis] for axis in axes[:2])))
    return found


def _machine(place: Mapping[int, float], turn: complex, zeros: Mapping[str, Move]) -> Move:
    """Return a place of the program along the machine's axes: G92 is turned, the system's origin is not."""
    x, y, z = (place[axis] + zeros["G92"][axis] for axis in range(3))
    at = turn * complex(x, y)
    origin = zeros["G5X"]
    return at.real + origin[0], at.imag + origin[1], z + origin[2]


def _travelling(moves: list[Move], within: float) -> list[Move]:
    found: list[Move] = []
    place: Move = (0.0, 0.0, 0.0)
    for move in moves:
        if len(move) > 3 or math.dist(move, place) > within:
            found.append(move)
            place = move[:3]
    return found


def differences(
    here: list[Move], there: list[Move], within: float = _ROUNDING, *, ended: bool = False
) -> str:
    """Name the first difference of moves that go anywhere [mm]; empty: there is none.

    Args:
        ended: a line was refused here; what rs274 makes behind it is left out.
    """
    here, there = _travelling(here, within), _travelling(there, within)
    there = there[: len(here)] if ended else there
    for index, (mine, theirs) in enumerate(zip(here, there, strict=False)):
        if len(mine) != len(theirs) or any(abs(a - b) > within for a, b in zip(mine, theirs, strict=True)):
            return f"move {index + 1}: {mine} here, {theirs} of rs274"
    if len(here) != len(there):
        return f"{len(here)} moves here, {len(there)} of rs274"
    return ""


def compare(
    writer: Callable[[int], Writes], count: int = 200, seed: int = 1, *, machine: Machine = MACHINE
) -> int:
    """Compare the programs of a kind; return how many differ."""
    rs274 = os.environ.get("RS274") or shutil.which("rs274")
    if rs274 is None:
        print("no rs274 on the PATH, nor in the variable RS274", file=sys.stderr)
        return 0
    differing = refused = moves = unstable = cautious = 0
    for each in range(seed, seed + count):
        text = writer(each).program()
        here, fault = moves_here(text, machine)
        there, error = moves_of_rs274(text, rs274)
        moves += len(here)
        refused += bool(fault and error)
        # rs274 prints so many decimals of inches, too
        within = 0.01 if "G20" in text else _ROUNDING
        what = differences(here, there, within)
        if fault and error:
            # rs274 gives moves out before it refuses what comes behind them
            what = differences(here, there, within, ended=True)
        elif fault.startswith(_CAUTIOUS) and not differences(here, there, within, ended=True):
            cautious += 1
            continue
        elif bool(fault) != bool(error):
            what = f"{what}; here: {fault or 'accepted'}; rs274: {error or 'accepted'}"
        if what and _hangs_on_rounding(text, here, fault, machine):
            unstable += 1
        elif what:
            differing += 1
            print(f"seed {each}: {what}")
    print(
        f"{count} programs, {moves} moves, {refused} refused by both, {cautious} refused here alone by rule, "
        f"{unstable} that hang on rounding, {differing} differ"
    )
    return differing


def _hangs_on_rounding(text: str, here: list[Move], fault: str, machine: Machine) -> bool:
    """Return whether other last bits of what is computed give other moves here, too."""
    for shares in ((1e-13,), (-1e-13,), (1e-13, -1e-13)):
        with patch.object(expressions, "_checked", _nudged(shares)):
            moves, other = moves_here(text, machine)
        if differences(here, moves) or bool(other) != bool(fault):
            return True
    return False


def _nudged(shares: Sequence[float]) -> Callable[[Callable[[], float], str, Span], float]:
    computed = expressions._checked
    turns = itertools.cycle(shares)

    def nudged(compute: Callable[[], float], shown: str, span: Span) -> float:
        value = computed(compute, shown, span)
        # what is true or false stays so
        return value if value in (0.0, 1.0) else value + next(turns) * (1.0 + abs(value))

    return nudged


if __name__ == "__main__":
    sys.exit(bool(compare(Writer, *(int(each) for each in sys.argv[1:3]))))
