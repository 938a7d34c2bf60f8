"""Random programs with work offsets, turned ones too, arcs and cycles, read here and by LinuxCNC's rs274.

``python -m tests.bench.rs274_frames [PROGRAMS] [SEED]`` (D-62 to D-64, D-75, D-96, D-110). Left out are pecks
(rs274 ends their rapids 0.254 mm above the hole, not 0.25), G84, G85 and G89 under G98 (it feeds out to where
the cycle began, not to R), parameters of offsets, which it has in inches, and what is refused in a turned
system: G28 of X or Y alone (it goes along the turned axis), and its angle while G92 counts (increments behind
it lead elsewhere than its positions do).
"""

from __future__ import annotations

import sys
from random import Random

from mcserver.machine.machine_file import parse_machine
from tests.bench.rs274_programs import compare
from tests.executor.threading_rig import HEAD, KEYS
from tests.machine_text import axes_text

MACHINE = parse_machine(
    HEAD
    + axes_text(range(3), velocity=1e3, acceleration=1e4)
    + axes_text((3,), rotary=True, velocity=2e4, acceleration=4e4, keys=KEYS)
)


class FrameWriter:
    """Write one random program."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)

    def program(self) -> str:
        """Return the text."""
        lines = ["G21 G90 G17 G94 F1000 S600 M3", "G0 X0 Y0 Z50"]
        writes = [self._move, self._move, self._arc, self._zero, self._setting, self._cycle, self._read]
        writes.append(self._polar)
        for _ in range(self._random.randint(4, 25)):
            lines += self._random.choice(writes)()
        return "\n".join([*lines, "M2", ""])

    def _number(self, least: float = -30.0, most: float = 30.0) -> str:
        return f"{self._random.uniform(least, most):.3f}"

    def _words(self, letters: str = "XYZ") -> str:
        words = [f"{letter}{self._number()}" for letter in letters if self._random.random() < 0.6]
        self._random.shuffle(words)
        return " ".join(words) or f"{letters[0]}{self._number()}"

    def _move(self) -> list[str]:
        # rs274 refuses G53 under G91
        code = self._random.choice(["G0 ", "G1 ", "G90 G53 G0 ", "G1 "])
        return [code + self._words()]

    def _polar(self) -> list[str]:
        words = [f"@{self._number()}", f"^{self._number(-400.0, 400.0)}"]
        third = f" Z{self._number()}" if self._random.random() < 0.3 else ""
        given = words if self._random.random() < 0.6 else [self._random.choice(words)]
        move = f"{self._random.choice(['G0', 'G1'])} {' '.join(given)}{third}"
        # at the zero there is no angle
        return ["G90 G1 X3 Y4", self._random.choice(["G90", "G91"]), move, "G90"]

    def _arc(self) -> list[str]:
        pick, code = self._random.random(), self._random.choice(["G2", "G3"])
        plane, letters, centre = self._random.choice(
            [("G17", "XY", "IJ"), ("G18", "XZ", "IK"), ("G19", "YZ", "JK")]
        )
        if pick < 0.5:
            offsets = f"{centre[0]}{self._number(1.0, 9.0)} {centre[1]}{self._number(-9.0, 9.0)}"
            third = f" {(set('XYZ') - set(letters)).pop()}{self._number()}" if pick < 0.2 else ""
            turns = f" P{self._random.randint(1, 3)}" if pick < 0.1 else ""
            return [f"{plane} {code} {offsets}{third}{turns}", "G17"]
        sign = self._random.choice(["", "-"])
        ends = " ".join(f"{letter}{self._number(-9.0, 9.0)}" for letter in letters)
        return ["G91", f"{plane} {code} {ends} R{sign}{self._number(14.0, 30.0)}", "G90 G17"]

    def _zero(self) -> list[str]:
        choices = [
            f"G10 L2 P{self._random.randint(0, 9)} {self._words()}",
            f"G92.1\nG10 L2 P{self._random.randint(0, 9)} R{self._number(-200.0, 200.0)}",
            f"G92.1\nG10 L2 P{self._random.randint(0, 9)} R{self._random.choice([0, 90])} {self._words()}",
            f"G10 L20 P{self._random.randint(0, 9)} {self._words()}",
            self._random.choice(["G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"]),
            f"G92 {self._words()}",
            self._random.choice(["G92.1", "G92.2", "G92.3"]),
            "G28.1",
            f"G28 {self._random.choice(['', f'X{self._number()} Y{self._number()}'])} Z{self._number()}",
            "G30.1",
            "G30",
        ]
        return [self._random.choice(choices)]

    def _setting(self) -> list[str]:
        return [self._random.choice(["G20", "G21", "G90", "G91", "G21 G90", "F2000"])]

    def _cycle(self) -> list[str]:
        random = self._random
        mode, exit_level = random.choice(["G90", "G91"]), random.choice(["G98", "G99"])
        out_at_f = ["G85", "G89 P0.2", "G84 F600"] if exit_level == "G99" else []
        code = random.choice(["G81", "G82 P0.1", "G86 P0.1", *out_at_f])
        # a tap has to hold its run-in
        least = -3.0 if code[:3] == "G84" else 0.5
        heights = "R5 Z-6" if mode == "G91" else f"R{self._number(1.0, 8.0)} Z{self._number(-9.0, least)}"
        more = [self._hole(exit_level) for _ in range(random.randrange(4))]
        times = f" L{random.randint(1, 3)}" if random.random() < 0.3 else ""
        above = f"G21 G90 G0 Z{self._number(20.0, 60.0)}"
        return [above, f"{mode} {exit_level} {code} {self._words('XY')} {heights}{times}", *more, "G80 G90"]

    def _hole(self, exit_level: str) -> str:
        """Write a line of a cycle that goes on, in the other mode, too."""
        random = self._random
        times = f" L{random.randint(2, 3)}" if random.random() < 0.2 else ""
        words = self._words("XY")
        if exit_level == "G98":
            # to another R rs274 goes slantwise, or ahead of X and Y, where its own pages do not
            mode = random.choice(["", "", "", "G90 ", "G91 "])
            clear = f" R{self._number(1.0, 8.0)}" if mode == "G90 " and random.random() < 0.5 else ""
            words = f"{mode}{words}{clear}"
        return words + times

    def _read(self) -> list[str]:
        number = self._random.choice([5420, 5421, 5422, 5220, 5230])
        # places of 0 are 0 or a whole step of MOD less, by their last bits
        return [f"G1 X[[#{number} + 0.3] MOD 50] Y[[#<_abs_y> + 0.3] MOD 40]"]


if __name__ == "__main__":
    sys.exit(bool(compare(FrameWriter, *map(int, sys.argv[1:3]), machine=MACHINE)))
