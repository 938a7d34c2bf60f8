"""G7 and G8: X as a diameter and as a radius (D-137)."""

from __future__ import annotations

import pytest

from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, parse_machine
from tests.bench.rs274_programs import moves_here
from tests.executor.threading_rig import lathe
from tests.machine_text import axes_text

MILL = parse_machine(f'[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n{axes_text(range(3))}')
FANUC = parse_machine(
    f'[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\nmacros = "fanuc"\n{axes_text(range(3))}'
)


def ends(*lines: str) -> list[tuple[float, ...]]:
    moves, fault = moves_here("\n".join(("G21 G90 G18 F1000", *lines)), MILL)
    assert not fault
    return [tuple(round(each, 9) for each in move[:3]) for move in moves]


def faults(*lines: str, machine: Machine = MILL) -> list[str]:
    found = check_program("\n".join(("G21 G90 G18 F1000", *lines)), machine)
    return [each.code for each in found if each.severity == "error"]


def test_x_is_halved_wherever_it_is_written_from_the_line_of_g7_on() -> None:
    lines = ["G1 X10 Z3", "G7 G1 X10", "X#1", "G91 X4 Z1", "G90 G8 X4"]
    assert ends("#1 = 30", *lines) == [(10, 0, 3), (5, 0, 3), (15, 0, 3), (17, 0, 4), (4, 0, 4)]
    assert ends("G7", "G10 L2 P1 X8", "G92 X6", "G1 X10", "G53 G0 X2") == [(2, 0, 0), (1, 0, 0)]
    assert ends("G1 X7", "G7", "X[#5420 * 2]", "X20") == [(7, 0, 0)] * 2 + [(10, 0, 0)]
    assert ends("G7", "G0 X40 Z0", "G17 G98 G81 X20 Z-2 R1 F100", "X30")[-2:] == [(15, 0, -2), (15, 0, 1)]


def test_words_of_arcs_and_positions_are_radii() -> None:
    assert ends("G7", "G1 X20 Z0", "G3 X40 Z-10 I0 K-10")[-1] == (20, 0, -10)
    assert ends("G7", "G1 X20 Z0", "G3 X40 Z-10 R10")[-1] == (20, 0, -10)
    assert ends("G7", "G1 X20", "G8 X[#5420 + 1]")[-1] == (11, 0, 0)


def test_a_thread_has_diameters_too() -> None:
    text = "G21 G18 G90\nG0 X{} Z5\nS400 M3\n{} G76 P1.5 Z-20 I{} J{} K{}"
    halved = moves_here(text.format(15, "G7", -4, 0.5, 1.5), lathe(drive="ideal"))
    assert halved == moves_here(text.format(15, "G8", -2, 0.25, 0.75), lathe(drive="ideal"))
    assert len(halved[0]) > 5


@pytest.mark.parametrize(
    "lines",
    [
        ["G7", "G17 G68 X0 Y0 R30"],
        ["G17 G68 X0 Y0 R30", "G7"],
        ["G7", "G17 G16"],
        ["G7", "G1 @5 ^30"],
        ["G7", "G10 L2 P1 R30"],
        ["G51 X0 Y0 Z0 P2.", "G7"],
    ],
)
def test_what_nobody_has_defined_together_is_refused(lines: list[str]) -> None:
    assert "MC185" in faults(*lines)


def test_other_controllers_codes_of_these_numbers_stay_what_they_were() -> None:
    assert faults("G7 X10", machine=FANUC) == ["MC147", "MC141"]
    assert faults("G8 P1", machine=FANUC) == faults("G8 P1") == []


def test_an_origin_under_g91_is_refused_where_controllers_differ() -> None:
    assert faults("G91", "G10 L2 P1 X5") == ["MC186"]
    assert faults("G91", "G10 L20 P1 X5") == faults("G91", "G10 L2 P1 X5", machine=FANUC) == []
