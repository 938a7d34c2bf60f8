"""Random contours under cutter compensation, read here and by LinuxCNC's rs274 (D-85).

``python -m tests.bench.rs274_contours [PROGRAMS] [SEED]``. Corners are flat, or turn by more than 0.06 rad,
that behind the lead-in too: those in between LinuxCNC joins askew, by up to 1/800 of the radius within the
path. Rapids, whose corners it cuts, are left out. Gouges refused here alone are moves that LinuxCNC makes
backwards, arcs that it makes nearly full circles, and lead-ins by an arc that end across the path.
"""

from __future__ import annotations

import math
import sys
from random import Random

from tests.bench.rs274_programs import compare

# corners that turn by less are flat or none at all [rad]
_LEAST_TURN = 0.06


class ContourWriter:
    """Write one random contour."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)
        self._place = (0.0, 0.0)
        self._heading = 0.0

    def program(self) -> str:
        """Return the text."""
        random = self._random
        plane = random.choice(["G17", "G17", "G18"])
        self._letters = "XYIJZ" if plane == "G17" else "ZXKIY"
        code, diameter = random.choice(["G41.1", "G42.1"]), random.uniform(0.5, 8.0)
        lines = [f"G21 G90 {plane} G94 F1000", f"{code} D{diameter:.3f}"]
        if random.random() < 0.5:
            # the lead-in begins away from the program's zero
            self._place = (round(random.uniform(-5.0, 5.0), 3), round(random.uniform(-5.0, 5.0), 3))
            zero = zip(self._letters[:2], self._place, strict=True)
            lines[0] += " G10 L2 P1 " + " ".join(f"{letter}{-place}" for letter, place in zero)
        self._heading = random.uniform(-3.0, 3.0)
        lines.append(self._line(random.uniform(5.0, 20.0)) if random.random() < 0.8 else self._arc(8.0))
        for _ in range(random.randint(1, 9)):
            if random.random() < 0.1:
                lines.append(f"G1 {self._letters[4]}{random.uniform(-5, 5):.3f}")
            self._heading += self._turn()
            if random.random() < 0.5:
                lines.append(self._line(random.uniform(1.0, 30.0)))
            else:
                lines.append(self._arc(random.uniform(0.5, 20.0)))
        self._heading += random.uniform(-1.0, 1.0)
        return "\n".join([*lines, "G40", self._line(20.0), "M2", ""])

    def _turn(self) -> float:
        pick = self._random.random()
        if pick < 0.3:
            return 0.0
        return self._random.choice([-1.0, 1.0]) * self._random.uniform(
            _LEAST_TURN, 1.8 if pick < 0.9 else math.pi - _LEAST_TURN
        )

    def _line(self, length: float) -> str:
        return "G1 " + self._to(
            (
                self._place[0] + length * math.cos(self._heading),
                self._place[1] + length * math.sin(self._heading),
            )
        )

    def _arc(self, radius: float) -> str:
        left = self._random.random() < 0.5
        sweep = self._random.uniform(0.2, 5.0) * (1.0 if left else -1.0)
        across = self._heading + math.copysign(math.pi / 2.0, sweep)
        first, second = radius * math.cos(across), radius * math.sin(across)
        angle = across + math.pi + sweep
        centre = (self._place[0] + first, self._place[1] + second)
        end = (centre[0] + radius * math.cos(angle), centre[1] + radius * math.sin(angle))
        self._heading += sweep
        further = (
            f" {self._letters[4]}{self._random.uniform(-3, 3):.3f}" if self._random.random() < 0.2 else ""
        )
        words = f"{self._letters[2]}{first:.9f} {self._letters[3]}{second:.9f}"
        return f"G{3 if left else 2} {self._to(end)} {words}{further}"

    def _to(self, end: tuple[float, float]) -> str:
        self._place = end
        return f"{self._letters[0]}{end[0]:.9f} {self._letters[1]}{end[1]:.9f}"


if __name__ == "__main__":
    sys.exit(bool(compare(ContourWriter, *(int(each) for each in sys.argv[1:3]))))
