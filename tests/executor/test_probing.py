"""G38.2 to G38.5 from the text to the cycle, on simulated drives and a virtual clock."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.entries import EventKind
from mcserver.executor.fault_codes import FaultCode
from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.planning.start_state import StartState
from mcserver.simulation.simulation import simulate
from tests.executor.planned import Planned
from tests.executor.rig import Array
from tests.limits import EXACTLY, assert_keeps, limits_of
from tests.machine_text import axes_text

MM = 1e-3
PLANE = "[probe]\nsimulated_at = { Z = -3.2 }\n"
INPUT = '[[input]]\nnumber = 4\nname = "touch"\n[probe]\ninput = 4\n'


def machine(probe: str, *, drive: str = "simulated", profile: str = "cnc") -> Machine:
    text = f'[machine]\nname = "mill"\n[dialect]\nprofile = "{profile}"\n{probe}'
    keys = "min_position = -100.0\nmax_position = 100.0"
    return parse_machine(text + axes_text(range(3), acceleration=1000.0, keys=keys, drive=drive))


class Cell(Planned):
    """A program on axes that are not homed, as on a real machine: in a simulation its end is contact."""

    def __init__(self, made: Machine, text: str) -> None:
        start = StartState.of(made).at({axis.index: 0.0 for axis in made.axes})
        super().__init__(made, text, start=start, homed=False)


def probed(cell: Cell) -> tuple[bool, Array]:
    (event,) = cell.of(EventKind.PROBED)
    return bool(event.token), np.array(event.values) / MM


def test_the_place_of_contact_is_latched_on_the_plane() -> None:
    cell = Cell(machine(PLANE), "G21 G90 G94\nG38.2 X4 Z-8 F600\nM2")
    cell.run()
    assert cell.faults == []
    tripped, place = probed(cell)
    assert tripped
    # on the line from 0 to (4, -8)
    assert place == pytest.approx([1.6, 0.0, -3.2], abs=1e-4)
    # it stops behind it within the limits: v²/2a = 0.05 mm
    assert cell.rows[-1][2] / MM == pytest.approx(-3.25, abs=0.02)
    assert_keeps(cell.rows, limits_of(cell.machine)[:2], cell.machine.cycle_s, EXACTLY)


def test_the_move_stays_on_its_line_while_it_stops() -> None:
    cell = Cell(machine(PLANE), "G21 G90 G94\nG38.2 X4 Y-2 Z-8 F3000\nM2")
    cell.run()
    path = np.array(cell.rows)
    assert path[:, 0] == pytest.approx(path[:, 2] * -0.5, abs=1e-12)
    assert path[:, 1] == pytest.approx(path[:, 2] * 0.25, abs=1e-12)


def test_a_move_from_elsewhere_than_zero_stays_on_its_line_too() -> None:
    cell = Cell(machine(PLANE), "G21 G90 G94\nG1 X2 Y1 Z4 F3000\nG38.2 X4 Y0 Z-8 F3000\nM2")
    cell.run()
    path = np.array(cell.rows) / MM
    probing = path[np.argmax(path[:, 2]) :]
    below = 4.0 - probing[:, 2]
    assert below.max() > 7.2
    assert probing[:, 0] == pytest.approx(2.0 + below / 6.0, abs=1e-9)
    assert probing[:, 1] == pytest.approx(1.0 - below / 12.0, abs=1e-9)


def test_the_next_line_starts_where_the_probe_stopped() -> None:
    cell = Cell(machine(PLANE), "G21 G90 G94\nG38.2 Z-8 F600\nG91 G1 Z1 F600\nG90 G1 X5 Z0\nM2")
    cell.run()
    assert cell.faults == []
    assert_keeps(cell.rows, limits_of(cell.machine)[:2], cell.machine.cycle_s, EXACTLY)
    assert cell.rows[-1] / MM == pytest.approx([5.0, 0.0, 0.0])


def test_the_feed_of_the_probing_move_is_f() -> None:
    cell = Cell(machine(PLANE), "G21 G90 G94\nG38.2 X4 Z-3 F600\nM2")
    cell.run()
    path = np.array(cell.rows)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / cell.machine.cycle_s
    assert speed.max() == pytest.approx(10 * MM, rel=1e-6)


@pytest.mark.parametrize(("code", "faults"), [("G38.2", [FaultCode.NO_CONTACT]), ("G38.3", [])])
def test_no_contact_is_a_fault_or_goes_on(code: str, faults: list[FaultCode]) -> None:
    cell = Cell(machine(PLANE), f"G21 G90 G94\n{code} Z-2 F600\nG1 Z0\nM2")
    cell.run()
    assert cell.faults == faults
    tripped, place = probed(cell)
    assert not tripped
    assert place[2] == pytest.approx(-2.0, abs=0.01)
    assert cell.rows[-1][2] / MM == pytest.approx(-2.0 if faults else 0.0)


def test_an_input_trips_it_in_its_cycle() -> None:
    cell = Cell(machine(INPUT), "G21 G90 G94\nG38.2 Z-20 F600\nM2")
    while not cell.rows or cell.rows[-1][2] > -5 * MM:
        cell.step()
    cell.executor.mailbox.set_input(0, 1.0)
    cell.step()
    at = 0.5 * (cell.actuals[-1][2] + cell.actuals[-2][2])
    cell.run()
    tripped, place = probed(cell)
    assert tripped
    assert place[2] == pytest.approx(at / MM, abs=1e-9)


@pytest.mark.parametrize(("code", "closed"), [("G38.2", 1.0), ("G38.3", 1.0), ("G38.4", 0.0), ("G38.5", 0.0)])
def test_a_probe_that_is_there_already_moves_nothing(code: str, closed: float) -> None:
    cell = Cell(machine(INPUT), f"G21 G90 G94\n{code} Z-20 F600\nM2")
    cell.executor.mailbox.set_input(0, closed)
    cell.run()
    assert cell.faults == [FaultCode.PROBE_CLOSED]
    assert cell.rows[-1][2] == 0.0


def test_away_from_contact() -> None:
    cell = Cell(machine(INPUT), "G21 G90 G94\nG38.4 Z20 F600\nM2")
    cell.executor.mailbox.set_input(0, 1.0)
    while not cell.rows or cell.rows[-1][2] < 5 * MM:
        cell.step()
    cell.executor.mailbox.set_input(0, 0.0)
    cell.run()
    tripped, place = probed(cell)
    assert tripped
    assert place[2] == pytest.approx(5.0, abs=0.05)


def test_a_hold_stops_on_the_line_and_a_resume_goes_on() -> None:
    cell = Cell(machine(PLANE), "G21 G90 G94\nG38.2 X4 Z-8 F600\nM2")
    while not cell.rows or cell.rows[-1][2] > -1 * MM:
        cell.step()
    cell.executor.mailbox.set_hold(True, 0)
    for _ in range(100):
        cell.step()
    standing = cell.rows[-1].copy()
    for _ in range(20):
        cell.step()
    assert np.array_equal(cell.rows[-1], standing)
    cell.executor.mailbox.set_hold(False, 0)
    cell.run()
    assert probed(cell)[0]
    assert probed(cell)[1][2] == pytest.approx(-3.2, abs=1e-4)
    assert_keeps(cell.rows, limits_of(cell.machine)[:2], cell.machine.cycle_s, EXACTLY)


@pytest.mark.parametrize("how", ["abort", "estop", "trip"])
def test_a_stop_while_probing_keeps_the_limits(how: str) -> None:
    cell = Cell(machine(PLANE), "G21 G90 G94\nG38.2 X4 Z-8 F3000\nM2")
    while not cell.rows or cell.rows[-1][2] > -1 * MM:
        cell.step()
    if how == "trip":
        cell.executor.buses[0].trip(0)  # type: ignore[attr-defined]
    elif how == "abort":
        cell.executor.mailbox.abort(0)
    else:
        cell.executor.mailbox.emergency_stop()
    cell.run(limit=2000)
    path = np.array(cell.rows)[:, 2]
    assert np.abs(np.diff(path, 2)).max() <= 1.0 * cell.machine.cycle_s**2 * (1 + 1e-6)
    assert cell.of(EventKind.PROBED) == []


def test_the_reference_dialect_probes_where_the_machine_can() -> None:
    cell = Cell(machine(PLANE, profile="reference"), "G1010\nG94 F600\nG38.2 Z-8\nG01 X1\nM02")
    cell.run()
    assert cell.faults == []
    assert probed(cell)[0]


def test_a_machine_without_a_probe_refuses_the_line() -> None:
    (fault,) = [each for each in check_program("G38.2 Z-8 F600", machine("")) if each.severity == "error"]
    assert fault.code == "MC141"
    assert "[probe]" in fault.hint


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G38.2 F600", "MC118"),
        ("G38.2 Z-8", "MC121"),
        ("G93 G38.2 Z-8 F600", "MC155"),
        ("G38.2 Z0 F600", "MC155"),
        ("G38.2 Z-800 F600", "MC201"),
        ("G38.2 Z-8 Z-9 F600", "MC111"),
        ("G38.2 A-8 F600", "MC108"),
        ("G1 X1 F600\nG38.2 Z-8\nX5", "MC113"),
    ],
)
def test_what_is_no_probing_move_is_refused(line: str, code: str) -> None:
    found = [each.code for each in check_program(line, machine(PLANE)) if each.severity == "error"]
    assert found == [code]


def test_simulations_probe_too() -> None:
    found = simulate("G21 G90 G94\nG38.2 Z-8 F600\nG1 Z0\nM2", machine(PLANE, drive="ideal"))
    assert found.exit_code == 0
    lines = {each["line"]: each for each in found.report["lines"]}
    assert lines[2]["end_s"] - lines[2]["start_s"] == pytest.approx(0.335, abs=0.01)
    assert found.report["axes"]["2"]["min"] == pytest.approx(-3.26, abs=0.02)
    real = simulate("G21 G90 G94\nG38.2 Z-8 F600\nG1 Z0\nM2", machine(INPUT, drive="ideal"))
    # nothing is there to be met: contact is taken to be at the end
    assert real.exit_code == 0
    assert real.report["axes"]["2"]["min"] == pytest.approx(-8.0)
