"""Control flow and subprograms (D-83, D-84)."""

from __future__ import annotations

import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.computing import expansion
from mcserver.gcode.computing.expansion import MOST_STEPS
from mcserver.gcode.program_check import check_program
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from tests.bench.rs274_programs import MACHINE, moves_here
from tests.gcode.test_inputs_and_outputs import CHANNELS, machine


def places(text: str) -> list[float]:
    """Where X is behind each move."""
    moves, fault = moves_here(text)
    assert not fault, fault
    return [round(move[0], 9) for move in moves]


def faults(text: str) -> list[tuple[str, int]]:
    return [(each.code, each.line) for each in check_program(text, MACHINE)]


def test_a_while_runs_as_long_as_its_condition_holds() -> None:
    assert places("F100\n#1=1\no1 while [#1 LT 4]\nG1 X#1\n#1=[#1+1]\no1 endwhile\nG1 X9") == [1, 2, 3, 9]


def test_a_do_runs_once_at_least() -> None:
    assert places("F100\no1 do\n#1=[#1+1]\nG1 X#1\no1 while [#1 LT 0]\nG1 X9") == [1, 9]


def test_a_repeat_counts_and_may_be_nothing() -> None:
    assert places("F100 G91\no1 repeat [2.6]\nG1 X1\no1 endrepeat\no2 repeat [0]\nG1 X7\no2 endrepeat") == [
        1,
        2,
        3,
    ]


@pytest.mark.parametrize(("condition", "expected"), [(1, 1), (2, 2), (3, 3)])
def test_one_branch_of_an_if_runs(condition: int, expected: int) -> None:
    text = "o1 if [#1 EQ 1]\nX1\no1 else if [#1 EQ 2]\nX2\no1 else\nX3\no1 end if"
    assert places(f"F100 G1 Y1\n#1={condition}\n{text}")[-1] == expected


def test_break_and_continue_belong_to_the_loop_that_they_name() -> None:
    text = """F100
o1 repeat [3]
  #2=0
  o2 while [1]
    #2=[#2+1]
    o3 if [#2 EQ 2]
      o2 continue
    o3 elseif [#2 EQ 4]
      o1 continue
    o3 endif
    G1 X#2
  o2 endwhile
  G1 X99
o1 endrepeat
o4 repeat [5]
  o4 break
o4 endrepeat
o5 do
  o5 break
o5 while [1]
G1 X0"""
    assert places(text) == [1, 3, 1, 3, 1, 3, 0]


def test_a_subprogram_has_its_own_parameters_and_returns_a_value() -> None:
    text = """F100
#1=7 #<depth>=2
o<leg> sub
  G1 X[#1+#2+#3]
  #1=50 #<depth>=9 #<_all>=4 #31=6
  o1 if [#2 GT 5]
    o<leg> return [#1*2]
  o1 endif
o<leg> endsub
o<leg> call [1] [10]
G1 X#<_value> Y#<_value_returned>
o<LEG> call [1]
G1 X#<_value> Y#<_value_returned>
G1 X[#1+#<depth>+#<_all>+#31]"""
    assert places(text) == [11, 100, 1, 0, 19]


def test_a_subprogram_calls_itself_so_deep_and_no_deeper() -> None:
    text = "F100\no1 sub\no2 if [#1 GT 0]\nG1 X#1\no1 call [#1-1]\no2 endif\no1 endsub\no1 call [{}]"
    assert places(text.format(5)) == [5, 4, 3, 2, 1]
    assert faults(text.format(60)) == [("MC164", 5)]


def test_the_number_of_a_call_may_be_computed() -> None:
    text = "F100\no10 sub\nG1 X1\no10 endsub\no12 sub\nG1 X2\no12 endsub\n#1=5\no[#1*2+2] call\no#2 call"
    assert places(text.replace("\no#2 call", "")) == [2]
    assert faults(text) == [("MC165", 10)]


def test_an_endless_loop_is_refused_at_its_line(monkeypatch: pytest.MonkeyPatch) -> None:
    # as many as are allowed take seconds
    assert MOST_STEPS == 1_000_000
    monkeypatch.setattr(expansion, "MOST_STEPS", 10_007)
    (fault,) = check_program("#1=1\no1 while [#1]\n #2=[#2+1]\n o2 if [0]\n o2 endif\no1 endwhile", MACHINE)
    assert (fault.code, fault.line) == ("MC164", 2)
    assert "10007" in fault.message


@pytest.mark.parametrize(
    ("text", "code", "line"),
    [
        ("o1 endif", "MC161", 1),
        ("G1 F1\no1 if [1]\nX1", "MC161", 2),
        ("o1 while [1]\no2 endwhile", "MC161", 2),
        ("o1 while\no1 endwhile", "MC161", 1),
        ("o1 sub\no2 sub\no2 endsub\no1 endsub", "MC161", 2),
        ("o1 sub\no1 endsub\no1 sub\no1 endsub", "MC161", 3),
        ("o1 if [1] G1 X1\no1 endif", "MC161", 1),
        ("o1 repeat [2]\no3 break\no1 endrepeat", "MC161", 2),
        ("o1 return", "MC161", 1),
        ("o1 whale [2]", "MC161", 1),
        ("o1 if [1]\no1 else\no1 elseif [1]\no1 endif", "MC161", 3),
        ("o5 call", "MC165", 1),
        ("o1 sub\no1 endsub\no1 call " + "[1]" * 31, "MC161", 3),
        ("o1 repeat [[[1]\no1 endrepeat", "MC160", 1),
    ],
)
def test_what_does_not_fit_is_one_fault_with_its_line(text: str, code: str, line: int) -> None:
    assert faults(text)[:1] == [(code, line)]


