"""Squareness and a mesh: taken away at the setpoint within the limits of the file, and read back."""

from __future__ import annotations

import numpy as np
import pytest

from mcserver.executor.compensation import Compensator
from mcserver.executor.error_tables import MeshErrors
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from tests.executor.homing_cell import SWITCH, Cell
from tests.executor.rig import CYCLE_S, Array
from tests.executor.test_compensation import Told

MM = 1e-3
# by axis: velocity [m/s], acceleration, jerk
LIMITS = np.array([[0.2, 2.0, 50.0], [0.2, 2.0, 50.0], [0.05, 0.5, 20.0]])
SQUARE = "compensation = { backlash = 0.01, square_errors = [[1, 0.4]] }"
BED = """
[axis.compensation]
reserve = 0.3
square_errors = [[0, -0.3], [1, 0.2]]
pitch_errors = [[0.0, 0.0], [50.0, 0.01]]
[axis.compensation.mesh]
axes = [0, 1]
first = [0.0, 60.0, 130.0]
second = [0.0, 70.0, 140.0]
errors = [[0.0, 0.05, 0.02], [0.03, -0.02, 0.04], [0.06, 0.01, 0.0]]
"""

# as much as half of the limits lets through
STEEP = """
[axis.compensation]
reserve = 0.5
square_errors = [[0, -3.0], [1, 2.0]]
[axis.compensation.mesh]
axes = [0, 1]
first = [0.0, 60.0, 130.0]
second = [0.0, 70.0, 140.0]
errors = [[0.0, 0.5, 0.2], [0.3, -0.2, 0.4], [0.6, 0.1, 0.0]]
"""

# over all three axes, its own one among them, as much as half of the limits lets through
CUBE = """
[axis.compensation]
backlash = 0.01
reserve = 0.5
[axis.compensation.mesh]
axes = [0, 1, 2]
first = [0.0, 70.0, 140.0]
second = [0.0, 80.0, 150.0]
third = [-20.0, 20.0]
errors = [
    [0.0, 0.05, -0.1], [0.04, -0.07, 0.0], [-0.05, 0.0, 0.1],
    [0.1, 0.0, -0.05], [-0.1, 0.07, 0.05], [0.1, -0.05, 0.0],
]
"""


def bed(
    x: str = SQUARE, z: str = BED, drive: str = "ideal", homing: tuple[str, str, str] = ("", "", "")
) -> Machine:
    text = '[machine]\nname = "bed"\n[motion]\npath_tolerance_mm = 0.05\n'
    for index, (limits, compensation) in enumerate(zip(LIMITS, (x, "", z), strict=True)):
        velocity, acceleration, jerk = 1e3 * limits
        text += f'[[axis]]\nindex = {index}\ntype = "linear"\nmax_velocity = {velocity}\n'
        text += f"max_acceleration = {acceleration}\nmax_jerk = {jerk}\n"
        text += f"min_position = -200.0\nmax_position = 200.0\n{compensation}\n{homing[index]}\n"
        text += f'[axis.drive]\nkind = "{drive}"\nhome_switch = [-1000.0, -50.0]\n'
    return parse_machine(text)


def mesh_of(machine: Machine) -> MeshErrors:
    compensation = machine.axes[2].compensation
    assert compensation is not None
    assert compensation.mesh is not None
    return MeshErrors(2, compensation.mesh.axes, compensation.mesh)


def error_of(machine: Machine, at: Array) -> Array:
    """Errors of X and Z at places, shape (K,) [m]; Z above its table."""
    mesh = mesh_of(machine).at(at, np.zeros(3))[0]
    return np.array([4e-4 * at[1], 0.0, -3e-4 * at[0] + 2e-4 * at[1] + mesh])


def test_what_is_measured_is_taken_away_wherever_the_axes_are() -> None:
    text = "G61\nG01 X100 Y20 Z10 F6000\nX30 Y110\nX150 Y160 Z-20\nG00 X-20 Y70"
    run = Told(text, "", made=bed()).play()
    rows = np.array(run.rows)
    # on the way there X came from above: half of its backlash; Z is below its table's first point
    expected = rows[-1] - error_of(run.machine, rows[-1]) - np.array([5e-6, 0.0, 0.0])
    assert run.told[-1] == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(run.told[:, 1], rows[:, 1])


@pytest.mark.parametrize(("x", "z"), [(SQUARE, BED), (SQUARE, STEEP), (CUBE, CUBE)])
def test_drives_are_told_what_keeps_the_limits_of_the_file_at_any_override(x: str, z: str) -> None:
    rng = np.random.default_rng(7)
    places = rng.uniform([-20.0, -20.0, -20.0], [150.0, 160.0, 20.0], (12, 3))
    lines = ["G0{} X{:.3f} Y{:.3f} Z{:.3f}".format(n % 2, *place) for n, place in enumerate(places.tolist())]
    orders = {int(at): float(rng.choice([0.2, 0.6, 1.0, 1.7])) for at in np.arange(200, 6000, 170)}
    run = Told("F12000\n" + "\n".join(lines), "", made=bed(x, z)).play(orders)
    for order in range(1, 4):
        most = np.abs(np.diff(run.told, order, axis=0)).max(axis=0) / CYCLE_S**order
        assert (most <= 1.01 * LIMITS[:, order - 1]).all(), order
    # a round trip: what drives read is shown as it was programmed
    assert np.abs(np.array(run.rows) - np.array(run.actuals)).max() < 1e-12


def test_encoders_of_lagging_drives_are_read_back_as_programmed() -> None:
    run = Told("G61\nG01 X100 Y90 Z10 F6000\nX0 Y0", "", made=bed(drive="simulated")).play()
    assert np.abs(np.array(run.rows)[-1] - np.array(run.actuals)[-1]).max() < 1e-5


