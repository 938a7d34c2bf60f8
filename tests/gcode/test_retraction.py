"""Firmware retraction of printers (D-115)."""

from __future__ import annotations

import pytest

from mcserver.errors import ConfigurationError
from mcserver.gcode.axes_used import axes_used
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.simulation.simulation import simulate
from tests.gcode.support import Program
from tests.machine_text import axes_text

SETTINGS = "[dialect.retraction]\nlength_mm = 3\nspeed = 45\nhop_mm = 0.5\nrecover_speed = 20\nextra_mm = 0.1"
E = 6


def printer(
    settings: str = SETTINGS, letters: str = "letters = { E = 6 }", profile: str = "printer"
) -> Machine:
    axes = axes_text((0, 1, E)) + axes_text((2,), velocity=20.0, keys="min_position = 0\nmax_position = 100")
    return parse_machine(
        f'[machine]\nname = "p"\n[motion]\npath_tolerance_mm = 0.05\n[dialect]\nprofile = "{profile}"\n'
        f"{letters}\n{settings}\n{axes}"
    )


def ends(program: str, machine: Machine | None = None) -> list[tuple[float, float]]:
    """Return where Z and E are behind each line [mm]."""
    interpreter = Interpreter(machine or printer())
    found = []
    for number, line in enumerate(program.split("\n"), start=1):
        interpreter.interpret_text(line, number)
        found.append(tuple(round(interpreter.positions[axis] * 1000.0, 6) for axis in (2, E)))
    return [(z, e) for z, e in found]


def faults(text: str, machine: Machine | None = None) -> list[str]:
    return [each.code for each in check_program(text, machine or printer())]


def test_it_moves_as_the_same_moves_of_e_and_z_do() -> None:
    firmware = "G1 X20 Z1 E2 F3000\nG10\nG1 X60 Y5\nG11\nG1 X80 E3\nG1 X90 E4"
    slicer = (
        "M83\nG1 X20 Z1 E2 F3000\nG1 E-3 F2700\nG1 Z1.5 F1200\nG1 X60 Y5 F3000\nG1 Z1 F1200\n"
        "G1 E3.1 F1200\nG1 X80 E1 F3000\nG1 X90 E1"
    )
    one, other = (simulate(text, printer()) for text in (firmware, slicer))
    assert one.exit_code == other.exit_code == 0
    assert one.report["duration_s"] == other.report["duration_s"]
    assert one.report["axes"] == other.report["axes"]


def test_absolute_words_mean_what_they_meant() -> None:
    assert ends("G1 Z1 E10 F600\nG10\nG1 X5 Z2\nG1 E11\nG11\nG1 Z1 E12") == [
        (1.0, 10.0),
        (1.5, 7.0),
        (2.5, 7.0),
        (2.5, 8.0),
        (2.0, 11.1),
        (1.0, 12.1),
    ]
    # G92 says what the program calls the place, and the filament is as far back as before
    assert ends("G1 E10 F600\nG10\nG92 E0\nG11\nG1 E1")[-2:] == [(0.0, 10.1), (0.0, 11.1)]


def test_a_second_g10_and_a_g11_without_one_do_nothing() -> None:
    assert ends("G11\nG10\nG10\nG11\nG11") == [(0.0, 0.0), (0.5, -3.0), (0.5, -3.0), (0.0, 0.1), (0.0, 0.1)]


def test_m207_and_m208_set_it_and_g11_undoes_what_g10_did() -> None:
    assert ends("M207 S2 Z0 F600\nG10\nM207 S5 Z1\nM208 S0\nG11\nG20\nM207 S1 Z0\nG10") == [
        *((0.0, 0.0), (0.0, -2.0), (0.0, -2.0), (0.0, -2.0)),
        *((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, -25.4)),
    ]
    assert ends("M207 S1 F600\nG10\nG11", printer("")) == [(0.0, 0.0), (0.0, -1.0), (0.0, 0.0)]
    assert faults("M2\nG10", printer("")) == []


