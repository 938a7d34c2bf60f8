"""G95: F a turn of the spindle as it is commanded (D-105)."""

from __future__ import annotations

import pytest

from mcserver.gcode.modal_codes import modal_codes
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import FeedGroup, MotionLine, ProbeLine, ThreadLine
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.units import DEGREE, INCH, MM
from tests.executor.threading_rig import lathe, lathe_text
from tests.gcode.support import Program
from tests.machine_text import axes_text

LATHE = lathe(drive="ideal")
HEAD = ("G21 G17 G90", "S300 M3")
MILL = '[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n'
# a router whose inverter has S on an analog output
ROUTER = parse_machine(
    f'{MILL}[dialect.outputs]\nM3 = {{ speed = "S" }}\n{axes_text(range(3))}'
    '[[output]]\nname = "speed"\nnumber = 0\nkind = "analog"\nmax = 24000.0\n'
)


def values(*lines: str, machine: Machine = LATHE) -> list[object]:
    return list(Program(machine, positions=dict.fromkeys(range(4), 0.0)).run(*HEAD, *lines))


def speeds(*lines: str, machine: Machine = LATHE) -> list[float]:
    """Return the speed of each feed move [mm/min]."""
    moves = [each for each in values(*lines, machine=machine) if isinstance(each, MotionLine)]
    groups = [group for each in moves for group in each.groups if isinstance(group, FeedGroup)]
    return [60.0 * group.speed / MM for group in groups if group.speed]


def faults(*lines: str, machine: Machine = LATHE) -> list[tuple[str, int]]:
    return [(each.code, each.line) for each in check_program("\n".join(lines), machine)]


def test_f_counts_turns_of_the_spindle_as_it_stands_at_each_line() -> None:
    lines = ("G95 F0.2", "G1 X10", "G2 X20 I5 J0", "S600 G1 X30", "F0.1 M4 Y5", "G94 F100 X0")
    assert speeds(*lines) == pytest.approx([60.0, 60.0, 120.0, 60.0, 100.0])
    # a later G20 leaves it as it is (D-11)
    assert speeds("G20 G95 F0.01", "G21 G1 X10") == pytest.approx([0.01 * 300.0 * INCH / MM])


def test_lines_in_columns_do_not_take_it_for_a_feed_a_minute() -> None:
    program = Program(LATHE)
    program.run(*HEAD, "G95 F0.2 G1 X9")
    assert program.interpreter.interpret_batch([f"X{number % 7}" for number in range(200)], 4) is None


def test_gears_between_motor_and_spindle_count() -> None:
    geared = parse_machine(
        lathe_text(drive="ideal").replace("units_per_motor_rev = 360.0", "units_per_motor_rev = 90.0")
    )
    assert speeds("G95 F0.2 G1 X10", machine=geared) == pytest.approx([15.0])


def test_a_rotary_axis_goes_degrees_a_turn() -> None:
    machine = parse_machine(
        f"{MILL}spindle_axis = 3\n{axes_text(range(3))}"
        f"{axes_text((3,), rotary=True, velocity=2e4, keys='units_per_motor_rev = 360.0')}"
        f"{axes_text((4,), rotary=True)}"
    )
    (turn,) = [
        each.groups[0]
        for each in values("G95 F2 G1 B90", machine=machine)
        if isinstance(each, MotionLine) and isinstance(each.groups[0], FeedGroup)
    ]
    assert isinstance(turn, FeedGroup)
    assert turn.speed == pytest.approx(600.0 * DEGREE / 60.0)


def test_cycles_and_probes_go_by_it_and_a_tap_has_its_pitch() -> None:
    assert speeds("G95 G81 X5 Z-3 R2 F0.1") == pytest.approx([30.0])
    (tap,) = [each for each in values("G95 G84 Z-12 R4 F1.25") if isinstance(each, ThreadLine)]
    assert tap.pitch == pytest.approx(1.25 * MM)
    machine = parse_machine(lathe_text(drive="ideal") + '[[input]]\nname="p"\nnumber=0\n[probe]\ninput = 0\n')
    (probe,) = [each for each in values("G95 G38.2 Z-5 F0.1", machine=machine) if isinstance(each, ProbeLine)]
    assert probe.speed == pytest.approx(30.0 * MM / 60.0)


def test_an_output_that_has_s_is_a_spindle_and_a_relay_is_none() -> None:
    assert speeds("G95 F0.2 G1 X10", machine=ROUTER) == pytest.approx([60.0])
    relay = parse_machine(
        f"{MILL}[dialect.outputs]\nM3 = {{ on = true }}\n{axes_text(range(3))}"
        '[[output]]\nname = "on"\nnumber = 0\n'
    )
    for machine in (relay, parse_machine(MILL + axes_text(range(3)))):
        assert ("MC128", 2) in faults("S300 M3", "G95 F0.2 G1 X10", machine=machine)


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        (("G95 F0.2", "G1 X10"), "MC128"),
        (("S300", "G95 F0.2 G1 X10"), "MC128"),
        (("S300 M3", "G95 F0.2 M5 G1 X10"), "MC128"),
        (("M3", "G95 F0.2 G1 X10"), "MC128"),
        (("S300 M3", "M19 R0", "G95 F0.2 G1 X10"), "MC128"),
        (("G95 F0.2", "G81 X10 Z-2 R1"), "MC128"),
        (("S300 M3 G94 F100", "G95 G1 X10"), "MC121"),
        (("S300 M3 G95 F0.1", "G94 G1 X10"), "MC121"),
        (("S300 M3 G95 F0.1", "G93 G1 X10"), "MC121"),
        (("S300 M3", "G95 F0 G1 X10"), "MC120"),
        # the F a minute of lines that come behind a tap
        (("S300 M3", "G95 F50 G1 X10", "F300 X20"), "MC123"),
        (("S300 M3", "G20 G95 F3 G1 X1"), "MC123"),
    ],
)
def test_no_turns_or_no_f_are_a_fault_of_the_move(lines: tuple[str, ...], code: str) -> None:
    assert faults(*lines) == [(code, len(lines))]


def test_a_rapid_needs_no_turns_and_g99_no_f_a_minute() -> None:
    assert faults("G95 F0.2", "G0 X10", "S300 M3", "G99 F0.1 G1 X0") == []


def test_a_program_goes_on_under_it() -> None:
    lines = [*HEAD, "G95 F0.2", "G1 X10", "X20"]
    before = state_before(lines, 5, LATHE, StartState.of(LATHE))
    interpreter = Interpreter(LATHE, modal=before.modal, positions=before.positions)
    (move,) = interpreter.interpret_text(lines[4], 5)
    assert isinstance(move, MotionLine)
    (group,) = move.groups
    assert isinstance(group, FeedGroup)
    assert group.speed == pytest.approx(60.0 * MM / 60.0)


def test_it_is_told_as_it_is() -> None:
    program = Program(LATHE)
    program.run("S300 M3", "G95 F0.2")
    assert {"G95", "F0.2", "S300"} <= set(modal_codes(program.interpreter.modal))
    assert faults("G95 F0.2 S300 M3", "o1 if [#<_units_per_rev> NE 1]", "G5", "o1 endif") == []
