"""Runs of plain lines, read in columns, give the very same values, state and faults as line by line."""

from __future__ import annotations

import math
from random import Random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.alike_lines import read_alike
from mcserver.gcode.check import check_program
from mcserver.gcode.interpreter import Interpreter
from mcserver.gcode.parser import scan_line
from mcserver.gcode.plain_runs import LEAST
from mcserver.motion.canonical import Canonical, PlainRun
from tests.gcode.support import CARTESIAN, machine_of

MACHINE = machine_of(
    "0:linear:-50:50 1:linear 2:linear 3:rotary 4:rotary:-90:90 6:linear 7:linear",
    motion="[motion]\npath_tolerance_mm = 0.1\n",
)
NO_NUMBERS = (
    *("1e5", "1E-5", "1_000", "inf", "-Infinity", "nan", "0x10", "1.2.3", "--1", "+-1", "1-", "-", "+", "."),
    *(
        "",
        " ",
        "+ 5",
        "- 5",
        "5 5",
        "5. 5",
        "1,5",
        "٣",
        "1٣",
        "²",
        "1\x00",
        "\x0b1",
        "1\r",
        "1\u00a0",
        "1\x1f",
    ),
    *("O1", "1O", "5%", "5'", "5X", "5G1", "5N1", "[1]", "9" * 400, "1000000001", "-1000000000.1"),
)
PLAIN_NUMBERS = (
    "0",
    "-0",
    "+7",
    ".5",
    "-.25",
    "+.5",
    "5.",
    "-5.",
    "007",
    "00.10",
    "0.1000000000000000055511151231",
)
ODD_NUMBERS = (*NO_NUMBERS, "51", "-50.0001", "1000", "1000000000")
BLANKS = ("", " ", "", "\t ")
ODD_LINES = (
    *("", "  ", "; only a comment", "(two) (comments)", "%", "N5", "GO1 X1", "G02 X1 Y1 R5", "X1, Y2", "5"),
    *(
        "G01 X1\nG01 X2",
        "X1\n",
        "\n",
        "\ufeffX1",
        "x1 (not closed",
        "X1 ) Y2",
        "X1 (a (b) c) Y2",
        "X1 (a (b) ; c)",
        "X5 ( ; ) Y1",
    ),
    *(
        "G1.0 X1",
        "G+1 X1",
        "G0001 X1",
        "N1.5 X1",
        "N-1 X1",
        "5 X1",
        "X1 X2",
        "F5 X1 F6",
        "T1",
        "G01",
        "K5 X1",
    ),
)
JUNK = (*"GNXFAe_+-.,[]();% \t\n5O", "F0", "F-1", "F1e3", "inf")
layout = st.one_of(
    st.sampled_from(
        [["X"], ["A"], ["X", "Y"], ["Z", "Y"], ["X", "Y", "Z"], ["Y", "[6]"], ["Y", "Z", "[6]", "[7]"]]
    ),
    st.lists(
        st.sampled_from(["X", "Y", "Z", "A", "B", "[6]", "[ 7]", "x", "z", "C", "U", "[0]", "[64]"]),
        min_size=1,
        max_size=4,
        unique_by=str.upper,
    ),
)
setting = st.sampled_from(
    [
        *("G20", "G21", "G91", "G90", "G93", "G93 F30", "G94 F600", "G94", "G61", "G64", "G64 P0.05", "G09"),
        *(
            "F50",
            "G00",
            "G01",
            "G02",
            "G1010 P0",
            "G1010 P6",
            "G1010",
            "G1020 Y3",
            "G00 X0 Y0",
            "G90 G00 X0 Y0 A0",
            "M00",
            "M30",
        ),
    ]
)
state = st.tuples(
    st.sampled_from(["G20", "G21"]),
    st.sampled_from(["G90", "G91"]),
    st.sampled_from(["G93 F30", "G94 F600", "G94 F600", "G94"]),
    st.sampled_from(["G61", "G64", "G64 P0.05"]),
    st.sampled_from(["G01", "G01", "G00", "G02"]),
).map(" ".join)


def plain_number(random: Random) -> str:
    match random.randrange(4):
        case 0:
            return str(random.randint(-49, 49))
        case 1:
            return f"{random.uniform(-4.9, 4.9):.{random.randrange(1, 20)}f}"
        case 2:
            return f"{random.uniform(-0.1, 0.1):.3f}"
    return random.choice(PLAIN_NUMBERS)


def disturbed(random: Random, lines: list[str], words: list[str]) -> None:
    """One of the lines is no longer like the others, or no longer right, or one more is blank."""
    at = random.randrange(len(lines))
    match random.randrange(4):
        case 0:
            lines[at] = random.choice(ODD_LINES)
        case 1:
            lines.insert(at, random.choice(["", " ", "; nothing", "()"]))
        case 2:
            lines[at] = " ".join(word + random.choice(ODD_NUMBERS) for word in words)
        case _:
            where = random.randrange(len(lines[at]) + 1)
            lines[at] = lines[at][:where] + random.choice(JUNK) + lines[at][where:]


