"""Factors of printers: M220 of the feed, M221 of what is extruded, and their one extruder (D-141)."""

from __future__ import annotations

import pytest

from mcserver.gcode.modal_codes import modal_codes
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine
from mcserver.simulation.simulation import simulate
from tests.gcode.support import Program
from tests.gcode.test_retraction import E, ends, faults, printer

SQUARE = "G1 X20 E1\nG1 Y20 E2\nG1 X0 E3\nG1 Y0 E4"


def filament(program: str) -> list[float]:
    """Return where E is behind each line [mm]."""
    return [e for _, e in ends(program)]


def duration(program: str, machine: Machine | None = None) -> float:
    result = simulate(program, machine or printer())
    assert result.exit_code == 0, result.report["diagnostics"]
    return float(result.report["duration_s"])


def test_m221_multiplies_what_words_of_e_push() -> None:
    assert filament("M83\nM221 S95\nG1 X1 E10 F600\nG1 X2 E-2\nM221 S200\nG1 E1\nM221 S100\nG1 E1")[2:] == [
        *(9.5, 7.6, 7.6, 9.6, 9.6, 10.6)
    ]
    # absolute words mean what they meant: from 10 to 20 is 10
    assert filament("G1 E10 F600\nM221 S50\nG1 E20\nM221\nG1 E10\nM221 S100 T0\nG1 E12") == [
        *(10.0, 10.0, 15.0, 15.0, 10.0, 10.0, 12.0)
    ]
    assert filament("M221 S50\nG1 E10 F600\nG92 E4\nG1 E6\nG92 E0\nG1 E2\nM83\nG1 E2\nM82\nG1 E5")[1:] == [
        *(5.0, 5.0, 6.0, 6.0, 7.0, 7.0, 8.0, 8.0, 8.5)
    ]
    assert filament("G20\nM221 S50\nG1 E1 F60")[-1] == 12.7


def test_firmware_retraction_is_not_multiplied() -> None:
    assert filament("M221 S50\nG1 E10 F600\nG10\nM221 S100\nG11\nG1 E11") == [0.0, 5.0, 2.0, 2.0, 5.1, 6.1]


def test_m221_moves_as_words_of_e_that_are_multiplied_already() -> None:
    multiplied = (
        SQUARE.replace("E1", "E0.9").replace("E2", "E1.8").replace("E3", "E2.7").replace("E4", "E3.6")
    )
    one, other = (
        simulate(text, printer()).report for text in (f"M221 S90\n{SQUARE}", f"G92 E0\n{multiplied}")
    )
    assert one["axes"][str(E)]["position"] == pytest.approx(other["axes"][str(E)]["position"])
    assert one["duration_s"] == pytest.approx(other["duration_s"])
    assert one["axes"][str(E)]["position"] == pytest.approx(3.6)


def test_m220_multiplies_f_of_the_moves_behind_it() -> None:
    text = "{}\nG1 X20 F600\nG1 X0\nG1 X20 F1200"
    assert duration(text.format("M220 S50")) == duration(
        text.format("").replace("600", "300").replace("1200", "600")
    )
    # of an F that was given before, too, and not of G10 and G11
    assert duration("G1 X10 F600\nM220 S50\nX40") == duration("G1 X10 F600\nF300\nX40")
    assert duration("M220 S10\nG10\nG11") == duration("G10\nG11")


def test_m220_keeps_a_factor_and_brings_it_back() -> None:
    interpreter = Interpreter(printer())
    found = []
    for number, line in enumerate(
        ("M220 S80", "M220 B", "M220 S50", "M220 R", "M220 B S20", "M220", "M220 R"), start=1
    ):
        interpreter.interpret_text(line, number)
        found.append(interpreter.modal.pace)
    assert found == [0.8, 0.8, 0.5, 0.8, 0.2, 0.2, 0.8]
    assert "M220 S80" in modal_codes(interpreter.modal)


def test_a_start_in_the_middle_has_the_factors() -> None:
    program = Program(printer())
    program.run("M220 S50", "M221 S90", "G1 X5 E10 F600")
    whole = program.interpreter
    later = Interpreter(printer(), modal=whole.modal, positions=whole.positions)
    assert later.interpret_text("G1 X9 E20", 4) == whole.interpret_text("G1 X9 E20", 4)
    assert later.positions[E] == pytest.approx(0.018)


def test_lines_are_read_in_columns_under_m221_and_one_by_one_under_m220() -> None:
    interpreter = Interpreter(printer())
    found = []
    for number, line in enumerate(("G28", "M221 S95", "M220 S50", "M220 S100"), start=1):
        interpreter.interpret_text(line, number)
        interpreter.capture_before(interpreter.parse("G1 X1", number))
        found.append(interpreter.batch_window(number + 1) > 0)
    assert found == [True, True, False, True]


def test_the_factors_end_with_the_program() -> None:
    program = Program(printer())
    program.run("M220 S50", "M221 S90", "M2")
    assert (program.interpreter.modal.pace, program.interpreter.modal.flow) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("M220 S0", "MC116"),
        ("M221 S-5", "MC116"),
        ("M221 S", "MC116"),
        ("M221 B", "MC113"),
        ("M220 T0 S50", "MC113"),
        ("M221 T1 S95", "MC143"),
        ("M221 S95 S96", "MC111"),
        ("G1 X5 M221 S95", "MC153"),
        ("M220 S50 G1 X5", "MC153"),
        ("T1", "MC143"),
        ("T-1", "MC143"),
        ("G92 E0 T1", "MC143"),
    ],
)
def test_what_it_cannot_do_is_refused(text: str, code: str) -> None:
    assert faults(text) == [code]


def test_what_changes_nothing_is_passed_over() -> None:
    assert faults("M220 S100\nM221 S100\nM221\nM220\nM220 B\nM220 R") == []
    # without an extruder nothing is pushed; the speed is another one all the same
    assert faults("M220 S50\nM221 S50", printer("", "")) == ["MC142"]
    assert faults("T0\nM104 T1 S200") == ["MC142"]
    assert faults("T1", printer(letters='letters = { E = 6 }\nignore = ["T1"]')) == ["MC142"]


def test_a_factor_sets_no_output_of_s() -> None:
    fan = (
        'letters = { E = 6 }\n[dialect.outputs]\nM3 = { fan = "S" }\nM5 = { fan = 0 }\n'
        '[[output]]\nnumber = 0\nname = "fan"\nkind = "analog"\nmax = 300.0'
    )
    interpreter = Interpreter(printer("", fan))
    assert interpreter.interpret_text("M3 S200", 1)
    assert interpreter.interpret_text("M221 S95", 2) == interpreter.interpret_text("M220 S95", 3) == []


def test_codes_without_effect_are_named_with_their_decimals() -> None:
    found = check_program('M862.3 P "MK3"\nM862.1 P0.4\nM104 S200', printer())
    assert [each.code for each in found] == ["MC142"]
    assert found[0].message.endswith(": M104 (1), M862.1 (1), M862.3 (1)")
