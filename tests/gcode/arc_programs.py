"""Programs of lines and arcs drawn by Hypothesis: their words change, and some may end or break a run."""

from __future__ import annotations

import math
from random import Random

from hypothesis import strategies as st

from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES
from tests.gcode.run_programs import disturbed, part

AXES = "XYZ"
OFFSETS = "IJK"
PLANES = ((0, 1), (2, 0), (1, 2))
ODD_ARCS = (
    *("G02 X1 Y1", "G02 X1 Y1 R0", "G02 X1 Y1 R0.0005", "G03 X49 Y49 R2", "G02 I0 J0", "G02 X3 I1 J7"),
    *("G02 R5", "G02 X1 Y1 R5 I1", "G02 I1 I2", "G02 X1 Y2 I1 J2 K3", "G02 X9 P2 I4", "G02 X1 A2 R50"),
    *("G01 X1 I2", "I5 J0", "G02 X50.0001 Y0 R60", "G03 I45 J0", "G02 [0]1 [1]2 R60", "G02 [6]1 I5"),
    *("G02 U1 V1 R5", "X1 G02 Y2 R5", "G2 X5 R-30", "G3 K2", "G3 J2", "G3 I2", "G2.0 I5", "G2 I5 J0 F0"),
    *("G18", "G02", "G01", "F50", "G00 X0 Y0 Z0", "(MSG, hello)", "G1 A5", "G1 [6]3", "G01 B2 A1 F9"),
)


class _Writer:
    """Writes lines and arcs from where the ones before it ended, in absolute coordinates."""

    def __init__(self, random: Random, incremental: bool, planes: tuple[tuple[int, int], ...]) -> None:
        self._random = random
        self._incremental = incremental
        self._planes = planes
        self._at = [0.0, 0.0, 0.0]
        self._code = ""
        self._places = random.choice((3, 4, 4, 9))
        # so small that inches fit too
        self._size = random.choice((0.03, 1.0, 1.0))

    def word(self, letter: str, value: float) -> str:
        random = self._random
        shown = f"{value:.{self._places}f}"
        return f"{letter}{random.choice(('', '', ' '))}{shown}{random.choice(('', '', ' '))}"

    def _ends(self, axes: tuple[int, ...], ends: list[float]) -> list[str]:
        words = []
        for axis in axes:
            start, end = self._at[axis], ends[axis]
            words.append(self.word(AXES[axis], end - start if self._incremental else end))
            self._at[axis] = end
        self._random.shuffle(words)
        return words

    def _coded(self, code: str, words: list[str]) -> str:
        random = self._random
        written = (
            "" if code == self._code and random.random() < 0.5 else f"G{random.choice(('', '0'))}{code} "
        )
        self._code = code
        if random.random() < 0.2:
            words.insert(random.randrange(len(words) + 1), random.choice(("F100", "F 2.5", "F60.")))
        return written + random.choice(("", " ")).join(words)

    def line(self) -> str:
        random = self._random
        axes = tuple(random.sample(range(3), random.choice((1, 2, 2, 3))))
        ends = [self._size * random.uniform(-20.0, 20.0) for _ in range(3)]
        ends = [
            end if axis in axes else at for axis, (end, at) in enumerate(zip(ends, self._at, strict=True))
        ]
        return self._coded("1", self._ends(axes, ends))

    def arc(self) -> str:
        random = self._random
        first, second = random.choice(self._planes)
        clockwise = random.random() < 0.5
        angle, radius = random.uniform(0.0, 2.0 * math.pi), self._size * random.choice((0.02, 2.0, 5.0, 9.0))
        if random.random() < 0.3:
            angle = random.randrange(4) * math.pi / 2.0
        sweep = random.choice((math.pi, math.pi / 2.0, random.uniform(0.001, 6.2), 2.0 * math.pi))
        to_centre = (radius * math.cos(angle), radius * math.sin(angle))
        turned = angle + math.pi + (-sweep if clockwise else sweep)
        ends = list(self._at)
        ends[first] += to_centre[0] + radius * math.cos(turned)
        ends[second] += to_centre[1] + radius * math.sin(turned)
        named = [first, second]
        (third,) = {0, 1, 2} - {first, second}
        if random.random() < 0.3:
            named.append(third)
            ends[third] = self._size * random.uniform(-5.0, 5.0)
        if sweep == 2.0 * math.pi and random.random() < 0.7:
            ends[first], ends[second] = self._at[first], self._at[second]
            named = named[2:]
        words = self._ends(tuple(named), ends)
        code = "2" if clockwise else "3"
        fits = sweep < 6.0 and abs(sweep - math.pi) > 0.1 and named[:2] == [first, second]
        if fits and random.random() < 0.4:
            return self._coded(code, [*words, self.word("R", radius if sweep <= math.pi else -radius)])
        offsets = [
            self.word(OFFSETS[axis], value) for axis, value in zip((first, second), to_centre, strict=True)
        ]
        random.shuffle(offsets)
        if random.random() < 0.1:
            offsets.pop()
        return self._coded(code, [*words, *offsets])


@st.composite
def contours(draw: st.DrawFn, state: str = "G90") -> list[str]:
    """Lines and arcs on end, each with the words that it needs, as CAM writes them; some are not right."""
    numbered = draw(st.booleans())
    arcs = draw(st.sampled_from([0.5, 0.3, 1.0]))
    comment = draw(st.sampled_from(["", "", " ; said", "(said)", " (MSG,x)"]))
    random = Random(draw(st.integers(0, 2**32)))
    plane = next((index for index, code in enumerate(("G17", "G18", "G19")) if code in state), None)
    planes = (PLANES[0], *PLANES) if plane is None else (PLANES[plane],)
    writer = _Writer(random, "G91" in state, planes)
    lines = ["G02 I1 J0" if "G91" in state else "G01 X0 Y0 Z0"]
    for row in range(draw(st.integers(MIN_LINES, 4 * MIN_LINES))):
        text = writer.arc() if random.random() < arcs else writer.line()
        said = comment if random.random() < 0.2 else ""
        lines.append(f"{f'N{row * 10} ' if numbered else ''}{text}{said}")
    for _ in range(draw(st.sampled_from([0, 0, 1, 2]))):
        if draw(st.booleans()):
            lines[random.randrange(len(lines))] = random.choice(ODD_ARCS)
        else:
            disturbed(random, lines, ["X", "Y"])
    return lines


@st.composite
def arc_programs(draw: st.DrawFn) -> list[str]:
    """Contours one after the other in a few modal states, and other lines between them."""
    units = ["G21", "G20"], ["G90", "G91"], ["G94 F600", "G94 F600", "G93 F30"], ["G61", "G64", "G64 P0.05"]
    lines: list[str] = []
    for _ in range(draw(st.integers(1, 3))):
        state = " ".join(draw(st.sampled_from(each)) for each in (*units, ["", "", "G17", "G18", "G19"]))
        lines += [state, *draw(contours(state)), *draw(st.one_of(st.just([]), part))]
    return lines