@st.composite
def stretches(draw: st.DrawFn) -> list[str]:
    """Lines of one layout, some of them with an F, an N, a comment, an odd number, or odd altogether."""
    words = draw(layout)
    code = draw(st.sampled_from(["G01 ", "G1", "g001\t", "", "", "G 01 "]))
    numbered = draw(st.booleans())
    fed = draw(st.sampled_from([0.0, 0.0, 0.25, 1.0]))
    last = draw(st.booleans())
    comment = draw(st.sampled_from(["", "", " ; said", "(said)", " (é; ü)", ";(", " (a) ;b)"]))
    # Hypothesis chooses what matters; the many numbers come from one seed, which is quicker by far
    random = Random(draw(st.integers(0, 2**32)))
    lines: list[str] = []
    for row in range(draw(st.integers(1, 2 * LEAST + 4))):
        gap = random.choice(BLANKS)
        text = gap.join(word + random.choice(BLANKS) + plain_number(random) for word in words)
        if random.random() < fed:
            feed = random.choice(["100", "2.5", "60", "7.125", ".001"])
            text = f"{text} F{feed}" if last else f"F{feed} {text}"
        lines.append(f"{f'N{row * 10} ' if numbered else ''}{code}{text}{comment}")
    for _ in range(draw(st.integers(0, 2))):
        disturbed(random, lines, words)
    return lines


part = st.one_of(
    stretches(),
    stretches(),
    st.lists(setting, max_size=1),
    st.tuples(state, stretches()).map(lambda both: [both[0], *both[1]]),
)
programs = st.tuples(state, stretches(), st.lists(part, max_size=4)).map(
    lambda parts: [parts[0], *parts[1], *(line for part in parts[2] for line in part)]
)


def line_by_line(interpreter: Interpreter, texts: list[str]) -> tuple[list[Canonical], list[Diagnostic]]:
    values: list[Canonical] = []
    faults: list[Diagnostic] = []
    for number, text in enumerate(texts, start=1):
        try:
            values += interpreter.interpret_text(text, number)
        except ProgramRejected as rejected:
            faults += rejected.diagnostics
    return values, faults


def by_runs(interpreter: Interpreter, texts: list[str]) -> tuple[list[Canonical], list[Diagnostic]]:
    values: list[Canonical] = []
    faults: list[Diagnostic] = []
    at = 0
    while at < len(texts):
        found = interpreter.interpret_run(texts[at:], at + 1)
        if found is not None:
            run, taken = found
            assert taken >= LEAST
            values += run.motion_lines()
            at += taken
            continue
        try:
            values += interpreter.interpret_text(texts[at], at + 1)
        except ProgramRejected as rejected:
            faults += rejected.diagnostics
        at += 1
    return values, faults


@settings(max_examples=400, deadline=None)
@given(programs, st.sampled_from([None, frozenset({0, 1, 3, 6})]))
def test_runs_and_single_lines_are_equal_to_the_last_bit(
    texts: list[str], lease: frozenset[int] | None
) -> None:
    quick, general = Interpreter(MACHINE, lease=lease), Interpreter(MACHINE, lease=lease)
    values, faults = by_runs(quick, texts)
    expected, expected_faults = line_by_line(general, texts)
    assert values == expected
    assert repr(values) == repr(expected)  # tells -0.0 from 0.0 and shows every bit
    assert faults == expected_faults
    assert quick.modal == general.modal
    assert repr(quick.positions) == repr(general.positions)
    assert quick.ended == general.ended


@settings(max_examples=150, deadline=None)
@given(programs)
def test_a_check_finds_the_faults_that_single_lines_have(texts: list[str]) -> None:
    text = "\n".join(texts)
    single = Interpreter(MACHINE)
    expected: list[Diagnostic] = []
    for number, line in enumerate(text.split("\n"), start=1):
        if not single.ended:
            expected += single.survey(scan_line(line.removesuffix("\r"), number))
    assert check_program(text, MACHINE) == expected


@settings(max_examples=400, deadline=None)
@given(stretches())
@example(["X1\t"])
@example(["X1\nX2", "X3"])
def test_what_is_read_in_columns_is_what_the_scanner_reads(texts: list[str]) -> None:
    alike = read_alike(texts, 1)
    if alike is None:
        return
    rows = dict(zip(alike.lines.tolist(), range(len(alike.lines)), strict=True))
    for index, text in enumerate(texts[: alike.taken]):
        parsed = scan_line(text, index + 2)
        assert not parsed.faults
        if index not in rows:
            assert parsed.blank
            continue
        plain, row = parsed.plain, rows[index]
        feed = math.nan if alike.feeds is None else alike.feeds[row]
        if feed <= 0.0:
            assert plain is None  # refused by whoever gives the lines their meaning
            continue
        assert plain is not None
        assert plain.code in (None, 1)
        assert not plain.curved
        assert plain.axes == alike.axes
        assert plain.values == tuple(column[row] for column in alike.values)
        assert (plain.feed is None) == math.isnan(feed)
        assert plain.feed in (None, feed)


