"""Programs in the manner of the usual posts run unmodified under their profile (D-60)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mcserver.errors import ConfigurationError, Diagnostic
from mcserver.gcode.notices import notice_of
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.motion.canonical import PauseLine
from mcserver.simulation.simulation import simulate
from tests.machine_text import axes_text

FOLDER = Path(__file__).parent
FILES = sorted(
    path.name for path in FOLDER.iterdir() if path.suffix not in (".toml", ".py") and path.is_file()
)


def machine_of(profile: str) -> Machine:
    return load_machine(str(FOLDER / f"{profile}.toml"))


def errors(text: str, profile: str) -> list[Diagnostic]:
    return [each for each in check_program(text, machine_of(profile)) if each.severity == "error"]


def run(text: str, profile: str) -> dict[str, Any]:
    report = simulate(text, machine_of(profile)).report
    assert report["ok"], report["diagnostics"]
    return report


def ends(text: str, profile: str = "cnc") -> list[float]:
    axes = run(text, profile)["axes"]
    return [round(axes[str(axis)]["position"], 9) for axis in (0, 1, 2)]


@pytest.mark.parametrize("name", FILES)
def test_a_program_of_a_post_runs_unmodified(name: str) -> None:
    report = run((FOLDER / name).read_text("utf-8"), name.split(".")[-2])
    assert report["duration_s"] > 1.0
    assert report["feed_length_mm"] > 20.0
    # what has no effect is said once
    said = [each["code"] for each in report["diagnostics"]]
    assert len(said) == len(set(said))
    assert set(said) <= {"MC142", "MC154"}


@pytest.mark.parametrize("name", FILES)
def test_the_reference_s_dialect_stays_strict(name: str) -> None:
    described = (FOLDER / f"{name.split('.')[-2]}.toml").read_text("utf-8")
    head, _, rest = described.partition("[dialect]")
    machine = parse_machine(head + rest[rest.index("\n[") :])
    found = check_program((FOLDER / name).read_text("utf-8"), machine)
    assert name.startswith("welding") or any(each.severity == "error" for each in found)


def test_words_count_in_any_order() -> None:
    assert ends("X10 F1000 G1\nY5 G91\nX10 G0 G90") == [10.0, 5.0, 0.0]


def test_g90_beside_g53_stays_in_force_and_g91_is_refused_there() -> None:
    assert ends("G91 G0 X1\nG90 G53 G0 X2\nX5 Y1\nY1") == [5.0, 1.0, 0.0]
    for before in ("G90", "G91"):
        assert [each.code for each in errors(f"{before} G0 X1\nG91 G53 G0 X2", "cnc")] == ["MC153"]


def test_work_offsets_move_the_words_of_g90_alone() -> None:
    assert ends("G10 L2 P2 X100 Y50 Z5\nG55 G0 X1 Y1\nG91 G1 X1 F600") == [102.0, 51.0, 0.0]
    assert ends("G10 L2 P1 X100\nG0 X1\nG53 G0 X2\nY1") == [2.0, 1.0, 0.0]
    assert ends("G10 L2 P1 X100\nG91 G0 X1\nG53 G0 X2\nX1") == [3.0, 0.0, 0.0]
    assert ends("G0 X30\nG10 L20 P1 X0\nG1 X5 F600\nX6\nX7\nX8\nX9") == [39.0, 0.0, 0.0]
    assert ends("G20 G10 L2 P1 X1\nG21 G0 X0") == [25.4, 0.0, 0.0]


def test_an_arc_is_moved_by_the_work_offset() -> None:
    text = "G10 L2 P1 X100 Y100\nG0 X10 Y0\nG2 X0 Y-10 I-10 J0 F1000"
    assert ends(text) == pytest.approx([100.0, 90.0, 0.0])


def test_g92_makes_the_position_read_its_words() -> None:
    assert ends("G0 X30 Y10\nG92 X0\nG1 X5 Y20 F900") == [35.0, 20.0, 0.0]
    assert ends("G0 X30\nG92 X0\nG92.2\nG0 X5") == [5.0, 0.0, 0.0]
    assert ends("G0 X30\nG92 X0\nG92.2\nG92.3\nG0 X5") == [35.0, 0.0, 0.0]
    assert ends("G0 X30\nG92 X0\nG92.1\nG92.3\nG0 X5") == [5.0, 0.0, 0.0]
    assert ends("G52 X7\nG0 X1\nG52 X0\nG0 Y1") == [8.0, 1.0, 0.0]
    for text in ("G52 X7\nG92 X0", "G92 X5\nG52 X0", "G52 X7\nG92.1"):
        assert [each.code for each in errors(text, "cnc")] == ["MC186"]


def test_g43_adds_the_tools_length_and_g49_takes_it_out() -> None:
    assert ends("T1 M6\nG43 H1\nG0 Z5") == [0.0, 0.0, 25.0]
    assert ends("T2 M6\nG43\nG0 Z5\nG49\nG0 Z6 X1") == [1.0, 0.0, 6.0]
    assert ends("G43.1 Z5\nG0 Z5") == [0.0, 0.0, 10.0]
    assert [each.code for each in errors("G43 H9\nG0 Z1", "cnc")] == ["MC143"]


def test_a_tool_that_is_only_made_ready_gives_no_length() -> None:
    assert ends("T1 M6\nT2\nG43\nG0 Z5") == ends("T2\nM61 Q1\nG43\nG0 Z5") == [0.0, 0.0, 25.0]
    assert [each.code for each in errors("G43 H1.5\nT1.5\nM61", "cnc")] == ["MC116", "MC116", "MC118"]


def test_g28_goes_by_its_point_to_the_stored_position() -> None:
    assert ends("G0 X10 Y10 Z10\nG91 G28 Z0\nG90 G0 X5") == [5.0, 10.0, 0.0]
    assert ends("G0 X10 Y3\nG28.1\nG0 X50 Y50 Z5\nG28") == [10.0, 3.0, 0.0]
    axes = run("G0 X10\nG28 X60", "cnc")["axes"]
    assert (axes["0"]["position"], axes["0"]["max"]) == (0.0, 60.0)


@pytest.mark.parametrize("line", ["G0 G91 G28 Z0", "G28G91G0Z0", "G0 G91 G30 Z0", "G1 G91 G28 Z0"])
def test_g0_beside_g28_leaves_it_the_words(line: str) -> None:
    apart = [
        each
        for each in line.replace("G28", " G28 ").replace("G0", " ").replace("G1 ", " ").split(" ")
        if each
    ]
    before = "G0 X30 Z-20\n"
    assert ends(before + line + "\nG90") == ends(before + " ".join(apart) + "\nG90")


def test_g0_beside_g28_is_in_force_behind_it() -> None:
    lines = run("G1 X10 F60\nG0 G91 G28 Z0\nG90 X0", "cnc")["lines"]
    assert lines[-1]["requested_s"] is None
    assert errors("G2 G91 G28 Z0", "cnc") != []
    # P would be another point, which is not there
    assert [each.code for each in errors("G0 G91 G30 P2 Z0", "cnc")] == ["MC113"]


def test_the_spindle_is_an_axis_that_goes_on_turning() -> None:
    report = run("S600 M3\nG4 P1\nG1 X10 F600\nM5\nG4 P1", "cnc")
    assert report["axes"]["6"]["max"] > 3600.0
    assert [each.code for each in errors("S90000 M3", "cnc")] == ["MC202"]


def test_relative_extrusion_leaves_x_and_y_absolute() -> None:
    report = run("M83\nG1 X10 E1 F600\nX10 Y10 E1\nM82\nG1 X20 E5", "printer")
    assert report["axes"]["6"]["position"] == pytest.approx(5.0)
    assert report["axes"]["6"]["max"] == pytest.approx(5.0)
    assert report["lines"][0]["requested_s"] == pytest.approx(1.0)


def test_the_feed_counts_x_y_z_and_others_go_along() -> None:
    lines = run("G1 X10 A720 F600\nA0 F3600", "cnc")["lines"]
    assert [line["requested_s"] for line in lines] == pytest.approx([1.0, 12.0])


def test_the_feed_of_an_arc_counts_x_y_z_and_the_extruder_goes_along() -> None:
    lines = run("M83\nG1 X10 Y10 F1200\nG2 X20 I5 J0 E10\nG2 X30 Z3 I5 J0 E9", "printer")["lines"]
    turn = math.pi * 5.0
    assert [line["requested_s"] for line in lines[1:]] == pytest.approx(
        [turn / 20.0, math.hypot(turn, 3.0) / 20.0]
    )


def test_a_dwell_is_milliseconds_on_a_printer_and_seconds_on_a_mill() -> None:
    assert run("G4 P1500\nG0 X1", "printer")["lines"][0]["requested_s"] == pytest.approx(1.5)
    assert run("G4 P1.5\nG0 X1", "cnc")["lines"][0]["requested_s"] == pytest.approx(1.5)


def test_expressions_and_o_words_are_refused_once_for_the_file() -> None:
    text = "#1 = 5\nG1 X[#1+2] F100\no100 sub\no100 endsub\n" * 20
    (fault,) = errors(text, "printer")
    assert (fault.code, fault.line) == ("MC140", 1)


@pytest.mark.parametrize(
    ("text", "profile"),
    [
        ("# the first layer\nG28", "printer"),
        ("O7997A (SHEET)\nG0 X1", "robot"),
        ("<<<<<<< HEAD\nG0 X1\n=======\nG0 X2\n>>>>>>> branch", "cnc"),
    ],
)
def test_what_is_no_expression_is_not_said_to_compute(text: str, profile: str) -> None:
    found = errors(text, profile)
    assert {each.code for each in found} <= {"MC102", "MC103"}
    assert found[0].line == 1


def test_the_conveyor_of_a_haas_has_no_effect() -> None:
    (said,) = check_program("M31\nM88\nG0 X1\nM89\nM33\nM30", machine_of("cnc"))
    assert (said.code, "M31 (1)" in said.message) == ("MC142", True)


@pytest.mark.parametrize("line", ["R1=5", "G1 X=R1", "#5=1", "G1 X[1+2]", "#<a>=1", "G1 X#<a>", "G1 X##2"])
def test_what_computes_is_said_to(line: str) -> None:
    assert [each.code for each in errors(line, "printer")] == ["MC140"]


def test_what_has_no_effect_is_listed_once_with_its_count() -> None:
    found = check_program("G67 G49\nM8\nM8\nG1 X1 F100", machine_of("cnc"))
    assert [(each.code, each.severity) for each in found] == [("MC142", "warning")]
    assert "G67 (1), M8 (2)" in found[0].message


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("G38.2 Z-5 F100", "probe"),
        ("M98 P100", "subprogram"),
        ("G87 X1 Y1 Z-3 R2 F100", "boring"),
        ("G54.1 P1", "G59.3"),
    ],
)
def test_what_cannot_be_done_is_refused_with_its_reason(line: str, reason: str) -> None:
    (fault,) = errors(line, "cnc")
    assert fault.code == "MC141"
    assert reason in fault.message + fault.hint


def test_a_macro_is_refused_unless_the_machine_file_lists_it() -> None:
    (fault,) = errors("START_PRINT BED=60", "printer")
    assert (fault.code, "ignore" in fault.hint) == ("MC145", True)
    assert errors("PRINT_START BED=60", "printer") == []


def test_a_fault_behind_other_words_keeps_its_columns() -> None:
    (fault,) = errors("S100 M3 G1 X9000 F100", "cnc")
    assert (fault.code, fault.column, fault.end_column) == ("MC201", 12, 17)


def test_a_change_to_another_tool_pauses_and_the_first_does_not() -> None:
    text = "T1 M6\nG0 X1\nT1 M6\nG0 X2\nT2 M6\nG0 X3"
    assert ends(text) == [3.0, 0.0, 0.0]


def test_a_move_that_nothing_energizes_is_warned_of_by_check() -> None:
    machine = load_machine("cartesian")
    (warning,) = check_program("G01 X10 F100", machine, at_rest=True)
    assert (warning.code, warning.severity, warning.axis) == ("MC144", "warning", 0)
    assert check_program("G1010\nG01 X10 F100", machine, at_rest=True) == []
    assert check_program("G00 X1\nG01 X10 F100", machine, at_rest=True) == []
    assert check_program("G01 X10 F100", machine_of("cnc"), at_rest=True) == []


@pytest.mark.parametrize("code", ["G1010", "G1010P0", "G01010 P0", "g1010p0", "G 1010 P0"])
def test_the_reference_s_own_codes_are_read_with_any_spacing(code: str) -> None:
    assert errors(f"{code}\nG0 X1\n", "cnc") == []


def test_g5_1_without_a_curve_and_units_by_din_66025_are_read() -> None:
    assert ends("G05.1 Q1\nG70\nG0 X1\nG71\nG0 Y1\nG5.1 Q0") == [25.4, 1.0, 0.0]
    assert [each.code for each in errors("G5.1 X1 Y1 I1 J1", "robot")] == ["MC141"]
    assert [each.code for each in errors("G71 Q100 X5 Z-3 D1 I1 R1", "cnc")] == ["MC147", "MC141"]


def test_lookahead_of_g5_without_a_curve_has_no_effect() -> None:
    assert ends("G05 P10000\nG0 X1\nG5 P0") == [1.0, 0.0, 0.0]
    assert errors("M117 Printing...\nG5\nG92 E0", "printer") == []


def test_the_rest_of_a_comment_settings_of_firmware_and_a_word_without_a_number_are_one_fault_each() -> None:
    found = errors("to release some of the pressure\n$110=500\n", "printer")
    assert [(each.code, each.line) for each in found] == [("MC103", 1), ("MC103", 2)]
    assert "comment" in found[0].message
    assert "firmware" in found[1].message
    (fault,) = errors("G28 X ; home\n", "cnc")
    assert (fault.code, fault.hint) == ("MC102", "write X0 if zero is meant")


def test_a_text_behind_m0_of_printers_is_what_the_pause_says() -> None:
    assert errors("M0 Click to continue\nM1 take the part out", "printer") == []
    assert notice_of("M0 Click to continue ; now", [PauseLine(1)], printer=True) == "Click to continue"


def test_codes_of_printers_makers_go_without_effect() -> None:
    assert errors("M1002 gcode_claim_action : 2\nG1 X5 E1", "printer") == []


def test_p_of_a_dwell_stays_with_it_beside_a_motion() -> None:
    report = run("N90 G04 P.5 G0 X10 Y5 S1000 M3\nG1 X11 F600", "cnc")
    assert report["axes"]["0"]["position"] == pytest.approx(11.0)
    assert 0.5 < report["lines"][0]["end_s"] - report["lines"][0]["start_s"] < 1.0
    assert report["axes"]["6"]["max"] > 100.0
    assert run("S600 M3 G4 P.5\nG1 X1 F600", "cnc")["lines"][0]["end_s"] < 1.0
    assert run("G4 X1.5\nG1 X1 F600", "cnc")["lines"][0]["requested_s"] == pytest.approx(1.5)
    assert [each.code for each in errors("G4 G0 X10", "cnc")] == ["MC118"]


def test_files_with_carriage_returns_too_many_are_read() -> None:
    assert ends("G0 X5\r\r\nG1 Y3 F600\r\r\n\x1a") == [5.0, 3.0, 0.0]


def test_u_v_w_are_no_increments_of_x_y_z_in_a_mill_s_program() -> None:
    (fault,) = errors("G0 X1 U5", "cnc")
    assert (fault.code, "letters" in fault.hint) == ("MC112", True)
    described = (FOLDER / "cnc.toml").read_text("utf-8")
    machine = parse_machine(described.replace('profile = "cnc"', 'profile = "cnc"\nletters = { U = 3 }'))
    report = simulate("G0 X1 U5\nG1 U7 X2 F600", machine).report
    assert report["ok"], report["diagnostics"]
    assert [round(report["axes"][axis]["position"], 9) for axis in ("0", "3")] == [2.0, 7.0]


@pytest.mark.parametrize("profile", ["cnc", "robot"])
@pytest.mark.parametrize("word", ["X1e2", "Y2E1", "X1 F1E+2", "X1 F6e-1"])
def test_an_exponent_is_a_fault_and_never_another_number(profile: str, word: str) -> None:
    (fault,) = errors(f"G1 F600 {word}" if "F" not in word else f"G1 {word}", profile)
    assert fault.code == "MC102"


@pytest.mark.parametrize("profile", ["cnc", "robot", "printer"])
def test_an_axis_e_is_named_by_its_letter_and_has_no_exponent_either(profile: str) -> None:
    described = (FOLDER / "cnc.toml").read_text("utf-8")
    lettered = described.replace('profile = "cnc"', f'profile = "{profile}"\nletters = {{ E = 3 }}')
    found = {
        text: [
            (each.code, each.message) for each in check_program(f"G1 F600 {text}", parse_machine(lettered))
        ]
        for text in ("X50 E1e2", "X50 E1 E2", "X50E2", "X50 E99999999999")
    }
    assert found["X50 E1e2"] == [("MC102", "numbers have no exponent here: 'E1E2'")]
    assert found["X50 E1 E2"] == [("MC111", "E stands twice in one command")]
    assert found["X50E2"] == []
    assert all("[3]" not in message for _, message in found["X50 E99999999999"])


@pytest.mark.parametrize("word", ["Q5", "D4", "L2", "E3", "H1"])
def test_a_word_that_no_code_of_its_line_takes_is_a_fault(word: str) -> None:
    for line in (f"G0 X1 {word}", f"G1 X1 F100 {word}", f"G2 X1 Y1 R5 F100 {word}", word):
        assert [each.code for each in errors(f"G0 X0\n{line}", "cnc")] == ["MC113"], line


@pytest.mark.parametrize(
    "line", ["G64 P0.01 Q0.02", "G43 H1", "G43 G0 Z5 H1", "G49 H0", "G5.1 Q1", "M7 P5", "T1 M6 H1", "G4 P1"]
)
def test_words_stay_with_the_codes_that_take_them(line: str) -> None:
    assert errors(line, "cnc") == []


def test_an_extruder_that_is_not_there_is_listed_as_without_effect() -> None:
    text = (FOLDER / "printer.toml").read_text("utf-8").replace("letters = { E = 6 }\n", "")
    found = check_program("G1 X1 E3 F600\nG92 E0", parse_machine(text))
    assert [(each.code, "E (1)" in each.message) for each in found] == [("MC142", True)]


def test_an_offset_of_0_outside_the_plane_of_an_arc_says_nothing() -> None:
    assert ends("G2 X10 Y0 I5 J0 K0.000 F600") == [10.0, 0.0, 0.0]
    assert ends("G18 G3 X2 Z0 I1 J0 K0 F600") == [2.0, 0.0, 0.0]
    assert [each.code for each in errors("G2 X10 Y0 I5 J0 K1 F600", "cnc")] == ["MC131"]


@pytest.mark.parametrize("line", ["G29 P1", "G29.2 S0", "G280", "G392 S0", "M1002 judge_flag"])
def test_printers_probing_and_priming_have_no_effect(line: str) -> None:
    (said,) = check_program(f"G28\n{line}\nG1 X10 F1000", machine_of("printer"))
    assert (said.code, said.severity) == ("MC142", "warning")


def test_what_is_printed_otherwise_without_a_code_is_said() -> None:
    text = "M104 S200\nBED_MESH_PROFILE LOAD=a\nM900 K0.1\nM622 J0\nG1 X10 F1000\nM623"
    (said,) = check_program(text, machine_of("printer"))
    for code, what in (
        ("M104", "heated"),
        ("BED_MESH_PROFILE", "flat"),
        ("M900", "more"),
        ("M622", "any case"),
    ):
        (clause,) = [each for each in said.hint.split("; ") if each.startswith(f"{code}: ")]
        assert what in clause


@pytest.mark.parametrize("line", ["M200 D1.75", "M200 S1", "M200 D1.75 T0", "N5 M200 L2"])
def test_e_as_a_volume_is_refused(line: str) -> None:
    assert [each.code for each in errors(f"{line}\nG1 E5", "printer")] == ["MC141"]


@pytest.mark.parametrize("line", ["M200 D0", "M200 D0 T0", "M200 S0", "M200", "M200 D0.0 ; off"])
def test_e_as_a_length_goes_on_without_effect(line: str) -> None:
    assert errors(f"{line}\nG1 E5", "printer") == []


def test_g0_of_a_printer_is_g1_with_its_feed_and_all_axes_in_step() -> None:
    found = run("G28\nG0 X110 E5 F600", "printer")
    (line,) = [each for each in found["lines"] if each["line"] == 2]
    assert line["end_s"] - line["start_s"] == pytest.approx(11.0, rel=0.01)
    assert found["axes"]["6"]["position"] == pytest.approx(5.0)


def straight() -> Machine:
    described = (FOLDER / "cnc.toml").read_text("utf-8")
    return parse_machine(described.replace("[dialect]", '[dialect]\nrapids = "straight"'))


def test_a_straight_rapid_is_as_fast_as_its_slowest_axis_and_asks_for_no_time() -> None:
    text = "G0 X300 Y100 Z50\nM30"
    done = simulate(text, straight(), record=True)
    line = done.report["lines"][0]
    # X needs 1.5 s at its 200 mm/s and is at its limit all the way; Z, at its own, would need 0.5 s
    assert line["end_s"] - line["start_s"] == pytest.approx(1.6, abs=0.05)
    assert line["requested_s"] is None
    assert done.recording is not None
    moved = done.recording.setpoint[:, :3] / np.array([300.0, 100.0, 50.0])
    assert np.abs(moved - moved[:, :1]).max() < 1e-9


def test_the_reference_has_no_straight_rapids() -> None:
    with pytest.raises(ConfigurationError, match="D-20"):
        parse_machine(f'[machine]\nname = "m"\n[dialect]\nrapids = "straight"\n{axes_text()}')


@pytest.mark.parametrize("code", ["M601", "M25", "M226", "M600", "M125"])
def test_a_printer_s_program_pauses_where_its_firmware_would(code: str) -> None:
    values = Interpreter(machine_of("printer")).interpret_text(code, 1)
    assert [type(each) for each in values] == [PauseLine]


def test_m112_ends_the_program_of_a_printer() -> None:
    assert ends("G28\nG1 X10 F6000\nM112\nG1 X50", "printer")[0] == 10.0


@pytest.mark.parametrize(
    ("line", "profile", "code"),
    [
        ("G50 X100 Z200", "cnc", "MC141"),
        ("G50 S3000", "cnc", "MC141"),
        ("M206 X5", "printer", "MC141"),
        ("G61 X Y Z", "printer", "MC110"),
        ("M290 Z0.1", "printer", "MC141"),
        ("G43.4 H1", "cnc", "MC171"),
        ("G12.1", "cnc", "MC110"),
        ("G0 G43 H9 Z5", "cnc", "MC143"),
        ("G99 G1 X5 F0.2", "cnc", "MC123"),
    ],
)
def test_what_would_move_elsewhere_is_refused(line: str, profile: str, code: str) -> None:
    fault = errors(line, profile)[-1]
    assert fault.code == code
    assert "ignore" not in fault.hint


def test_g43_of_a_tool_without_a_length_is_refused_on_a_machine_without_a_table_too() -> None:
    described = (FOLDER / "cnc.toml").read_text("utf-8").partition("[[cutter]]")[0]
    found = check_program("T2 M6\nG43 H2\nG0 Z5", parse_machine(described))
    assert [(each.code, each.line) for each in found if each.severity == "error"] == [("MC143", 2)]
    assert "number = 2" in found[-1].hint


def test_a_refused_code_is_said_once_with_its_lines_and_a_lathe_is_named() -> None:
    text = "\n".join(["G50 S2000", *["G71 U1 R1"] * 60, "G72 W1"])
    found = [each for each in errors(text, "cnc") if each.code in ("MC141", "MC147")]
    assert [(each.code, each.line) for each in found] == [
        ("MC147", 1),
        ("MC141", 1),
        ("MC141", 2),
        ("MC141", 62),
    ]
    assert "lathe" in found[0].message
    assert "(60 lines)" in found[2].message


def test_offsets_alone_repeat_an_arc() -> None:
    assert ends("G17 G0 X0 Y0\nG2 X10 Y0 I5 J0 F6000\nI5 J0\nG1 X3") == [3.0, 0.0, 0.0]
    assert [each.code for each in errors("G1 X0 F60\nI5 J0", "cnc")] == ["MC112", "MC112"]


def test_words_beside_a_code_without_effect_are_named() -> None:
    (said,) = [each for each in check_program("G67 D3 X1", machine_of("cnc")) if each.code == "MC142"]
    assert "D beside G67 (1)" in said.message


def test_outputs_that_the_machine_lacks_are_warned_of_once() -> None:
    found = check_program("M68 E0 Q1\nG0 X1\nM68 E0 Q2\nG40.1", machine_of("cnc"))
    assert [each.code for each in found] == ["MC142"]
    assert "M68 (2)" in found[0].message


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G1 X20 ,A45 F100", "MC141"),  # as a comma group it would turn the axis A
        ("G1 X20.,C5. F100", "MC141"),
        ("G1 X20 , R3 F100", "MC141"),
        ("%NEU G70", "MC103"),  # inches
        ("% G0 X5", "MC103"),
        ("S500 M3\nM19 S90", "MC112"),
    ],
)
def test_words_that_mean_something_else_on_other_controllers_are_refused(line: str, code: str) -> None:
    assert [each.code for each in errors(f"{line}\nG0 X1", "cnc")] == [code]


def test_groups_with_codes_and_titles_are_read_beside_them() -> None:
    assert errors("%O1234 TITLE\nG1 X20 F600, G1 A45\n%", "cnc") == []


@pytest.mark.parametrize("line", ["G10 L2 P0 Z-5", "G10 L1 P1 R50"])
def test_g10_of_fanuc_that_means_something_else_there_is_refused(line: str) -> None:
    text = (FOLDER / "cnc.toml").read_text("utf-8").replace("[dialect]", '[dialect]\nmacros = "fanuc"')
    fanuc = parse_machine(text)
    assert [each.code for each in check_program(line, fanuc)] == ["MC141"]
    # as mcctl and the page write them
    assert check_program("G10 L2 P1 Z-5\nG10 L1 P1 Z50 R3", fanuc) == []
    found = check_program("G21 G90 G10 L20 P1 X5", fanuc)
    assert [(each.code, each.severity) for each in found] == [("MC199", "warning")]


def test_a_dwell_of_a_printer_in_seconds_is_not_said_to_have_no_effect() -> None:
    assert check_program("G28\nG4 S2", machine_of("printer")) == []


def test_holes_on_a_circle_make_no_lathe_of_a_mill() -> None:
    text = "G81 Z-5 R2 F100 L0\nG70 I5. J15. L6\nG80"
    assert [each.code for each in errors(text, "cnc")] == ["MC141"]


def test_nobody_is_told_to_ignore_a_macro_that_moves_the_tool() -> None:
    moving, idle = errors("SET_GCODE_OFFSET Z=0.1\nMY_MACRO", "printer")
    assert "ignore" not in moving.hint
    assert "ignore" in idle.hint


def test_a_g4_in_milliseconds_is_pointed_out() -> None:
    found = check_program("G4 P500\nG4 P60", machine_of("cnc"))
    assert [(each.code, each.line, each.severity) for each in found] == [("MC129", 1, "warning")]


def test_the_pause_of_bambu_studio_pauses_and_m400_alone_does_not() -> None:
    interpreter = Interpreter(machine_of("printer"))
    lines = ("M400", "M400 S1", "M400 U1", "M400 U1 ; magnet")
    found = [interpreter.interpret_text(text, line) for line, text in enumerate(lines, start=1)]
    assert [[type(each) for each in values] for values in found] == [[], [], [PauseLine], [PauseLine]]


def test_a_file_that_a_printer_would_run_is_not_passed_over() -> None:
    (fault,) = errors('M98 P"home.g"', "printer")
    assert (fault.code, 'ignore = ["M98"]' in fault.hint) == ("MC110", True)
