"""Expressions and parameters (D-80 to D-82), with the values that LinuxCNC 2.9's rs274 gives."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import parse_machine
from tests.bench.rs274_programs import MACHINE, moves_here
from tests.gcode.test_inputs_and_outputs import machine
from tests.machine_text import axes_text


def value(text: str, *before: str) -> float:
    moves, fault = moves_here("\n".join([*before, f"F100 G1 X{text}"]))
    assert not fault
    return moves[-1][0]


def faults(*lines: str) -> list[tuple[str, int, int]]:
    return [(each.code, each.line, each.column) for each in check_program("\n".join(lines), MACHINE)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[2**3**2]", 64.0),
        ("[-2**2]", 4.0),
        ("[1+2*3-4/2]", 5.0),
        ("[-7 MOD 3]", 2.0),
        ("[7 MOD -3]", 1.0),
        ("[1 EQ 1.00005]", 1.0),
        ("[1 NE 1.00005]", 0.0),
        ("[1 LT 2 AND 0 OR 1]", 1.0),
        ("[2 OR 0 AND 0]", 0.0),
        ("[3 GT 2 EQ 1]", 1.0),
        ("[1 XOR 1 OR 1]", 1.0),
        ("ATAN[1]/[-1]", 135.0),
        ("ROUND[-2.5]", -3.0),
        ("FIX[-2.5]", -3.0),
        ("FUP[-2.5]", -2.0),
        ("SQRT[16]", 4.0),
        ("[SIN[30]*COS[60]]", 0.25),
        ("-[3+4]", -7.0),
        ("EXISTS[#<nobody>]", 0.0),
        ("EXISTS[#<_ini[pins]lock>]", 0.0),
        ("[EXISTS[#7] - EXISTS[#99999]]", 1.0),
        ("ABS[-3]", 3.0),
        ("LN[EXP[2]]", 2.0),
        ("[ 1 + 1 ]", 2.0),
    ],
)
def test_an_expression_has_the_value_of_linuxcnc(text: str, expected: float) -> None:
    assert value(text) == pytest.approx(expected, abs=1e-12)


def test_parameters_are_set_behind_their_line() -> None:
    moves, fault = moves_here("F100 #1=2 #<far>=9\nG1 X#1 #1=5\nG1 X#1 Y#<FAR>\nX[##1] #5=7\n#5=7\nX##1")
    assert not fault
    assert [move[0] for move in moves] == pytest.approx([2.0, 5.0, 0.0, 7.0])
    assert moves[1][1] == pytest.approx(9.0)


def test_no_bit_of_a_value_is_lost_on_its_way_into_a_word() -> None:
    assert value("[1/3]") == float(repr(1 / 3)) * 0.001 / 0.001
    assert value("#1", f"#1=[{math.pi!r}*1e0]".replace("e0", "")) == pytest.approx(math.pi, rel=1e-15)


def test_positions_and_offsets_are_read_as_they_are_before_the_line() -> None:
    text = "G21 F100\nG10 L2 P2 X5 Y-3\nG1 X4 Y2\nG55\nG1 X#5420 Y#<_y>\n"
    text += "G1 Z[#5241+#5242+#5220]\nG20\nG1 X#5021"
    moves, fault = moves_here(text)
    assert not fault
    assert moves[1] == pytest.approx((4.0, 2.0, 0.0))
    assert moves[2] == pytest.approx((4.0, 2.0, 4.0))
    # absolute 4 mm in inches, in a system whose zero is at 5 mm
    assert moves[3][0] == pytest.approx(9.0)


def test_the_diameter_of_the_tool_fitted_is_read_in_mm() -> None:
    head = '[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n'
    mill = parse_machine(
        f"{head}[[cutter]]\nnumber = 3\nlength_mm = 5\ndiameter_mm = 6\n{axes_text((0, 1, 2))}"
    )
    moves, fault = moves_here("G1 F9 X#5410\nT3 M6\nX#5410\nG10 L1 P3 R4\nX#5410 Y#5400\nT0 M6\nX#5410", mill)
    assert not fault
    assert [move[0] for move in moves] == [0.0, 6.0, 8.0, 0.0]
    assert moves[2][1] == 3.0


def test_the_language_and_what_it_is_read_by_are_those_of_linuxcnc() -> None:
    moves, fault = moves_here(
        "G1 F9 X#<_vmajor> Y#<_task> Z#<_ccomp>\nG41.1 D2\nX50 Z#<_ccomp>\nX#5600 Z#5601"
    )
    assert not fault
    assert moves[0][:3] == (2.9, 1.0, 400.0)
    assert moves[1][2] == 410.0


@pytest.mark.parametrize(
    ("line", "code", "column"),
    [
        ("G1 X[1+] F100", "MC160", 8),
        ("G1 X[1 PLUS 2] F100", "MC160", 8),
        ("G1 XFOO[1] F100", "MC160", 5),
        ("G1 X[1 F100", "MC160", 8),
        ("#1 2", "MC160", 1),
        ("G1 X#<nope> F100", "MC162", 5),
        ("G1 X#9999 F100", "MC162", 5),
        ("#5221=3", "MC162", 1),
        ("#<_x>=3", "MC162", 1),
        ("G1 Y[2/0] F100", "MC163", 7),
        ("G1 Y[[-2]**0.5] F100", "MC163", 10),
        ("G1 YSQRT[-2] F100", "MC163", 5),
        ("G1 X[10*1000000000] F100", "MC116", 4),
        ("T[2.5]", "MC116", 2),
        ("IF [#1 EQ 2] GOTO 10", "MC140", 1),
    ],
)
def test_a_fault_has_its_place(line: str, code: str, column: int) -> None:
    assert faults("(header)", line)[:1] == [(code, 2, column)]


def test_a_word_that_was_computed_is_blamed_where_it_stands() -> None:
    (fault,) = check_program("F100\n G1   X[ 1 + 2 ] X5", MACHINE)
    assert (fault.code, fault.line, fault.column, fault.end_column) == ("MC111", 2, 18, 20)


def test_what_depends_on_a_faulty_value_is_not_blamed_for_it() -> None:
    assert faults("F100", "#1=[1/0]", "G1 X#1", "#2=#1", "G1 Y[#2+1]", "G1 X9 Q2") == [
        ("MC163", 2, 6),
        ("MC113", 6, 7),
    ]


def test_a_message_shows_parameters() -> None:
    from mcserver.gcode.computing.expansion import Expansion
    from mcserver.gcode.notices import notice_of
    from mcserver.gcode.semantics.interpreter import Interpreter
    from mcserver.gcode.text.parser import ParsedLine

    expansion = Expansion(Interpreter(MACHINE))
    shown = []
    for number, text in enumerate(["#1=2.5", "#<n>=3", "(DEBUG, at #1 of %d#<n>)", "(MSG, #1)"], 1):
        expansion.take(text, number)
        while expansion.running:
            parsed = expansion.next()
            if isinstance(parsed, ParsedLine):
                shown.append(notice_of(parsed.text, []))
    assert [each for each in shown if each] == ["at 2.500000 of 3", "#1"]


def test_other_profiles_do_not_compute() -> None:
    (fault,) = check_program("G1 X[1+2] F100", machine("printer"))
    assert fault.code == "MC140"


def test_axis_words_by_number_stay_what_they_are() -> None:
    moves, fault = moves_here("F100\nG1 [0]5 [1][2+3]\nG1 [2]-#<_x>")
    assert not fault
    assert moves == [pytest.approx((5.0, 5.0, 0.0)), pytest.approx((5.0, 5.0, -5.0))]


@given(st.text(alphabet="GXo#[]<>=-+*/ .1230abMODSINEXTwhilesubcal()%\té", max_size=60))
def test_no_line_ends_in_anything_but_moves_or_faults(text: str) -> None:
    for each in check_program(f"F100\n#1=1\n{text}\nG1 X1\n{text}", MACHINE):
        assert each.line >= 0
        assert each.code.startswith("MC")
