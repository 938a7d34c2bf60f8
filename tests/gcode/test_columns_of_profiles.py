"""Lines in columns give what single lines give in every profile: S, E, further axes, rapids."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.errors import Diagnostic
from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, parse_machine
from tests.gcode.test_batches import by_batches, line_by_line

AXES = "".join(
    f'[[axis]]\nindex = {index}\ntype = "{kind}"\nmax_velocity = {speed}\nmax_acceleration = 1000.0\n'
    "min_position = -60\nmax_position = 60\n"
    for index, kind, speed in (
        *((0, "linear", 100.0), (1, "linear", 90.0), (2, "linear", 20.0)),
        *((3, "rotary", 90.0), (6, "linear", 50.0), (7, "linear", 50.0)),
    )
)
KINDS = {
    "mill": 'profile = "cnc"\nletters = { U = 7 }',
    "straight": 'profile = "cnc"\nrapids = "straight"',
    "spindle": 'profile = "cnc"\nspindle_axis = 6',
    "laser": 'profile = "cnc"\n[dialect.outputs]\nM3 = { beam = "S" }\nM4 = { beam = "S", air = true }\n'
    'M5 = { beam = 0 }\n[[output]]\nnumber = 0\nname = "beam"\nkind = "analog"\nmax = 700.0\nlaser = true\n'
    '[[output]]\nnumber = 1\nname = "air"',
    "printer": 'profile = "printer"\nletters = { E = 6 }\n[dialect.retraction]\nlength_mm = 2\n'
    "speed = 30\nhop_mm = 1",
    "fan of a printer": 'profile = "printer"\n[dialect.outputs]\nM3 = { fan = "S" }\nM5 = { fan = 0 }\n'
    '[[output]]\nnumber = 0\nname = "fan"\nkind = "analog"\nmax = 700.0',
    "no extruder": 'profile = "printer"',
    "robot": 'profile = "robot"',
    "letters": "letters = { E = 6 }",
}
WORDS = ("X", "Y", "Z", "A", "E", "U", "[6]", "[7]", "S", "F", "I", "J", "R", "H", "D", "x")
STATES = (
    *(
        "G91",
        "G90",
        "M83",
        "M82",
        "G20",
        "G21",
        "G54",
        "G92 X5",
        "G55",
        "M3",
        "M4",
        "M5",
        "G93 F30",
        "G94 F500",
    ),
    *("G99", "G98", "G61", "G64 P0.1", "G17", "G18", "S500", "G4 P0.1", "G81 Z-1 R1 F100", "G80", "G28"),
    *("G10", "G11", "M207 S3 F900 Z2", "M220 S50", "M220 S100", "M221 S95", "M221 S130"),
)


def machine_of(kind: str) -> Machine:
    return parse_machine(f'[machine]\nname = "m"\n[dialect]\ncapture = "program"\n{KINDS[kind]}\n{AXES}')


def line(random: Random, letters: str) -> str:
    """A line of motion of the usual words, now and then of an odd one."""
    numbers = (0, 1, 2.5, -3, 0.125, random.uniform(-9, 9))
    words = [f"{letter}{random.choice(('', ' '))}{random.choice(numbers):.4g}" for letter in letters]
    words += [f"S{random.randrange(9) * 100}"] * (random.random() < 0.3)
    words += [f"F{random.choice((0.2, 60, 900))}"] * (random.random() < 0.3)
    if random.random() < 0.02:
        words.append(f"{random.choice(WORDS)}{random.randrange(-3, 4)}")
    code = random.choice(("", "", "G1 ", "G01", "g1", "G0 ", "G00"))
    if letters.startswith("XY") and random.random() < 0.3:
        code = random.choice(("G2 ", "G3"))
        words.append(f"R{random.choice((20, 30.5))}")
    number = f"N{random.randrange(99)} " if random.random() < 0.2 else ""
    return (
        number + code + random.choice((" ", "")).join(words) + random.choice(("", "", "", " ; said", "(x)"))
    )


@st.composite
def programs(draw: st.DrawFn) -> list[str]:
    random = Random(draw(st.integers(0, 2**32)))
    shapes = draw(
        st.lists(
            st.sampled_from(
                ["X", "XY", "YX", "XYZ", "Z", "XE", "E", "XYE", "XYZE", "XYU", "A", "XA", "U", "XU"]
            ),
            min_size=1,
            max_size=3,
        )
    )
    lines = ["G1 F600 X0"]
    for _ in range(draw(st.integers(1, 3))):
        lines += [
            line(random, random.choice(shapes)) for _ in range(random.randrange(MIN_LINES, 4 * MIN_LINES))
        ]
        lines += random.sample(STATES, random.randrange(3))
    return lines


@settings(max_examples=100)
@given(programs(), st.sampled_from(sorted(KINDS)))
def test_columns_and_single_lines_are_equal_in_every_profile(texts: list[str], kind: str) -> None:
    machine = machine_of(kind)
    quick, general = Interpreter(machine), Interpreter(machine)
    values, faults = by_batches(quick, texts)
    expected, expected_faults = line_by_line(general, texts)
    assert repr(values) == repr(expected)
    assert faults == expected_faults
    assert quick.modal == general.modal
    assert quick.frame == general.frame
    assert repr(quick.positions) == repr(general.positions)


class _OneByOne(Interpreter):
    def batch_window(self, number: int) -> int:  # noqa: ARG002
        return 0


@settings(max_examples=60)
@given(programs(), st.sampled_from(sorted(KINDS)))
def test_a_check_says_the_same_of_both(texts: list[str], kind: str) -> None:
    machine, text = machine_of(kind), "\n".join(texts)
    found = check_program(text, machine)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mcserver.gcode.program_check.Interpreter", _OneByOne)
        expected: list[Diagnostic] = check_program(text, machine)
    assert found == expected


@pytest.mark.parametrize(
    ("kind", "lines"),
    [
        ("mill", [f"G1 X{at} S{at * 10}" for at in range(40)]),
        ("printer", [f"G{2 + at % 2} X{at + 1} Y{at % 5} Z{at / 10} R30 E{at / 9}" for at in range(40)]),
        ("laser", [f"{'G0' if at % 9 == 5 else 'G1'} X{at} S{at * 10}" for at in range(40)]),
        ("printer", [f"N{at}G1X{at}Y{at % 3}E{at / 10}F900" for at in range(40)]),
        ("no extruder", [f"{'G0' if at % 4 else 'G1'} X{at} E{at / 10}" for at in range(40)]),
        ("mill", [f"{'XYZ'[at % 3]}{at / 10} (said)" for at in range(40)]),
        ("mill", [f"{'G0' if at % 2 else 'G1'} X{at} A{at}" for at in range(40)]),
    ],
)
def test_lines_of_usual_posts_are_read_in_columns(kind: str, lines: list[str]) -> None:
    interpreter = Interpreter(machine_of(kind))
    interpreter.interpret_text("G1 F600 X0 M4 S100", 1)
    found = interpreter.interpret_batch(lines, 2)
    assert found is not None
    assert found.taken == min(len(lines), interpreter.batch_window(2), 32)
