"""Work coordinate systems that are turned about Z (D-110)."""

from __future__ import annotations

import math
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcclient.cli.zero import probed_line
from mcclient.errors import RequestRefused
from mcclient.types import ProbeStatus, WorkOffset
from mcclient.work_tables import change_text, undo_line, work_places

from mcserver.errors import UsageFault
from mcserver.gcode.computing.machine_values import MachineValues, Source
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import parse_machine
from mcserver.machine.work_systems import ANGLE
from mcserver.motion.geometry.curves import Array
from mcserver.net.status import EdgeUnits
from mcserver.planning.start_state import StartState, frame_changes
from mcserver.planning.state_before import state_before
from mcserver.service.work_offsets import WorkOffsets
from mcserver.simulation.work_zero import with_zeros
from mcserver.units import MM
from tests.bench.rs274_programs import MACHINE, moves_here
from tests.gcode.test_transformations import PROBING, Writer, ends, faults, travels
from tests.machine_text import axes_text


def turned(moves: list[tuple[float, ...]], degrees: float, about: Array) -> Array:
    angle = math.radians(degrees)
    matrix = np.eye(3)
    matrix[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
    points = np.array(moves).reshape(-1, 2, 3)
    found: Array = about + (points - about) @ matrix.T
    return found.reshape(-1, 6)


@given(st.integers(0, 2**32))
def test_a_program_does_in_a_turned_system_what_it_does_elsewhere_turned(seed: int) -> None:
    written = Writer(seed).write()
    degrees = round(Random(seed).choice([Random(seed).uniform(-200, 200), 90.0, -180.0]), 3)
    zero = np.array([float(word[1:]) for word in written.lines[1].split()[3:]])
    written.lines[1] += f" R{degrees}"
    found = np.array(travels(*written.lines))
    expected = turned(written.expected, degrees, zero)
    # the first one begins at the machine's zero
    np.testing.assert_allclose(found[0, 3:], expected[0, 3:], atol=2e-5)
    np.testing.assert_allclose(found[1:], expected[1:], atol=2e-5, err_msg="\n".join(written.lines))


@pytest.mark.parametrize(
    "lines",
    [
        ["G0 X-10 Y-5", "G41.1 D6", "G1 X0 Y0", "Y20", "G2 X20 Y20 I10 J0", "G1 Y0", "G40 G1 X40 Y-10"],
        ["G0 X1 Y1 Z5", "G83 X3 Y4 Z-3 R1 Q1.5", "G91 X5 L2", "G80 G90 G1 X0 Y0"],
        ["G18 G0 X1 Y9 Z5", "G99 G83 X3 Z4 Y-3 R1 Q1.5", "G98 G91 X5 L2", "G80 G90 G1 X0 Y0"],
        ["G0 X0 Y0", "G5 I0 J3 P0 Q-3 X2 Y6", "G5 P-2 Q-2 X9 Y9", "G5.1 X3 Y3 I1 J5"],
        ["G19 G0 Y-10 Z-5", "G42.1 D6", "G1 Y0 Z0", "Z20", "G2 Y20 Z20 J10 K0", "G1 Z0", "G40 G1 Y40 Z-10"],
        ["G0 X0 Y0", "G5.2 P1 L3", "X0 Y1 P1", "X2 Y2 P1", "X2 Y0 P1", "G5.3"],
        ["G0 X10 Y0", "G1 @20 ^30", "G91 ^60", "G90 G16", "G1 X5 Y90"],
        ["G90.1 G0 X0 Y0", "G2 X10 Y0 I5 J0", "G91.1 G52 X3", "G1 X1 Y1"],
    ],
)
def test_so_do_cycles_compensation_curves_and_polar_words(lines: list[str]) -> None:
    degrees = 180.0 if "G19" in lines[0] else 30.0
    plain, found = travels("F1000", *lines), np.array(travels(f"G10 L2 P1 R{degrees}", "F1000", *lines))
    expected = turned(plain, degrees, np.zeros(3))
    np.testing.assert_allclose(found[1:], expected[1:], atol=1e-6)


def test_positions_are_read_and_set_along_the_turned_axes() -> None:
    lines = ["G10 L2 P1 X10 Y5 R90", "G0 X3 Y4", "G10 L20 P1 X0", "G0 X1"]
    assert ends(*lines) == [(6.0, 8.0, 0.0), (6.0, 9.0, 0.0)]
    text = "G10 L2 P1 X10 Y5 R90\nG0 X3 Y4\nG1 F9 X[#5420 + 1] Y#<_x> Z#5230\nX#<_abs_x> Y#5421\n"
    moves = moves_here(text)[0]
    np.testing.assert_allclose(moves, [(6.0, 8.0, 0.0), (7.0, 9.0, 90.0), (7.0, 12.0, 90.0)], atol=1e-9)
    assert ends("G10 L2 P1 R90", "G0 X3 Y4", "G92 X0 Y0", "G0 X1") == [(-4.0, 3.0, 0.0), (-4.0, 4.0, 0.0)]
    # as LinuxCNC has them: positions of the machine, and the way home by both
    lines = ["G10 L2 P1 R90", "G0 X3 Y4", "G53 G0 X7", "G91 G28 X1 Y0"]
    assert ends(*lines) == [(-4.0, 3.0, 0.0), (7.0, 3.0, 0.0), (7.0, 4.0, 0.0), (0.0, 0.0, 0.0)]
    # an angle is never added to
    assert ends("G10 L2 P1 R90", "G91 G10 L2 P1 R30", "G90 G10 L2 P1 R0", "G0 X2") == [(2.0, 0.0, 0.0)]


def test_what_a_probe_met_is_read_along_the_turned_axes() -> None:
    assert faults("G10 L2 P1 R90", "G38.2 X5 Y3", "G1 X#5061 Y#5062") == []
    interpreter = Interpreter(PROBING)
    values = MachineValues(interpreter, Source.ASSUMED)
    for number, text in enumerate(["G10 L2 P1 X1 R90", "F100 G38.2 X5 Y3"], 1):
        values.interpreted(interpreter.interpret_text(text, number))
    assert [values.numbered(number, (1, 2)) for number in (5061, 5062)] == pytest.approx([5.0, 3.0])


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        (["G10 L20 P1 X0 R30"], "MC141"),
        (["G92 X5", "G10 L2 P1 R30"], "MC174"),
        (["G52 Y5", "G10 L2 P1 R30"], "MC174"),
        (["G10 L2 P1 R30", "G28 X0"], "MC186"),
        (["G10 L2 P1 R30", "G28 Y0 A0"], "MC186"),
        (["G10 L2 P1 R30", "G43.4"], "MC172"),
        (["G10 L2 P1 R30", "S100 M3", "G33 X5 K1"], "MC185"),
        (["G10 L2 P1 R30", "G18", "G41.1 D3"], "MC185"),
        (["G10 L2 P1 R30", "G68 X0 Y0 R3", "G55"], "MC185"),
    ],
)
def test_what_does_not_go_together_with_it_is_refused(lines: list[str], code: str) -> None:
    assert faults(*lines) == [(code, len(lines))]


