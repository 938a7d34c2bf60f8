"""Codes that wait for an input behind what they do to outputs (D-73)."""

from __future__ import annotations

import pytest

from mcserver.errors import ConfigurationError
from mcserver.gcode.program_check import check_program
from mcserver.motion.canonical import DwellGroup, InputLine, MotionLine, OutputLine, SpeedGroup, WaitMode
from mcserver.simulation.simulation import simulate
from tests.gcode.test_inputs_and_outputs import CHANNELS, interpret, machine

HEATER = (
    'M104 = { power = "S" }\nM109 = { power = "S" }\n[dialect.waits]\nM109 = { input = "part", for_s = 60 }'
)


def test_a_heater_is_set_at_once_and_waited_for() -> None:
    described = machine("printer", mapped=HEATER)
    output, dwell, wait = interpret(described, "M109 S60")
    assert isinstance(output, OutputLine)
    assert (output.settings[0].value, output.with_motion) == (60.0, False)
    assert isinstance(dwell, MotionLine)
    assert dwell.groups == (DwellGroup(0.5),)
    assert wait == InputLine(1, 0, WaitMode.HIGH, 60.0)
    # cooling is waited for alike, and M104 goes along with the motion
    assert interpret(described, "M109 R60") == [output, dwell, wait]
    (along,) = interpret(described, "M104 S60")
    assert isinstance(along, OutputLine)
    assert along.with_motion


def test_a_code_may_wait_without_an_output() -> None:
    described = machine("cnc", mapped='[dialect.waits]\nM10 = { input = "part", for_s = 5, settle_s = 0 }')
    assert interpret(described, "M10") == [InputLine(1, 0, WaitMode.HIGH, 5.0)]
    assert check_program("M10\nG1 X1 F100", described) == []


def test_a_spindle_turns_before_it_is_waited_for() -> None:
    waits = '[dialect.waits]\nM3 = { input = "part", for_s = 5, settle_s = 0 }'
    turning, wait = interpret(machine("cnc", mapped=waits, extra="spindle_axis = 6"), "S60 M3")
    assert isinstance(turning, MotionLine)
    assert isinstance(turning.groups[0], SpeedGroup)
    assert isinstance(wait, InputLine)


def test_the_program_goes_on_when_the_input_comes_and_ends_when_it_does_not() -> None:
    at_two = CHANNELS.replace('name = "part"', 'name = "part"\nsimulated = [{ at_s = 2.0, value = true }]')
    found = simulate("M109 S60\nG1 X1 F600", machine("printer", channels=at_two, mapped=HEATER))
    assert (found.exit_code, round(found.report["duration_s"], 1)) == (0, 2.1)
    late = simulate("M109 S60\nG1 X1 F600", machine("printer", mapped=HEATER.replace("60 }", "1 }")))
    assert late.exit_code != 0
    assert late.report["axes"]["0"]["position"] == 0.0


@pytest.mark.parametrize(
    "wait",
    [
        'M109 = { input = "none", for_s = 5 }',
        'M109 = { input = "part" }',
        'G1 = { input = "part", for_s = 5 }',
        'M2 = { input = "part", for_s = 5 }',
        'M109 = { input = "part", for_s = 0 }',
        'M5 = { input = "part", for_s = 5 }\nM05 = { input = "part", for_s = 5 }',
    ],
)
def test_a_wait_that_cannot_be_is_a_mistake_of_the_machine_file(wait: str) -> None:
    with pytest.raises(ConfigurationError):
        machine("cnc", mapped=f"[dialect.waits]\n{wait}")


def test_m117_is_not_named_as_without_effect() -> None:
    assert check_program("M117 hello\nG1 X1 F600", machine("printer")) == []