def test_what_was_set_and_drawn_back_ends_with_the_program() -> None:
    program = Program(printer())
    program.run("M207 S1", "G10", "M2")
    assert program.interpreter.modal.frame is None


def test_a_z_that_is_homed_is_lifted_no_longer() -> None:
    assert ends("G1 Z5 F600\nG10\nG28 Z\nG11\nG1 Z1") == [(5, 0), (5.5, -3), (0, -3), (0, 0.1), (1, 0.1)]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("G10 S1", "MC194"),
        ("G10 L20 P1 X0", "MC194"),
        ("G10 P0 S200 R180", "MC194"),
        ("G11 E3", "MC194"),
        ("M207 W13", "MC113"),
        ("M208 Z1", "MC113"),
        ("M207 S3 S4", "MC111"),
        ("M207 S-1", "MC116"),
        ("M208 F0", "MC116"),
        ("G1 X5 F600 G10", "MC153"),
        ("G11 G1 X5", "MC153"),
        ("G1 Z99.8 F600\nG10", "MC201"),
        ("G10 X5 T1 $", "MC103"),
    ],
)
def test_other_words_are_refused(text: str, code: str) -> None:
    assert set(faults(text)) == {code}


@pytest.mark.parametrize(
    ("text", "message", "remedy"),
    [
        ("G10 P1 R200 S210", "G10 is a retraction here, and takes no P1 R200 S210", "M104 and M109"),
        ("G10 P0 S200", "G10 is a retraction here, and takes no P0 S200", "M104 and M109"),
        ("G10 L2 P1 X0", "G10 is a retraction here, and takes no L2 P1 X0", "G92"),
        ("G10 S1", "G10 is a retraction here, and takes no S1", "one extruder"),
        ("G11 E3", "G11 is a retraction here, and takes no E3", "G1"),
    ],
)
def test_other_words_are_one_fault_that_advises_no_retraction(text: str, message: str, remedy: str) -> None:
    (fault,) = check_program(text, printer())
    assert (fault.code, fault.message) == ("MC194", message)
    assert remedy in fault.hint
    assert "alone" not in fault.hint
    # without a length, too, it is that fault alone
    assert [each.message for each in check_program(text, printer(""))] == [message]


def test_without_a_length_or_an_extruder_it_is_refused() -> None:
    assert faults("G10", printer("")) == ["MC194"]
    assert faults("M207 S3\nG10", printer("")) == ["MC194"]
    # M208 without an extruder has no effect, as E has none
    assert sorted(faults("M208 F300\nG10\nG11", printer("", ""))) == ["MC141", "MC141", "MC142"]
    assert faults("G10", printer("", profile="cnc")) == ["MC141"]
    assert faults("G10 L20 P1 X0", printer("", profile="cnc")) == []
    assert faults("N3 G10 S0*45 ; back\ng11", printer()) == []


@pytest.mark.parametrize(("letters", "profile"), [("", "printer"), ("letters = { E = 6 }", "cnc")])
def test_only_a_printer_with_an_extruder_may_have_the_section(letters: str, profile: str) -> None:
    with pytest.raises(ConfigurationError, match="only printers with an extruder retract"):
        printer(SETTINGS, letters, profile)


@pytest.mark.parametrize(
    ("text", "axes"),
    [("G1 X1 E5", (0, E)), ("G10\nG11", (2, E)), ("G28", (0, 1, 2)), ("G28 X", (0,)), ("G92 Y1 E0", (1, E))],
)
def test_who_asks_for_a_run_gets_all_axes_that_it_needs(text: str, axes: tuple[int, ...]) -> None:
    assert axes_used(text, printer()) == axes


def test_the_codes_are_no_ones_outputs() -> None:
    with pytest.raises(ConfigurationError):
        printer('[dialect.outputs]\nM207 = { fan = true }\n[[output]]\nnumber = 0\nname = "fan"')
