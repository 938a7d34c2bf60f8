"""A cause that comes on many lines is shown once."""

from __future__ import annotations

import pytest

from mcserver.errors import Diagnostic
from mcserver.gcode.program_check import check_program
from mcserver.gcode.repeated import by_cause, further_lines
from mcserver.machine.machine_file import load_machine, parse_machine
from tests.machine_text import axes_text

MILL = f'[machine]\nname = "mill"\n{axes_text(range(3))}[dialect]\nprofile = "cnc"\n'


def fault(code: str, line: int, message: str, axis: int | None = None) -> Diagnostic:
    return Diagnostic(code=code, message=message, line=line, axis=axis)


def test_messages_that_differ_in_measures_have_one_cause() -> None:
    found = [
        fault("MC201", line, f"axis 0 goes to {line}.5 mm, beyond its travel", 0) for line in range(2, 99)
    ]
    ((first, lines),) = by_cause(found)
    assert (first.line, lines) == (2, list(range(3, 99)))
    assert further_lines(lines) == "and on 96 more lines: 3, 4, 5, 6 … 98"


def test_codes_axes_and_severities_are_causes_of_their_own() -> None:
    found = [
        fault("MC110", 1, "M73 is not a code"),
        fault("MC110", 2, "M107 is not a code"),
        fault("MC201", 3, "axis 0 goes to 5 mm", 0),
        fault("MC201", 4, "axis 1 goes to 5 mm", 1),
        fault("MC110", 5, "M73 is not a code"),
    ]
    assert [(first.line, lines) for first, lines in by_cause(found)] == [(1, [5]), (2, []), (3, []), (4, [])]
    assert further_lines([5]) == "and on 1 more line: 5"
    assert further_lines([]) == ""


def test_a_line_with_two_faults_of_one_cause_is_counted_once() -> None:
    found = [fault("MC103", line, "J is not a word") for line in (1, 1, 2, 2)]
    assert [(first.line, lines) for first, lines in by_cause(found)] == [(1, [2])]


def test_a_long_file_with_one_mistake_on_each_line_has_one_cause() -> None:
    found = check_program("G1 X1 Y1 F100\nG1 XO\n" * 300, load_machine("cartesian"))
    assert len(found) >= 300
    assert len(by_cause(found)) == 1


def test_one_word_with_many_numbers_on_many_lines_has_one_cause() -> None:
    text = "G21 G99\n" + "".join(f"G1 X{n} F0.{10 + n}\nX{n} D{n + 1}\nG1 U2\n" for n in range(60))
    found = by_cause(check_program(text, parse_machine(MILL)))
    assert sorted(first.code for first, _ in found) == ["MC112", "MC113", "MC123"]


def test_of_a_program_for_a_lathe_only_its_codes_are_said() -> None:
    text = "G99\nT0303\nG1 X5 U2 F0.2\nG71 U1 R1\nG2 X0 Z9 R0.1\n"
    (turning, cycle) = check_program(text, parse_machine(MILL))
    assert (turning.code, cycle.code) == ("MC147", "MC141")
    assert "4 more faults of it are not shown" in turning.message


@pytest.mark.parametrize("profile", ["cnc", "robot", "printer"])
def test_coordinates_of_a_lathe_s_g50_do_not_move(profile: str) -> None:
    made = parse_machine(MILL.replace('"cnc"', f'"{profile}"'))
    found = check_program("G1 X0 F600\nG50 X100 Y20\n", made)
    assert "MC141" in {each.code for each in found if each.severity == "error"}
