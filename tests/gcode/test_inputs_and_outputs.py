"""M62 to M68 and codes that are given to outputs (D-70 to D-73)."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.errors import ProgramRejected
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.motion.canonical import (
    Canonical,
    EndLine,
    InputLine,
    MotionLine,
    OutputLine,
    OutputSetting,
    WaitMode,
)
from tests.gcode.support import Program
from tests.machine_text import axes_text

CHANNELS = """
[[input]]
number = 0
name = "part"
[[input]]
number = 7
name = "air"
kind = "analog"
[[output]]
number = 0
name = "laser"
[[output]]
number = 5
name = "clamp"
[[output]]
number = 0
name = "power"
kind = "analog"
unit = "W"
max = 100.0
[[output]]
number = 1
name = "rpm"
kind = "analog"
max = 24000.0
"""
LASER, CLAMP, POWER, RPM = range(4)


def machine(
    profile: str = "reference", channels: str = CHANNELS, mapped: str = "", extra: str = ""
) -> Machine:
    text = f'[machine]\nname = "cell"\n[dialect]\nprofile = "{profile}"\n{extra}\n'
    text += f"[dialect.outputs]\n{mapped}\n" if mapped else ""
    return parse_machine(text + axes_text((0, 1, 2, 6), velocity=500.0, acceleration=5000.0) + channels)


def interpret(described: Machine, *lines: str) -> list[Canonical]:
    return Program(described).run(*lines)


def codes(described: Machine, *lines: str) -> list[str]:
    return [each.code for each in check_program("\n".join(lines), described) if each.severity == "error"]


def now(column: int, value: float, line: int = 1) -> OutputLine:
    return OutputLine(line, (OutputSetting(column, value),), with_motion=False)


def with_motion(column: int, value: float, line: int = 1) -> OutputLine:
    return OutputLine(line, (OutputSetting(column, value),), with_motion=True)


@pytest.mark.parametrize("profile", ["reference", "cnc", "printer", "robot"])
@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("M62 P0", with_motion(LASER, 1.0)),
        ("M63 P5", with_motion(CLAMP, 0.0)),
        ("m64p5", now(CLAMP, 1.0)),
        ("N10 M65 P5 (open)", now(CLAMP, 0.0)),
        ("M67 E0 Q40.5", with_motion(POWER, 40.5)),
        ("M68 E1 Q24000", now(RPM, 24000.0)),
        ("M66 P0 L3 Q5", InputLine(1, 0, WaitMode.HIGH, 5.0)),
        ("M66 P0 L2 Q0.5", InputLine(1, 0, WaitMode.FALL, 0.5)),
        ("M66 P0", InputLine(1, 0, WaitMode.IMMEDIATE, 0.0)),
        ("M66 E7 L0", InputLine(1, 1, WaitMode.IMMEDIATE, 0.0)),
    ],
)
def test_what_a_line_does(profile: str, text: str, value: Canonical) -> None:
    assert interpret(machine(profile), text) == [value]


def test_an_output_stands_before_the_motion_of_its_line() -> None:
    values = interpret(machine("cnc"), "G1 X10 F600 M62 P0")
    assert values[0] == with_motion(LASER, 1.0)
    assert isinstance(values[1], MotionLine)


@pytest.mark.parametrize(
    "text",
    [
        "G01 X10 G01 Y20 F600",
        "G01 X10, G01 Y20 F600",
        "G01 X10 G91 Y5 F600",
        "G02 X10 Y0 R5 G01 Z3 F600",
        "G1020 X5",
        "M30",
        "GO1 X5",
        "G01 X5 X6 F600",
        "G99",
    ],
)
def test_outputs_change_nothing_of_how_the_reference_s_lines_are_read(text: str) -> None:
    with_outputs, without = machine(), machine(channels="")
    assert check_program(text, with_outputs) == check_program(text, without)
    if not check_program(text, without):
        assert interpret(with_outputs, text) == interpret(without, text)


def test_p_of_m62_is_no_turn_of_an_arc() -> None:
    values = interpret(machine("cnc"), "G2 X10 Y0 I5 J0 F600 M62 P5")
    arc = values[1]
    assert isinstance(arc, MotionLine)
    assert interpret(machine("cnc"), "G2 X10 Y0 I5 J0 F600")[0].groups == arc.groups  # type: ignore[union-attr]


def test_e_names_an_analog_channel_where_it_is_an_axis_elsewhere() -> None:
    described = machine("printer", extra="letters = { E = 6 }")
    assert interpret(described, "M67 E0 Q5") == [with_motion(POWER, 5.0)]
    assert codes(described, "G1 X1 E5 F600 M67 E0 Q5") == ["MC153"]


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("M62 P1", "MC150"),
        ("M62 P64", "MC150"),
        ("M62 P-1", "MC150"),
        ("M62 P0.5", "MC150"),
        ("M62 P99999999999999999999", "MC150"),
        ("M67 E5 Q1", "MC150"),
        ("M66 P5 L3 Q1", "MC150"),
        ("M66 E0", "MC150"),
        ("M62", "MC118"),
        ("M67 E0", "MC118"),
        ("M67 Q1", "MC118"),
        ("M66", "MC118"),
        ("M67 E0 Q100.1", "MC151"),
        ("M68 E0 Q-1", "MC151"),
        ("M66 P0 L3", "MC152"),
        ("M66 P0 L3 Q0", "MC152"),
        ("M66 P0 L3 Q-1", "MC152"),
        ("M66 P0 L3 Q1000000", "MC152"),
        ("M66 P0 L5 Q1", "MC152"),
        ("M66 P0 L2.5 Q1", "MC152"),
        ("M66 E7 L3 Q1", "MC152"),
        ("M66 P0 E7", "MC152"),
        ("M62 P0 M63 P5", "MC153"),
        ("M62 P0 P5", "MC153"),
        ("M62 P0 G4 P1", "MC153"),
        ("G4 P1 M62", "MC153"),
    ],
)
@pytest.mark.parametrize("profile", ["reference", "cnc"])
def test_what_is_refused(profile: str, text: str, code: str) -> None:
    found = codes(machine(profile), text)
    assert code in found, found


def test_a_refused_line_sets_nothing() -> None:
    interpreter = Interpreter(machine("cnc"))
    with pytest.raises(ProgramRejected):
        interpreter.interpret_text("M62 P0 G1 X10", 1)


def test_without_outputs_the_reference_is_as_strict_as_ever() -> None:
    assert codes(machine(channels=""), "M62 P0") == ["MC110"]
    assert codes(machine("cnc", channels=""), "M62 P0") == ["MC141"]


@given(st.text("MPELQ0123456789. -G4X", max_size=20))
def test_no_line_ends_in_anything_but_values_or_faults(text: str) -> None:
    check_program(f"M66 {text}\nM67{text}", machine("printer", extra="letters = { E = 6 }"))


# ---------------------------------------------------------------- [dialect.outputs]

COOLANT = "M8 = { clamp = true }\nM9 = { clamp = false }\n"
SPINDLE = 'M3 = { laser = true, rpm = "S" }\nM5 = { laser = false, rpm = 0 }\n'


def test_a_mapped_code_sets_its_outputs_where_it_stands() -> None:
    values = interpret(machine("cnc", mapped=COOLANT), "M8", "M09")
    assert values == [now(CLAMP, 1.0), now(CLAMP, 0.0, 2)]
    assert check_program("M8\nM9", machine("cnc", mapped=COOLANT)) == []


def test_a_spindle_code_beside_those_that_switch_outputs_is_refused() -> None:
    (fault,) = check_program("S1000\nM4", machine("cnc", mapped=SPINDLE))
    assert (fault.code, "M3 and M5" in fault.message) == ("MC141", True)


def test_what_is_not_mapped_stays_without_effect() -> None:
    found = check_program("M7\nM8", machine("cnc", mapped=COOLANT))
    assert [each.code for each in found] == ["MC142"]
    assert "M7 (1)" in found[0].message
    assert "M8" not in found[0].message


def test_an_output_follows_the_speed_of_the_spindle() -> None:
    described = machine("cnc", mapped=SPINDLE)
    values = interpret(described, "S12000 M3", "S8000", "M5", "S9000")
    both = (OutputSetting(LASER, 1.0), OutputSetting(RPM, 12000.0))
    assert values == [
        OutputLine(1, both, with_motion=False),
        now(RPM, 8000.0, 2),
        OutputLine(3, (OutputSetting(LASER, 0.0), OutputSetting(RPM, 0.0)), with_motion=False),
    ]
    assert check_program("S12000 M3\nM5", described) == []


def test_a_speed_that_the_output_cannot_have_is_refused() -> None:
    assert codes(machine("cnc", mapped=SPINDLE), "S24001 M3") == ["MC151"]


def test_a_fan_of_a_printer_keeps_to_the_path_and_alone_needs_no_value() -> None:
    described = machine("printer", mapped='M106 = { power = "S" }\nM107 = { power = 0 }\n')
    values = interpret(described, "M106 S40", "M107", "M106")
    assert values == [with_motion(POWER, 40.0), with_motion(POWER, 0.0, 2), with_motion(POWER, 100.0, 3)]
    assert codes(described, "M106 S255") == ["MC151"]
    assert codes(machine("printer", mapped='M104 = { power = "S" }\n'), "M104") == ["MC118"]
    assert check_program("M106 S40", described) == []


def test_the_end_of_a_program_carries_out_m5_and_m9() -> None:
    values = interpret(machine("cnc", mapped=SPINDLE + COOLANT), "M3 S100", "M8", "M30")
    assert values[-3:] == [
        EndLine(3),
        OutputLine(3, (OutputSetting(LASER, 0.0), OutputSetting(RPM, 0.0)), with_motion=False),
        now(CLAMP, 0.0, 3),
    ]


@pytest.mark.parametrize(
    "mapped",
    [
        "M62 = { laser = true }",
        "M2 = { laser = true }",
        "G8 = { laser = true }",
        "M8 = { lazer = true }",
        "M8 = { laser = 1 }",
        'M8 = { laser = "S" }',
        'M8 = { laser = "on" }',
        "M8 = { power = true }",
        "M8 = { power = 101 }",
        "M8 = { laser = true }\nM08 = { laser = false }",
        "M8 = true",
    ],
)
def test_a_mistake_in_the_map_is_refused(mapped: str) -> None:
    with pytest.raises(MachineFileRejected, match=r"dialect\.outputs"):
        machine("cnc", mapped=mapped)


def test_a_program_of_a_laser_is_warned_of_the_stops_at_each_s() -> None:
    cnc = machine("cnc", mapped=SPINDLE)
    moving = [f"G1 X{at} S{100 * at}" for at in range(1, 7)]
    found = check_program("\n".join(["F600", "M3 S0", *moving, "M5", "S5 X0"]), cnc)
    (said,) = [each for each in found if each.code == "MC148"]
    assert (said.line, said.severity) == (3, "warning")
    assert "on 6 lines" in said.message
    spindle = check_program("\n".join(["F600", "M3 S100", "G1 X1", "S200 X2", "S300 X3", "M5"]), cnc)
    assert "MC148" not in [each.code for each in spindle]


def laser_machine() -> Machine:
    channels = CHANNELS.replace('name = "rpm"', 'name = "rpm"\nlaser = true')
    return machine("cnc", channels, mapped=SPINDLE + SPINDLE.splitlines()[0].replace("M3", "M4"))


@pytest.mark.parametrize("code", ["M3", "M4"])
def test_a_laser_keeps_to_the_path_and_what_is_beside_it_acts_where_it_stands(code: str) -> None:
    power = OutputSetting(RPM, 500.0, scaled=code == "M4")
    assert interpret(laser_machine(), f"{code} S500") == [
        now(LASER, 1.0),
        OutputLine(1, (power,), with_motion=True),
    ]


def test_m4_of_a_laser_is_refused_where_tools_move_the_axes() -> None:
    arm = msgspec.structs.replace(laser_machine(), tools=load_machine("arm6").tools)
    assert codes(arm, "M4 S500") == ["MC159"]
    assert codes(arm, "M4 S0") == codes(arm, "M3 S500") == []
