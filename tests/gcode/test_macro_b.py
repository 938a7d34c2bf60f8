"""Subprograms and macro B of Fanuc's controllers (D-91 to D-93)."""

from __future__ import annotations

from random import Random

import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.computing import expansion, macro_expansion
from mcserver.gcode.computing.expansion import MOST_STEPS
from mcserver.gcode.computing.macro_expansion import expansion_of
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import ParsedLine
from mcserver.machine.machine_file import parse_machine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from tests.bench.rs274_programs import MACHINE as NGC
from tests.bench.rs274_programs import moves_here
from tests.gcode.macro_programs import MACHINE_TEXT, MacroWriter

MACHINE = parse_machine(MACHINE_TEXT)


def places(text: str) -> list[float]:
    """Where X is behind each move."""
    moves, fault = moves_here(text, MACHINE)
    assert not fault, fault
    return [round(move[0], 9) for move in moves]


def faults(text: str) -> list[tuple[str, int]]:
    return [(each.code, each.line) for each in check_program(text, MACHINE) if each.severity == "error"]


@pytest.mark.parametrize("seed", range(60))
def test_a_program_moves_as_its_unrolled_text_does(seed: int) -> None:
    program, unrolled = MacroWriter(seed).program()
    assert moves_here(program, MACHINE) == moves_here(unrolled, MACHINE)


def test_subprograms_stand_behind_m30_and_are_repeated() -> None:
    text = "%\nO1 (MAIN)\nG91 G1 F100 X1\nM98 P1000 L2\nM98 P31000\nG1 X-1 M98 P1000\nM30\nO1000\nX10\nM99\n%"
    assert places(text) == [1, 11, 21, 31, 41, 51, 50, 60]


def test_m98_shares_the_local_parameters_and_g65_has_its_own() -> None:
    text = """O1
F100 #1=1 #2=2
M98 P5
G1 X#2
G65 P5 B7. L2
G1 X#2
M30
O5
G1 X[#1 + #2]
#2 = 9
M99"""
    assert places(text) == [3, 9, 7, 7, 9]


def test_codes_ahead_of_g65_are_done_first() -> None:
    text = "F100\nG91 G65 P9 X5\nM30\nO9\nG1 X#24\nX#24\nM99"
    assert places(text) == [5, 10]


def test_arguments_follow_both_specifications() -> None:
    text = "F100\nG65 P9 A1 B2 C3 I4 J5 K6 I7 J8 K9 J10\nG65 P9 A1 M2 Z3\nM30\nO9\n"
    text += "G1 X#1 Y#13 Z#26\nG1 X[#4*100+#5*10+#6]\nG1 X[#7*100+#8*10+#9]\nG1 X#11\nM99"
    # a word whose parameter has no value is left out
    assert places(text) == [1, 456, 789, 10, 1, 0, 0]


def test_a_parameter_without_a_value_equals_no_number() -> None:
    text = """F100
IF [#1 EQ #0] THEN #2 = 1
IF [#1 EQ 0] THEN #2 = 99
IF [#1 NE 0] THEN #3 = 2
IF [#1 GE 0] THEN #4 = 4
G1 X[#2 + #3 + #4 + #1]
#1 = 0
IF [#1 EQ #0] GOTO 9
G1 X5
N9 G1 X6"""
    assert places(text) == [7, 5, 6]


def test_functions_and_operators_are_fanucs() -> None:
    text = """F100
#1 = FIX[-1.5] + FUP[-1.2] * 10
G1 X#1
G1 X[6 AND 3 + 8 OR 1]
G1 X[ATAN[-1]/[1]]
G1 X[-7 MOD 4]
IF [[#1 LT 0] AND [#1 GT -30]] GOTO 5
G1 X99
N5 M30"""
    assert places(text) == [-21, 11, 315, -3]


def test_goto_searches_ahead_and_then_from_the_beginning() -> None:
    text = """F100 #1 = 0
N10 #1 = #1 + 1
G1 X#1
IF [#1 LT 3] GOTO 10
GOTO [2 * 20]
N10 G1 X77
N40 G1 X40
M30"""
    # the second N10 is ahead
    assert places(text) == [1, 77, 40]
    assert places(text.replace("N10 G1", "N11 G1")) == [1, 2, 3, 40]


def test_the_end_of_a_file_may_stand_behind_m30() -> None:
    text = "F100\n#1 = 1\nIF [#1 EQ 1] GOTO 90\nG1 X1\nM30\nN90 G1 X90\nM30"
    assert places(text) == [90]


