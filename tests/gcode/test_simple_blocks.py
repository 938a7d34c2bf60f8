"""Simple blocks give the same values as the block interpreter."""

from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.errors import ProgramRejected
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import ParsedLine, scan_line
from tests.gcode.support import machine_of

MACHINE = machine_of(
    "0:linear:-50:50 1:linear 2:linear 3:rotary 4:rotary:-90:90 6:linear",
    motion="[motion]\npath_tolerance_mm = 0.1\n",
)
number = st.decimals(-60, 60, places=3).map(str)
axis_word = st.tuples(st.sampled_from(["X", "Y", "Z", "A", "B", "[6]", "[0]", "x", "C"]), number).map("".join)
move = st.tuples(
    st.sampled_from(["G01 ", "G1", "N7 g001 ", "", "G90 G01 ", "G02 "]),
    st.lists(axis_word, min_size=1, max_size=4).map(" ".join),
    st.sampled_from(["", "", " F100", " F0", " F2.5"]),
).map("".join)
arc = st.tuples(
    st.sampled_from(["G02 ", "G3", "g002 ", "", "G01 "]),
    st.lists(axis_word, max_size=3).map(" ".join),
    st.sampled_from([" R20", " R-30", " I5 J5", " I5", "J-5", " K5 I0", " K3", " R5 I1", " R0", " I0.001"]),
    st.sampled_from(["", " F100", " F0"]),
).map("".join)
circle = st.tuples(
    st.sampled_from(["G02 ", "G03", ""]),
    st.sampled_from(["X1 Y2", "Z3", "X4", "Y5 Z-3", "X2 Z2 Y9", "X8 Z1", "X49 Y3"]),
    st.sampled_from(["R20", "R-30", "R6", "I4 J1", "I-5 K2", "J3"]),
).map(" ".join)
setting = st.sampled_from(
    [
        *("G20", "G21", "G91", "G90", "G93 F30", "G94 F600", "G61", "G64", "G09", "F50"),
        *("G1010 P0", "G1010 P6", "G1010", "G17", "G18", "G19", "G02"),
    ]
)


def outcome(interpreter: Interpreter, parsed: ParsedLine) -> object:
    try:
        return interpreter.interpret(parsed)
    except ProgramRejected as rejected:
        return rejected.diagnostics


@settings(max_examples=250, deadline=None)
@given(st.lists(st.one_of(move, move, setting, arc, circle), max_size=12))
def test_simple_and_general_interpretation_are_equal(lines: list[str]) -> None:
    quick, general = Interpreter(MACHINE), Interpreter(MACHINE)
    for line_number, text in enumerate(["F600", "G01 X0", *lines], start=1):
        parsed = scan_line(text, line_number)
        slow = scan_line(text, line_number)
        slow.simple = None
        assert outcome(quick, parsed) == outcome(general, slow)
        assert quick.modal == general.modal
        assert quick.positions == general.positions


def test_simple_blocks_are_recognized() -> None:
    for text in ("G01 X1 Y2", "X1 F5", "g1[6]3", "G02 X1 Y1 R1", "X1 I5 J0", "N5 G03 I5 J0", "N"):
        assert (scan_line(text, 1).simple is not None) == (text != "N")
    for text in ("G02 X1 Y1 P2 R1", "G01 X1 R1", "G02 X1 R1 I2", "G01 U1", "G01 X1 X2", "G01 X1, Y1"):
        assert scan_line(text, 1).simple is None
    for text in ("N5.5 X1", "X1 N5", "F100", "G01", "G01 X1 F0", "I5 J0", "G02 R5"):
        assert scan_line(text, 1).simple is None


def test_a_simple_line_has_groups_and_columns_too() -> None:
    parsed = scan_line("\tG01  X1 Y-2", 4)
    (group,) = parsed.groups
    (command,) = group
    assert command.spec is not None
    assert command.spec.name == "G01"
    assert parsed.command_span(command) == (2, 13)
    assert [parsed.span(word.index) for word in command.items] == [(7, 9), (10, 13)]