def test_a_mesh_meets_its_points_and_its_rate_is_that_of_its_value() -> None:
    mesh = mesh_of(bed())
    still, speed = np.zeros(3), np.array([0.1, -0.07, 0.0])
    for x, y, height in ((0.0, 0.0, 0.0), (60.0, 70.0, -0.02), (130.0, 140.0, 0.0), (999.0, -999.0, 0.02)):
        assert mesh.at(np.array([x, y, 0.0]) * MM, still)[0] == pytest.approx(height * MM, abs=1e-15)
    for x, y in np.random.default_rng(3).uniform(-10.0, 150.0, (50, 2)).tolist():
        at, ahead = np.array([x, y, 0.0]) * MM, 1e-6
        slope = (mesh.at(at + ahead * speed, still)[0] - mesh.at(at - ahead * speed, still)[0]) / (2 * ahead)
        assert mesh.at(at, speed)[1] == pytest.approx(slope, abs=1e-6)


def test_a_grid_meets_its_points_and_its_rate_is_that_of_its_value() -> None:
    grid = mesh_of(bed("", CUBE))
    still, speed = np.zeros(3), np.array([0.1, -0.07, 0.03])
    points = (((70.0, 80.0, -20.0), -0.07), ((0.0, 150.0, 20.0), 0.1), ((140.0, 0.0, 99.0), -0.05))
    for place, height in points:
        assert grid.at(np.array(place) * MM, still)[0] == pytest.approx(height * MM, abs=1e-15)
    # in the middle of a cell, the mean of its corners
    middle = np.mean([0.0, 0.05, 0.04, -0.07, 0.1, 0.0, -0.1, 0.07])
    assert grid.at(np.array([35.0, 40.0, 0.0]) * MM, still)[0] == pytest.approx(middle * MM, abs=1e-12)
    low, high = [-10.0, -10.0, -30.0], [150.0, 160.0, 30.0]
    for place in np.random.default_rng(3).uniform(low, high, (50, 3)):
        at, ahead = place * MM, 1e-6
        slope = (grid.at(at + ahead * speed, still)[0] - grid.at(at - ahead * speed, still)[0]) / (2 * ahead)
        assert grid.at(at, speed)[1] == pytest.approx(slope, abs=1e-6)


def test_nothing_jumps_where_an_axis_gets_its_reference() -> None:
    homing = [
        f"[axis.homing]\n{SWITCH}position = {at}\norder = {n}" for n, at in enumerate((90.0, 100.0, 0.0))
    ]
    cell = Cell(bed(drive="simulated", homing=(homing[0], homing[1], homing[2])))
    told: list[Array] = []
    compensator = cell.executor.executor.bank.compensator
    assert isinstance(compensator, Compensator)
    cell.home(0, 1, 2)
    for _ in range(20_000):
        cell.step()
        told.append(cell.drive_setpoints[-1] + compensator.correction)
        if cell.executor.at_rest:
            break
    assert not cell.faults
    assert cell.homed == 0b111
    # Y has become 150 mm: X is told 60 µm more, and goes there within its limits
    steps = np.diff(np.array(told), axis=0) / CYCLE_S
    assert (np.abs(steps).max(axis=0) < 0.0502).all()
    assert (np.abs(np.diff(steps, axis=0)).max(axis=0) / CYCLE_S <= 1.01 * LIMITS[:, 1]).all()
    at = cell.setpoints[-1]
    expected = error_of(cell.machine, at)
    assert -compensator.correction[2] == pytest.approx(expected[2], abs=2e-8)


@pytest.mark.parametrize(
    ("x", "z", "says"),
    [
        ("compensation = { square_errors = [[0, 0.4]] }", "", "of linear axes over others"),
        ("compensation = { square_errors = [[7, 0.4]] }", "", "of linear axes over others"),
        ("compensation = { square_errors = [[1, 100.0]] }", "", "10.0 % of this one's"),
        ("compensation = { square_errors = [[1, 0.1], [1, 0.1]] }", "", "there twice"),
        ("", BED.replace("60.0, 130.0", "60.0, 60.0"), "do not ascend"),
        ("", BED.replace("60.0, 130.0", "60.0, 60.0001"), "do not ascend"),
        ("", BED.replace(", [0.06, 0.01, 0.0]", ""), "3 rows of 3"),
        ("", BED.replace("[0, 1]", "[0, 2]"), "of linear axes over others"),
        ("", BED.replace("[0, 1]", "[0, 1, 2]"), "third is for a mesh over three"),
        ("", CUBE.replace("[-20.0, 20.0]", "[-20.0]"), "third is for a mesh over three"),
        ("", CUBE.replace("[0, 1, 2]", "[0, 1]"), "third is for a mesh over three"),
        ("", CUBE.replace("[0, 1, 2]", "[0, 1, 1]"), "of linear axes over others"),
        ("", CUBE.replace("[-20.0, 20.0]", "[-20.0, 0.0, 20.0]"), "9 rows of 3"),
        ("", CUBE.replace("[-20.0, 20.0]", "[-20.0, -19.0]"), "% of this one's"),
        ("", BED.replace("first = [0.0, 60.0, 130.0]", "first = [0.0, 1.0, 2.0]"), "% of this one's"),
    ],
)
def test_what_cannot_be_compensated_is_refused_with_its_reason(x: str, z: str, says: str) -> None:
    with pytest.raises(MachineFileRejected, match=says) as refused:
        bed(x, z)
    assert {each.code for each in refused.value.diagnostics} == {"MC092"}
