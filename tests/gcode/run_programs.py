"""Programs of simple blocks drawn by Hypothesis: runs of one layout, with what may end or break a run."""

from __future__ import annotations

from random import Random

from hypothesis import strategies as st

from mcserver.gcode.fast_path.interpreted_batch import MIN_LINES

# what the dialect does not read as a number
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
# lines without motion that are read with those around them, or end a run
RESTING = ("F900", "G1 F1200", "G01", "g0 f50", "F5", "F0", "N3 G1F30 (said)", "G2", "G1 F20\t", "F-3", "S5")
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
    resting = draw(st.sampled_from([0.0, 0.0, 0.2]))
    comment = draw(st.sampled_from(["", "", " ; said", "(said)", " (é; ü)", ";(", " (a) ;b)"]))
    # Hypothesis chooses what matters; the many numbers come from one seed, which is quicker by far
    random = Random(draw(st.integers(0, 2**32)))
    lines: list[str] = []
    for row in range(draw(st.integers(1, 2 * MIN_LINES + 4))):
        if random.random() < resting:
            lines.append(random.choice(RESTING))
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