def test_a_check_goes_on_behind_what_it_refuses() -> None:
    lines = ["G41.1 D3", "G1 X9 Y9", "G10 L2 P1 R30", "G18 G2 X3 Z3 R9", "G18 G2 X5 Z3 R9"]
    found = faults(*lines)
    assert {code for code, _ in found} == {"MC170"}
    assert {line for _, line in found} >= {3, 4, 5}


def test_a_program_begins_in_its_middle_as_it_comes_there() -> None:
    lines = ["G21 G90 F1000", "G10 L2 P2 X3 Y1 R25", "G55 G0 X1 Y2 Z3", "G91 G1 X5"]
    lines += ["G18 G3 X3 Z0 R9", "G1 Y2"]
    whole = ends(*lines)
    for first in range(4, 7):
        before = state_before(lines, first, MACHINE, StartState.of(MACHINE))
        rest = Interpreter(MACHINE, positions=before.positions, modal=before.modal)
        for number, text in enumerate(lines[first - 1 :], first):
            rest.interpret_text(text, number)
        there = [rest.positions[axis] / MM for axis in range(3)]
        np.testing.assert_allclose(there, whole[-1], atol=1e-6)


def test_its_angle_is_kept_shown_taken_back_and_compared(tmp_path: Path) -> None:
    offsets = WorkOffsets(tmp_path / "offsets.json")
    frame = Frame(systems={1: {0: 0.01, ANGLE: math.radians(30.0)}})
    offsets.keep(frame, client="ann", program="p", name="part")
    again = WorkOffsets(tmp_path / "offsets.json")
    assert again.frame() == frame
    units = EdgeUnits(MACHINE)
    (shown,) = units.work_offsets(again.systems)
    assert (shown.system, shown.origin, round(shown.rotation, 9)) == ("G54", {"0": 10.0}, 30.0)
    (change,) = units.tables(again, tool_table=False).changes
    assert change_text(change) == "G54: R – → 30, X – → 10"
    assert undo_line(change) == "G21 G90 G10 L2 P1 R0 X0"
    assert frame_changes(MACHINE, None, frame)[1:] == [("G54", "turned about Z", "30 deg")]


def test_what_axes_read_there_is_said_to_people() -> None:
    offset = WorkOffset("G54", {"0": 10.0, "1": 5.0, "2": 1.0}, 90.0)
    reads = work_places([offset], {0: 6.0, 1: 8.0, 2: 3.0, 5: 7.0})
    assert {axis: round(at, 9) for axis, at in reads.items()} == {0: 3.0, 1: 4.0, 2: 2.0, 5: 7.0}
    with pytest.raises(RequestRefused, match="G54 is turned"):
        probed_line(["X"], 0, ProbeStatus("p", 1, True, {"0": 3.0}, 0.0), [offset])


def test_a_check_can_start_in_a_turned_system() -> None:
    machine = with_zeros(MACHINE, ["X=10,R=90"])
    interpreter = Interpreter(machine)
    interpreter.interpret_text("G0 X3 Y4", 1)
    assert [round(interpreter.positions[axis] * 1e3, 9) for axis in (0, 1)] == [6.0, 3.0]
    rotary = parse_machine(
        f'[machine]\nname = "rotary"\n[dialect]\nprofile = "cnc"\n{axes_text(rotary=True)}'
    )
    with pytest.raises(UsageFault, match="X and Y"):
        with_zeros(rotary, ["R=30"])
