"""G96 and G97: what S counts, and what does not go together with a spindle that the radius leads (D-120)."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.modal_codes import modal_codes
from mcserver.gcode.program_check import check_program
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import FeedGroup, MotionLine, SpeedGroup
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.units import INCH, MM, TURN
from tests.executor.threading_rig import lathe
from tests.gcode.support import Program
from tests.machine_text import axes_text

LATHE = lathe(drive="ideal")
MILL = parse_machine(f'[machine]\nname = "mill"\n[dialect]\nprofile = "cnc"\n{axes_text(range(3))}')
HEAD = ("G21 G18 G90", "G0 X30 Z5", "S400 M3")


def interpreted(*lines: str) -> tuple[Interpreter, list[MotionLine]]:
    program = Program(LATHE, positions=dict.fromkeys(range(4), 0.0))
    values = program.run(*HEAD, *lines)
    return program.interpreter, [each for each in values if isinstance(each, MotionLine)]


def spindle(*lines: str) -> list[tuple[float, bool]]:
    """Return the turns a minute that are commanded, and whether the radius leads them."""
    groups = [group for line in interpreted(*lines)[1] for group in line.groups]
    speeds = [group for group in groups if isinstance(group, SpeedGroup)]
    return [(round(60.0 * each.velocities[0] / TURN, 3), each.surface is not None) for each in speeds][1:]


def faults(*lines: str, machine: Machine = LATHE) -> list[tuple[str, int]]:
    found = check_program("\n".join((*HEAD, *lines)), machine)
    return [(each.code, each.line) for each in found if each.severity == "error"]


def test_s_is_a_surface_speed_from_g96_to_g97() -> None:
    at_30, twice = round(1e5 / (60.0 * math.pi), 3), round(2e5 / (60.0 * math.pi), 3)
    assert spindle("G96 S100 D2000", "S200", "G97 S500") == [(at_30, True), (twice, True), (500.0, False)]
    assert spindle("M5", "G96 S100", "M4", "G97 M5") == [(0.0, False)] * 2 + [(-at_30, True), (0.0, False)]
    # feet a minute, and D bounds what the radius asks for
    assert spindle("G20", "G96 S300 D200") == [(200.0, True)]
    (speed,) = spindle("G20", "G96 S100")
    assert speed[0] == pytest.approx(100.0 * 12.0 * INCH / (TURN * 0.03), rel=1e-5)


def test_the_radius_counts_from_the_zero_in_force() -> None:
    (_, shifted) = spindle("G96 S100", "G92 X10")
    assert shifted == (round(1e5 / (20.0 * math.pi), 3), True)
    assert len(spindle("G96 S100", "G92 Z10")) == 1


def test_a_line_of_g95_has_parts_at_the_turns_of_their_greater_radius() -> None:
    _, lines = interpreted("G96 S100 D2000", "G95 F0.2", "G1 X5", "Z-10", "G61 X30")
    feeds = [line for line in lines if isinstance(line.groups[0], FeedGroup)]
    facing = [line for line in feeds if line.line == 6]
    assert len(facing) > 20
    groups = [line.groups[0] for line in facing]
    for before, after in pairwise(groups):
        assert isinstance(before, FeedGroup)
        assert isinstance(after, FeedGroup)
        assert before.curves[0].end == after.curves[0].start
    first, last = groups[0], groups[-1]
    assert isinstance(first, FeedGroup)
    assert isinstance(last, FeedGroup)
    assert first.speed == pytest.approx(0.2 * MM * 1e5 / (TURN * 30.0) / 60.0)
    assert last.speed == pytest.approx(0.2 * MM * 2000.0 / 60.0)
    assert sum(line.feed_length for line in facing) == pytest.approx(25.0 * MM)
    # along the spindle it has one speed
    assert len([line for line in feeds if line.line == 7]) == 1
    assert [line.exact_stop for line in feeds if line.line == 8].count(True) == 1


def test_what_needs_even_turns_and_what_says_no_speed_is_refused() -> None:
    assert faults("G96") == [("MC203", 4)]
    assert faults("G96 S0") == [("MC203", 4)]
    assert faults("G96 S100", "S0") == [("MC203", 5)]
    assert faults("G96 S100 D0") == [("MC203", 4)]
    assert faults("G96 S100", "G97") == [("MC203", 5)]
    assert faults("G97", "G96 S100", "G97 M5", "G97") == []
    assert faults("G96 S100 D1000", "G33 Z-20 K1") == [("MC203", 5)]
    assert faults("G96 S100 D1000", "G84 X0 Y0 Z-20 R1 F600") == [("MC203", 5)]
    assert faults("G10 L2 P1 R30", "G96 S100") == [("MC203", 5)]
    assert faults("G96 S100 D1000", "G95 F0.1", "G41.1 D1", "G1 X20") == [("MC203", 7)]
    assert ("MC203", 4) in faults("G96 S100 M3", machine=MILL)


def test_a_start_where_the_radius_leads_the_spindle_is_refused_and_names_its_line() -> None:
    lines = [*HEAD, "G96 S100", "G1 X5 F100", "G97 S300", "G1 X9"]
    with pytest.raises(ProgramRejected, match="MC167") as refused:
        state_before(lines, 6, LATHE, StartState.of(LATHE))
    assert "line 4" in refused.value.diagnostics[0].hint
    assert state_before(lines, 7, LATHE, StartState.of(LATHE)).speeds[3] == pytest.approx(300.0 * TURN / 60.0)


def test_lines_in_columns_leave_s_to_it_and_it_is_among_the_modal_codes() -> None:
    interpreter, _ = interpreted("G96 S100 F100", "G1 X9")
    assert interpreter.interpret_batch([f"X{number % 7} S{number}" for number in range(200)], 6) is None
    assert "G96" in modal_codes(interpreter.modal)