def started(*lines: str) -> Interpreter:
    interpreter = Interpreter(CARTESIAN)
    for number, text in enumerate(lines, start=1):
        interpreter.interpret_text(text, number)
    return interpreter


def taken(interpreter: Interpreter, texts: list[str], number: int = 100, most: int = 4096) -> int:
    found = interpreter.interpret_run(texts, number, most)
    return 0 if found is None else found[1]


@pytest.mark.parametrize("number", NO_NUMBERS)
def test_what_the_dialect_does_not_read_as_a_number_ends_a_run(number: str) -> None:
    texts = [f"X{index}" for index in range(20)]
    texts[15] = f"X{number}"
    assert taken(started("F100 G01"), texts) == 15


@pytest.mark.parametrize(
    "number", ["5", "+5", "-5", ".5", "5.", "-.5", "+5.", "005", "5\t", " 5", "5 (five)", "5;", "5 F7"]
)
def test_what_the_dialect_reads_as_a_number_does_not_end_a_run(number: str) -> None:
    texts = [f"X{index}" for index in range(20)]
    texts[15] = f"X{number}"
    assert taken(started("F100 G01"), texts) == 20


OTHERS = (
    *(
        "Y1",
        "X1 Y1",
        "G02 X1 Y1 R5",
        "G00 X1",
        "T1",
        "M00",
        "X1, Y1",
        "N5",
        "%",
        "G91 X1",
        "X1 F0",
        "X9000",
        "U1",
    ),
    *("5 X1", "- X1", "X", "N X1", "N1.5 X1", "N-1 X1", "G X1", "G1.0 X1", "G+1 X1", "G11 X1", "G0001 X1"),
    *(
        "X1 X2",
        "X1 [0]2",
        "[64]1",
        "[ ]1",
        "F5 X1 F6",
        "X1 F",
        "X1 N5",
        "X1 (",
        "X1)",
        "X1 ((a))",
        "X1 (a (b) ; c)",
        "x1 \u017f",
    ),
)


@pytest.mark.parametrize("line", OTHERS)
def test_other_lines_end_a_run(line: str) -> None:
    texts = [f"X{index}" for index in range(20)]
    texts[15] = line
    assert taken(started("F100 G01"), texts) == 15


def test_a_run_holds_lines_numbers_points_and_times() -> None:
    found = started("G94 F6000").interpret_run(["G01 X0 Y0", "", *["X3 Y4", "X0 Y0 F3000"] * 6], 2)
    assert found is not None
    run, lines = found
    assert isinstance(run, PlainRun)
    assert lines == 14
    assert run.lines.tolist() == [2, *range(4, 16)]
    assert run.axes == (0, 1)
    assert run.points[:4].tolist() == [[0.0, 0.0], [0.0, 0.0], [0.003, 0.004], [0.0, 0.0]]
    assert run.travels[:3] == pytest.approx([0.0, 0.005, 0.005])
    assert run.speeds is not None
    assert run.speeds[:4].tolist() == [0.1, 0.1, 0.05, 0.05]
    assert run.requested[:4] == pytest.approx([0.0, 0.05, 0.1, 0.1])


@pytest.mark.parametrize(
    "before",
    [
        ["F100"],  # no motion code to repeat
        ["F100 G02"],
        ["F100 G00"],
        ["G01"],  # no feed
        ["F100 G01 G93"],  # nor here
        ["F100 G01", "G09"],
        ["F100 G01", "G1010 P0"],  # the encoder decides where X starts
        ["F100 G01", "M30"],
    ],
)
def test_where_a_line_is_not_plain_there_is_no_run(before: list[str]) -> None:
    assert taken(started(*before), ["X1"] * 20) == 0


def test_no_more_lines_are_taken_than_asked_for() -> None:
    texts = ["X1"] * 40
    assert taken(started("F100 G01"), texts, most=15) == 15
    assert taken(started("F100 G01"), texts, most=LEAST - 1) == 0
    assert taken(started("F100 G01"), texts[: LEAST - 1]) == 0


def test_looking_in_vain_pauses_and_a_run_takes_more_next_time() -> None:
    interpreter = started("F100 G01")
    first = interpreter.run_window(100)
    assert taken(interpreter, ["X1"] * first, 100) == first
    assert interpreter.run_window(100 + first) > first
    vain = ["X1", "Y1"] * 20
    assert taken(interpreter, vain, 200) == 0
    assert interpreter.run_window(200) == 0
    assert interpreter.run_window(201) > 0
    assert taken(interpreter, vain, 201) == 0
    assert interpreter.run_window(202) == 0
    assert interpreter.run_window(203) == first


def test_a_capture_keeps_runs_away_from_its_own_axes_only() -> None:
    assert taken(started("F100 G01", "G1010 P1"), ["X1"] * 20) == 20
    assert taken(started("F100 G01", "G1010 P1"), ["X1 Y1"] * 20) == 0
    assert taken(started("F100 G01", "G1010", "X1 Y1"), ["X1 Y1"] * 20) == 20