def test_m99_with_a_number_goes_on_at_that_block_of_the_caller() -> None:
    text = "F100\nM98 P5\nG1 X1\nN7 G1 X7\nM30\nO5\nG1 X5\nM99 P7"
    assert places(text) == [5, 7]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("G1 F100 X1\nGOTO 7\nM30", ("MC183", 2)),
        ("G1 F100 X1\nM98 P7\nM30\nO8\nM99", ("MC165", 2)),
        ("G1 F100 X1\nM99", ("MC182", 2)),
        ("G1 F100 X1\nO8\nM99", ("MC182", 2)),
        ("G1 F100 X1\nM98 P8\nM30\nO8\nX3", ("MC182", 5)),
        ("#1 = 2\nIF [#1 EQ 2] GOTO 9\nM30\nN9 #3000 = 1 (TOO DEEP)", ("MC184", 4)),
        ("WHILE [1] DO1\nEND2", ("MC181", 2)),
        ("WHILE [0] DO1\nM30", ("MC181", 1)),
        ("IF [#500 EQ 1] GOTO 5", ("MC162", 1)),
        ("#40 = 1", ("MC162", 1)),
        ("#0 = 1", ("MC162", 1)),
        ("#5041 = 1", ("MC162", 1)),
        ("G1 F100 X[1 / #1]", ("MC163", 1)),
        ("G66 P8", ("MC141", 1)),
        ("G65 P8 N1", ("MC181", 1)),
        ("o100 sub", ("MC181", 1)),
        ("M98 P8\nM30\nO8\nM99\nO8\nM99", None),
        ("M98 P8 L99999\nM30\nO8\nM99", ("MC164", 1)),
    ],
)
def test_what_does_not_fit_together_is_a_fault_at_its_line(
    text: str, expected: tuple[str, int] | None
) -> None:
    assert faults(text)[:1] == ([expected] if expected else [])


def test_endless_programs_name_their_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(expansion, "MOST_STEPS", 2000)
    assert MOST_STEPS > 2000
    assert faults("F100\nN5 G1 X1\nG1 X0\nGOTO 5\nM30") == [("MC164", 4)]
    assert faults("F100\n#1 = 1\nWHILE [#1 LT 3] DO1\nG1 X1\nG1 X0\nEND1\nM30") == [("MC164", 3)]
    assert faults("F100\nM98 P5\nM30\nO5\nDO2\nEND2\nM99") == [("MC164", 5)]
    assert faults("M98 P5\nM30\nO5\nM98 P5\nM99") == [("MC164", 4)]


def test_lines_far_back_are_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(macro_expansion, "MOST_LINES", 50)
    lines = ["G91 F6000", "N5 G1 X1", *["G1 X1"] * 200, "M98 P7", "X1", "M30", "O7", "X100", "M99"]
    assert faults("\n".join(lines)) == []
    assert places("\n".join(lines))[-1] == 302
    assert faults("\n".join([*lines[:150], "GOTO 5"])) == [("MC183", 151)]
    # a subprogram further ahead than what is kept
    assert faults("\n".join(["M98 P7", *lines]))[:1] == [("MC164", 51)]


def test_positions_and_modes_are_read_by_fanucs_numbers() -> None:
    text = "G54 G21 F250\nG10 L2 P1 X10\nG1 X5\nG91\nG1 X[#5041 + #5021 + #5221]\nG90 X[#4003 + #4109]\n"
    assert places(text) == [15, 45, 351]
    assert places("F100 G91\n#1 = #4003\nG90 G1 X4\nG#1 X1") == [4, 5]


@pytest.mark.parametrize("line", ["M98 P5", "G65 P5 A1", "M99", "IF [#1 EQ 1] GOTO 5", "#1 = #2 + 1"])
def test_without_the_option_the_remedy_is_named(line: str) -> None:
    found = check_program(f"G1 F100 X1\n{line}\nM30", NGC)
    assert found[0].line == 2
    if "+" not in line:
        assert 'macros = "fanuc"' in found[0].hint


def test_a_start_behind_loops_has_the_parameters_and_the_subprograms() -> None:
    lines = """O1
F600 #1 = 0
WHILE [#1 LT 3] DO1
G1 X#1
#1 = #1 + 1
END1
G1 X#1
M98 P8
M30
O8
G1 X[#1 + 5]
M99""".splitlines()
    state = state_before(lines, 7, MACHINE, StartState.of(MACHINE))
    assert round(state.positions[0] * 1e3, 9) == 2
    interpreter = Interpreter(MACHINE, positions=state.positions, modal=state.modal)
    rest = expansion_of(interpreter)
    for number, line in enumerate(lines[6:], 7):
        rest.take(line, number)
        while rest.running and not interpreter.ended:
            parsed = rest.next()
            if isinstance(parsed, ParsedLine):
                interpreter.interpret(parsed)
    assert round(interpreter.positions[0] * 1e3, 9) == 8


def test_a_start_behind_a_call_of_what_is_not_there_yet_is_refused() -> None:
    for line, what, way in (
        ("M98 P8", "O8", ", or put O8 into [dialect] subroutines"),
        ("GOTO 30", "block N30", ""),
        ("WHILE [1 GT 2] DO1", "the END of a loop", ""),
    ):
        with pytest.raises(ProgramRejected) as refused:
            state_before(["F600", line, "G1 X1", "M30"], 3, MACHINE, StartState.of(MACHINE))
        (found,) = refused.value.diagnostics
        assert (found.code, found.hint) == ("MC167", f"start at line 2 or before it{way}")
        assert f"goes by {what}, which stands behind the line to start at" in found.message


def test_garbage_is_refused_and_never_breaks() -> None:
    random = Random(5)
    text = "IF WHILE GOTO DO1 END1 END2 [ ] # #1 #0 = EQ 1 2.5 N5 M98 M99 P5 L2 G65 A1 THEN O5 G1 X ( ; % /"
    words = text.split()
    for _ in range(300):
        text = "\n".join(
            " ".join(random.choices(words, k=random.randint(1, 6))) for _ in range(random.randint(1, 8))
        )
        check_program(text, MACHINE)