def test_a_subprogram_that_is_not_there_may_be_in_a_folder() -> None:
    (fault,) = check_program("o<bore> call", MACHINE)
    assert (fault.code, "subroutines" in fault.hint) == ("MC165", True)


def test_a_fault_in_a_loop_is_said_once_at_its_own_line() -> None:
    text = "F100\no1 repeat [50]\n G1 X[1] X2\n #1=[1/0]\no1 endrepeat"
    assert faults(text) == [("MC111", 3), ("MC163", 4)]


def test_a_number_behind_o_alone_is_a_program_s() -> None:
    assert faults("O1234 (BRACKET)\nG1 X1 F100\nM30") == []


def test_what_stands_behind_the_end_within_a_block_does_not_run() -> None:
    assert places("F100\no1 repeat [3]\nG1 X1\nM2\no1 endrepeat\nG1 X5") == [1]


def test_lines_of_a_block_count_as_its_first() -> None:
    from mcserver.gcode.computing.expansion import Expansion
    from mcserver.gcode.semantics.interpreter import Interpreter
    from mcserver.gcode.text.parser import ParsedLine

    interpreter = Interpreter(MACHINE)
    expansion = Expansion(interpreter)
    numbers = []
    text = "F100\no1 sub\nG1 X1\no1 endsub\no2 repeat [2]\nG1 X2\no1 call\no2 endrepeat\nG1 X3\no1 call"
    for number, line in enumerate(text.splitlines(), 1):
        expansion.take(line, number)
        while expansion.running:
            parsed = expansion.next()
            if isinstance(parsed, ParsedLine):
                numbers += [value.line for value in interpreter.interpret(parsed)]
    assert numbers == [5, 5, 5, 5, 9, 10]


def test_a_start_behind_a_block_has_its_parameters_and_subprograms() -> None:
    lines = "F100\no<a> sub\nG1 X#1\no<a> endsub\no2 repeat [3]\n#4=[#4+2] #<n>=#4\no2 endrepeat\n"
    lines += "o<a> call [#<n>+#4]"
    before = state_before(lines.splitlines(), 8, MACHINE, StartState.of(MACHINE))
    assert before.modal.computed is not None
    assert (before.modal.computed.numbered, before.modal.computed.local) == ({4: 6.0}, {"n": 4.0})
    assert list(before.modal.computed.subprograms) == [2, 3, 4]
    after = state_before(lines.splitlines(), 9, MACHINE, StartState.of(MACHINE))
    assert after.positions[0] == pytest.approx(0.010)


def test_a_start_within_a_block_is_refused_and_names_its_head() -> None:
    lines = ["F100", "o2 repeat [3]", "G1 X1", "o2 endrepeat"]
    with pytest.raises(ProgramRejected) as refused:
        state_before(lines, 4, MACHINE, StartState.of(MACHINE))
    (fault,) = refused.value.diagnostics
    assert (fault.code, fault.hint) == ("MC167", "start at line 2")


def test_a_start_behind_what_went_by_a_measured_value_is_refused() -> None:
    described = machine("cnc", CHANNELS)
    lines = ["M66 P0 L0", "#1=#5399", "G1 X1 F100"]
    with pytest.raises(ProgramRejected) as refused:
        state_before(lines, 3, described, StartState.of(described))
    assert [(each.code, each.line) for each in refused.value.diagnostics] == [("MC168", 2)]


def test_a_check_says_what_it_assumes() -> None:
    text = "M66 P0 L3 Q5\no1 if [#5399 EQ 1]\nG1 X1 F100\no1 else\nG1 X1 Q5\no1 endif"
    (warning,) = check_program(text, machine("cnc", CHANNELS))
    assert (warning.code, warning.severity, warning.line) == ("MC166", "warning", 2)


def test_a_state_is_brought_back_by_m72_and_at_the_end_of_a_call_that_has_saved_it() -> None:
    inner = "o2 sub\nM73\nG90 G20\nX3\no2 return [4]\no2 endsub"
    outer = "o1 sub\nM73\nG91 G55 F5\no2 call\nX1 Y#<_value>\no1 endsub"
    moved = places(f"F100\n{inner}\n{outer}\nG10 L2 P2 X100\nG1 X1\no1 call\nX7")
    assert moved == pytest.approx([1.0, 176.2, 177.2, 7.0])
    assert places("F100\nM70\nG91 G20\nG1 X1\nM72\nX5\nG91\nM72\nX6") == pytest.approx([25.4, 5.0, 6.0])


@pytest.mark.parametrize(
    "text",
    ["M72", "M73", "M70\nM71\nM72", "M70\nG68 X0 Y0 R30\nM72", "F9\nM70\nG41.1 D3\nG1 X9\nM72"],
)
def test_a_state_that_is_not_there_or_hangs_on_more_is_refused(text: str) -> None:
    assert [each.code for each in check_program(text, MACHINE)] == ["MC208"]
