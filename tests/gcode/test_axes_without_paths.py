"""Axes whose drives go to points on their own profiles (mode = "pp"): G00 and G1020 alone move them."""

from __future__ import annotations

import pytest

from mcserver.errors import ConfigurationError
from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, parse_machine
from tests.gcode.support import Program
from tests.machine_text import axes_text

PP = 'mode = "pp"\nbus = "can0"\nnode = 1\nfeed = [10.0, 1.0]\ncounts_per_motor_rev = 4096\n'


def machine(more: str = "") -> Machine:
    axes = axes_text((0, 1)) + axes_text((2,), drive="cia402", drive_keys=PP)
    return parse_machine(f'[machine]\nname = "m"\ncycle_hz = 200\n{axes}{more}')


@pytest.mark.parametrize(
    "line", ["G00 Z10", "G1020 Z10", "G00 X5 Y5 Z10", "G01 X10 F100", "G02 X10 Y10 R10 F100"]
)
def test_points_are_reached_and_paths_of_other_axes_go_on(line: str) -> None:
    assert Program(machine()).codes(line) == []


@pytest.mark.parametrize(
    "line", ["G01 Z10 F100", "G01 X10 Z10 F100", "G02 X10 Y10 Z5 R10 F100", "F100 G01 X1 Z0"]
)
def test_a_path_is_refused_with_the_axis_that_cannot_follow_it(line: str) -> None:
    assert Program(machine()).codes(line) == ["MC138"]


def test_a_run_of_alike_lines_is_refused_in_each_of_them() -> None:
    lines = ["G1010", "G01 F100 X1", *(f"X{number} Z{number}" for number in range(50))]
    assert [fault.code for fault in check_program("\n".join(lines), machine())] == ["MC138"] * 50


def test_a_tool_does_not_move_such_an_axis() -> None:
    with pytest.raises(ConfigurationError, match="follows no path"):
        machine('[kinematics]\nurdf = "robot-dog"\n[[tool]]\nnumber = 3\nframe = "f"\naxes = [0, 1, 2]\n')


def test_a_jog_and_a_probing_move_are_refused_too() -> None:
    described = machine('[[input]]\nnumber = 0\nname = "probe"\n[probe]\ninput = 0\n')
    assert Program(described).codes("G94 F60 G91 G01 [2]5") == ["MC138"]
    assert Program(described).codes("G94 F60 G38.2 Z-5") == ["MC138"]
