"""G29, M420 and Klipper's macros from the text to the drives, over a simulated bed that is not flat."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING, cast

import msgspec
import numpy as np
import pytest

from mcserver.executor.compensation import Compensator
from mcserver.executor.entries import ControlKind, EventKind, ExecutorEvent
from mcserver.executor.fault_codes import FaultCode
from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.service.approach import plan_approach
from mcserver.service.axis_reports import AxisReports
from mcserver.simulation.simulation import simulate
from tests.executor.planned import Planned
from tests.executor.rig import CYCLE_S, Array, Program
from tests.machine_text import axes_text

if TYPE_CHECKING:
    from mcserver.service.event_log import EventLog
    from mcserver.service.references import References

MM = 1e-3
# by axis: velocity [m/s], acceleration, jerk
LIMITS = np.array([[0.2, 2.0, 50.0], [0.2, 2.0, 50.0], [0.03, 0.5, 20.0]])
FILE = """
[axis.compensation]
backlash = 0.004
reserve = 0.4
[axis.compensation.mesh]
axes = [0, 1]
first = [0.0, 60.0, 120.0]
second = [0.0, 50.0, 100.0]
[axis.compensation.mesh.probe]
speed = 3.0
clear = 1.5
greatest = 0.4
"""
HEAD = "G21 G90\nG28\nG1 Z5 F1800\n"


BEFORE = FILE.replace(
    "[axis.compensation.mesh.probe]",
    "errors = [[0.0, 0.03, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.0]]\n[axis.compensation.mesh.probe]",
)


def printer(z: str = FILE, *, probe: str = "input = 4", drive: str = "simulated") -> Machine:
    return parse_machine(text_of(z, probe, drive))


def text_of(z: str, probe: str, drive: str) -> str:
    text = '[machine]\nname = "printer"\n[dialect]\nprofile = "printer"\n'
    text += f'[[input]]\nnumber = 4\nname = "touch"\n[probe]\n{probe}\n'
    for index, limits in enumerate(LIMITS):
        velocity, acceleration, jerk = 1e3 * limits
        keys = f"max_jerk = {jerk}\nmin_position = -10.0\nmax_position = 200.0\n{z if index == 2 else ''}"
        text += axes_text((index,), velocity=velocity, acceleration=acceleration, keys=keys, drive=drive)
    return text


def bowed(x: float, y: float) -> float:
    """A bed that is tilted and bowed [m]."""
    u, v = x / 0.12, y / 0.1
    return 1e-4 * (1.0 + 2.0 * u - 1.2 * v - 2.0 * u * (1.0 - u))


class Bed(Planned):
    """A printer over a bed that closes its probe where a drive takes it down to the bed.

    Attributes:
        targets: what drives are told in each cycle, shape (K,). nozzle: where they say that it is.
    """

    def __init__(self, made: Machine, text: str, bed: Callable[[float, float], float] = bowed) -> None:
        self.bed, self.targets, self.nozzle = bed, list[Array](), list[Array]()
        self.touches = False
        start = StartState.of(made).at({axis.index: 0.0 for axis in made.axes})
        super().__init__(made, HEAD + text, start=start, homed=False)

    def _record(self, time: float, line: int, setpoint: Array, actual: Array) -> None:
        super()._record(time, line, setpoint, actual)
        compensator = self.compensator
        self.targets.append(setpoint + compensator.correction)
        self.nozzle.append(actual + compensator.correction)

    def go_on(self, text: str) -> None:
        """Run another program to its end."""
        self.events.clear()
        self.ended = False
        row = self.executor.executor.row.ordered
        places = {axis.index: float(at) for axis, at in zip(self.machine.axes, row, strict=True)}
        self.sink = self.executor.open_slot(0)
        self.pipeline = Pipeline(self.machine, self.sink, start=StartState.of(self.machine).at(places))
        self.pipeline.lines.put(1, text.split("\n"))
        self.pipeline.lines.closed = True
        self.run()

    @property
    def compensator(self) -> Compensator:
        found = self.executor.executor.bank.compensator
        assert isinstance(found, Compensator)
        return found

    @property
    def height(self) -> float:
        """Of the nozzle over the bed [m]; backlash is none of it."""
        x, y, z = self.nozzle[-1]
        return float(z - self.bed(x, y))

    def step(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            super().step()
            touches = self.height <= 0.0
            if touches != self.touches:
                self.touches = touches
                self.executor.mailbox.set_input(0, float(touches))

    def until(self, reached: Callable[[], bool]) -> Bed:
        for _ in range(60_000):
            self.step()
            if reached():
                return self
        raise AssertionError("not reached")

    def keeps_limits(self, of: Sequence[int] = (0, 1, 2)) -> bool:
        told = np.array(self.targets)[:, of]
        for order in range(1, 4):
            most = np.abs(np.diff(told, order, axis=0)).max(axis=0) / CYCLE_S**order
            if not (most <= 1.01 * LIMITS[of, order - 1]).all():
                return False
        return True


def heights(run: Bed, xy: list[tuple[float, float]]) -> list[float]:
    """Return how high the nozzle stood at the ends of the last moves [m]."""
    rows = np.array(run.rows)
    found = []
    for x, y in xy:
        at = np.flatnonzero((np.abs(rows[:, :2] - [x * MM, y * MM]) < 1e-9).all(axis=1))[-1]
        place = run.nozzle[at]
        found.append(float(place[2] - run.bed(place[0], place[1])))
    return found


def error_at(run: Planned, x: float, y: float) -> float:
    """Return what counts of the mesh at a place [mm]; backlash has no table."""
    compensator = run.executor.executor.bank.compensator
    assert isinstance(compensator, Compensator)
    (table,) = compensator.tables
    return float(table.errors.at(np.array([x * MM, y * MM, 0.0]), np.zeros(3))[0]) / MM


POINTS = [(60.0, 50.0), (0.0, 0.0), (120.0, 100.0), (30.0, 25.0), (90.0, 75.0), (110.0, 20.0)]
MOVES = "".join(f"G1 X{x} Y{y} F6000\nG4 P200\n" for x, y in POINTS)


@pytest.mark.parametrize("code", ["G29", "BED_MESH_CALIBRATE ADAPTIVE=1", "G29 P1 X0 Y0 W50 H20 C"])
def test_behind_g29_the_nozzle_is_as_high_over_the_bed_everywhere(code: str) -> None:
    run = Bed(printer(), f"{code}\nG1 Z1\n{MOVES}").run()
    assert run.faults == []
    assert len(run.of(EventKind.PROBED)) == 9
    found = np.array(heights(run, POINTS)) / MM
    # the probe is read a cycle later; between points the bed's own bow is less than 0.05 mm
    assert found[:3] == pytest.approx(1.0, abs=0.006)
    assert found == pytest.approx(1.0, abs=0.06)
    assert run.keeps_limits()
    # positions are those of the program
    assert run.actuals[-1] / MM == pytest.approx([110.0, 20.0, 1.0], abs=1e-3)
    before = Bed(printer(), f"G1 Z1\n{MOVES}").run()
    assert np.ptp(heights(before, POINTS)) > 0.15 * MM


def test_a_second_g29_finds_the_same_bed() -> None:
    run = Bed(printer(), f"G29\nG29\nG1 Z1\n{MOVES}").run()
    assert run.faults == []
    assert np.array(heights(run, POINTS))[:3] / MM == pytest.approx(1.0, abs=0.006)
    second = np.array([event.values[2] for event in run.of(EventKind.PROBED)][9:])
    # the mesh counts meanwhile: the program's Z is 0 wherever the probe meets the bed
    assert second / MM == pytest.approx(0.0, abs=0.006)


def test_the_probe_beside_the_nozzle_is_over_the_points() -> None:
    # where the nozzle is as the probe meets the bed, which is 1.2 mm above the nozzle
    run = Bed(
        printer(FILE + "offset = [-5.0, 5.0]\nat = -1.2\n"),
        f"G29\nG1 Z1\n{MOVES}",
        lambda x, y: bowed(x - 5 * MM, y + 5 * MM) - 1.2 * MM,
    ).run()
    assert run.faults == []
    run.bed = bowed
    assert np.array(heights(run, POINTS))[:3] / MM == pytest.approx(1.0, abs=0.006)


@pytest.mark.parametrize(
    ("off", "on"), [("M420 S0", "M420 S1 Z10"), ("BED_MESH_CLEAR", "BED_MESH_PROFILE LOAD=a")]
)
def test_the_mesh_is_switched_off_and_on(off: str, on: str) -> None:
    text = f"G29\nG1 X60 Y50 Z1 F1800\nG4 P200\n{off}\nG4 P300\n{on}\nG4 P400\nM114\nG91\nG1 Z1\n"
    run = Bed(printer(), text).run()
    assert run.faults == []
    assert run.keeps_limits()
    rows, told = np.array(run.rows), np.array(run.targets)
    standing = (np.abs(rows - np.array([60.0, 50.0, 1.0]) * MM) < 1e-9).all(axis=1)
    lifted = (told - rows)[standing][:, 2] / MM
    backlash = 0.002
    assert lifted[100] == pytest.approx(bowed(0.06, 0.05) / MM, abs=0.006)
    assert np.abs(np.abs(lifted) - backlash).min() < 1e-6
    assert lifted[-1] == pytest.approx(lifted[100], abs=1e-9)
    # increments go on from what the program has
    assert rows[-1] / MM == pytest.approx([60.0, 50.0, 2.0])
    assert run.actuals[-1][2] / MM == pytest.approx(2.0, abs=1e-3)


@pytest.mark.parametrize(
    ("bed", "fault"),
    [
        (lambda x, _: 1e-3 * (x > 0.1), FaultCode.BED_TOO_FAR),
        (lambda x, _: -5e-3 * (x > 0.1), FaultCode.NO_CONTACT),
        (lambda x, _: -0.6e-3 * (x > 0.1), FaultCode.BED_TOO_FAR),
        (lambda _x, _y: 6e-3, FaultCode.PROBE_CLOSED),
    ],
)
def test_a_bed_that_is_off_by_more_ends_the_program_and_the_mesh_of_before_stays(
    bed: Callable[[float, float], float], fault: FaultCode
) -> None:
    run = Bed(printer(BEFORE), "G29\nG1 X60 Y0\n", bed).run()
    assert run.faults == [fault]
    assert run.keeps_limits()
    assert error_at(run, 60.0, 0.0) == pytest.approx(0.03)


def test_a_bed_that_takes_more_than_the_reserve_is_refused_though_it_is_within_greatest() -> None:
    wave = [-0.35, 0.35, -0.35]
    run = Bed(
        printer(BEFORE.replace("0.4\n[axis.compensation.mesh]", "0.2\n[axis.compensation.mesh]")),
        "G29\n",
        lambda x, _: MM * float(np.interp(x / MM, [0.0, 60.0, 120.0], wave)),
    ).run()
    assert run.faults == [FaultCode.BED_TOO_STEEP]
    needed, most = run.of(EventKind.FAULT)[0].values
    assert needed > most == pytest.approx(0.18)
    assert error_at(run, 60.0, 0.0) == pytest.approx(0.03)


def test_a_steep_bed_within_the_reserve_keeps_the_limits_at_any_override() -> None:
    def ridge(x: float, y: float) -> float:
        return MM * float(np.interp(x / MM, [0.0, 60.0, 120.0], [-0.2, 0.25, -0.2])) + 5e-4 * y

    rng = np.random.default_rng(3)
    moves = "".join(f"G1 X{x:.2f} Y{y:.2f} F12000\n" for x, y in rng.uniform(0.0, [120.0, 100.0], (14, 2)))
    run = Bed(printer(), f"G29\nG1 Z1\n{moves}M420 S0\nM420 S1\n{moves}", ridge)
    run.until(lambda: len(run.of(EventKind.PROBED)) == 9)
    while not run.ended:
        run.executor.mailbox.set_override(float(rng.choice([0.3, 1.0, 1.8])), 0)
        run.step(170)
    assert run.faults == []
    assert run.keeps_limits(of=[2])
    speed = np.abs(np.diff(np.array(run.targets) - np.array(run.rows), axis=0))[:, 2] / CYCLE_S
    assert speed.max() > 0.05 * LIMITS[2, 0]


def test_a_hold_in_the_midst_of_probing_goes_on_and_finds_the_same() -> None:
    run = Bed(printer(), f"G29\nG1 Z1\n{MOVES}")
    for count in (0, 3, 7):
        run.until(lambda count=count: len(run.of(EventKind.PROBED)) == count and run.rows[-1][2] < 1.2 * MM)
        run.executor.mailbox.set_hold(True, 0)
        run.step(300)
        standing = run.rows[-1].copy()
        run.step(50)
        assert np.array_equal(run.rows[-1], standing)
        run.executor.mailbox.set_hold(False, 0)
    run.run()
    assert run.faults == []
    assert run.keeps_limits()
    assert np.array(heights(run, POINTS))[:3] / MM == pytest.approx(1.0, abs=0.006)


@pytest.mark.parametrize("how", ["abort", "estop", "trip"])
@pytest.mark.parametrize("met", [4, 9])
def test_a_stop_in_the_midst_keeps_the_limits_and_the_mesh_of_before(how: str, met: int) -> None:
    run = Bed(printer(), "G29\nG1 X60 Y0\n")
    run.until(lambda: len(run.of(EventKind.PROBED)) == met and run.rows[-1][2] > 0.2 * MM)
    if how == "trip":
        run.executor.buses[0].trip(2)  # type: ignore[attr-defined]
    elif how == "abort":
        run.executor.mailbox.abort(0)
    else:
        run.executor.mailbox.emergency_stop()
    run.step(1500)
    assert run.of(EventKind.STOPPED)
    if how == "abort":
        assert run.keeps_limits()
    assert error_at(run, 60.0, 50.0) == 0.0


def test_a_reference_found_anew_elsewhere_over_the_bed_is_that_of_before() -> None:
    homing = '[axis.homing]\nmethod = "switch"\nvelocity = 20.0\ndirection = "positive"\nposition = 30.0\n'
    text = text_of(FILE + homing, "input = 4", "simulated") + "home_switch = [30.0, 1000.0]\n"
    run = Bed(parse_machine(text), "")
    run.executor.mailbox.abort(0)
    run.until(lambda: run.ended)

    def home() -> float:
        program = Program(run.executor.open_slot(1), 3)
        program.capture()
        program.control(ControlKind.HOME, axes=0b100)
        program.finish()
        found: list[ExecutorEvent] = []
        while not any(each.program == 1 and each.kind is EventKind.FINISHED for each in found):
            run.executor.step()
            found += run.executor.events()
            assert not [each for each in found if each.kind is EventKind.FAULT]
        return float(run.executor.executor.bank.offset[2]) / MM

    first = home()
    run.go_on(f"{HEAD}G29\nG1 Z1\n{MOVES}G1 X120 Y0\n")
    assert run.faults == []
    assert np.array(heights(run, POINTS))[:3] / MM == pytest.approx(1.0, abs=0.01)
    # over the highest corner
    assert error_at(run, 120.0, 0.0) < -0.25
    assert home() == pytest.approx(first, abs=0.004)
    # the mesh is the server's, and counts for the next program
    run.go_on(f"G90\nG1 Z1 F1800\n{MOVES}")
    assert run.faults == []
    assert np.array(heights(run, POINTS))[:3] / MM == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("order", ["hold", "abort"])
def test_a_switch_is_within_the_limits_whatever_is_ordered_meanwhile(order: str) -> None:
    run = Bed(printer(), "G29\nG1 X60 Y50 Z1 F1800\nG4 P200\nM420 S0\nG1 X0 F6000\n")
    run.until(lambda: any(each.line == 7 for each in run.of(EventKind.LINE_START)))
    run.step(20)
    if order == "hold":
        run.executor.mailbox.set_hold(True, 0)
        run.step(400)
        assert run.rows[-1] / MM == pytest.approx([60.0, 50.0, 1.0])
        run.executor.mailbox.set_hold(False, 0)
    else:
        run.executor.mailbox.abort(0)
    run.run()
    run.step(500)
    assert run.keeps_limits()
    # half of the backlash is left
    assert abs(run.targets[-1][2] - run.rows[-1][2]) == pytest.approx(0.002 * MM, abs=1e-9)


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("G29 J", "MC113"),
        ("G29 S1", "MC113"),
        ("G29 P2", "MC116"),
        ("G29 P", "MC116"),
        ("G29 P1 P1", "MC111"),
        ("G29 G1 X5", "MC153"),
        ("M420 S2", "MC116"),
        ("M420 S0.5", "MC116"),
        ("M420 S", "MC116"),
        ("M420 L1", "MC113"),
        ("M420 S1 L1", "MC113"),
        ("BED_MESH_CALIBRATE HORIZONTAL_MOVE_Z=9", "MC113"),
        ("BED_MESH_CALIBRATE garbage", "MC113"),
        ("BED_MESH_CALIBRATE ADAPTIVE=", "MC113"),
        ("BED_MESH_CLEAR PROFILE=a", "MC113"),
        ("BED_MESH_PROFILE LOAD=a REST=b", "MC113"),
        ("BED_MESH_PROFILE", "MC113"),
    ],
)
def test_garbage_parameters_are_refused(line: str, code: str) -> None:
    found = [each.code for each in check_program(f"{HEAD}{line}\n", printer()) if each.severity == "error"]
    assert found == [code]


def test_a_letter_without_its_number_is_not_said_to_be_zero() -> None:
    (found,) = [each for each in check_program(f"{HEAD}M420 S\n", printer()) if each.severity == "error"]
    assert found.message == "M420 S without a number is not done here"


@pytest.mark.parametrize("line", ["G29 P3.2", "M420", "M420 V", "BED_MESH_PROFILE SAVE=a", "BED_MESH_OUTPUT"])
def test_what_reports_saves_or_fills_moves_nothing(line: str) -> None:
    assert not [each for each in check_program(f"{line}\n", printer()) if each.severity == "error"]
    run = Bed(printer(), f"{line}\n").run()
    assert run.faults == []
    assert not run.of(EventKind.PROBED)


def test_without_the_keys_the_codes_have_no_effect_and_that_is_said_once() -> None:
    made = printer(FILE.split("[axis.compensation.mesh]")[0])
    text = f"{HEAD}G29\nM420 S1 Z2\nM420 S0\nBED_MESH_CALIBRATE\nBED_MESH_CLEAR\n"
    (said,) = [each for each in check_program(text, made) if "nothing is probed" in each.message + each.hint]
    assert said.severity == "warning"
    found = simulate(text, made)
    assert found.exit_code == 0
    assert found.report["axes"]["2"]["min"] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("probe", "lowest", "error"),
    [("input = 4", -0.8, 0.0), ("input = 4\nsimulated_at = { Z = 0.1 }", -0.05, -0.1)],
)
def test_simulations_probe_too_and_a_check_says_what_it_takes_for_granted(
    probe: str, lowest: float, error: float
) -> None:
    made = printer(probe=probe, drive="ideal")
    assert any(each.code == "MC166" and "G29" in each.message for each in check_program("G29\n", made))
    found = simulate(f"{HEAD}G29\nG29\nG1 Z1\n", made)
    assert found.exit_code == 0
    assert found.report["axes"]["2"]["min"] == pytest.approx(lowest, abs=0.01)
    run = Planned(made, f"{HEAD}G29\nG29\n")
    while not run.ended:
        run.step()
    assert run.faults == []
    assert error_at(run, 60.0, 50.0) == pytest.approx(error, abs=1e-6)


def test_g29_goes_on_from_where_the_axes_really_are() -> None:
    # behind the touch Z is where the probe stopped, not where the line says: it is lifted from there
    run = Bed(printer(), "G1 X60 Y50\nG38.2 Z-5 F300\nG29\nG91\nG1 Z1\n", lambda _x, _y: 0.0).run()
    assert run.faults == []
    rows = np.array(run.rows) / MM
    assert rows[-1] == pytest.approx([120.0, 100.0, 2.5])
    lateral = (np.abs(np.diff(rows[:, :2], axis=0)) > 0.0).any(axis=1)
    assert rows[1:][lateral, 2].min() >= 1.5 - 1e-9


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("clear = 1.5", "clear = 0.8", "more than twice greatest"),
        ("clear = 1.5", "clear = 250.0", "beyond the travel of axis 2"),
        ("axes = [0, 1]", "axes = [0, 2]", "of linear axes over others|over two others"),
        ("clear = 1.5", "clear = 1.5\noffset = [20.0, 0.0]", "beyond the travel of axis 0"),
        ("clear = 1.5", "", "clear"),
        ("[axis.compensation.mesh.probe]", "errors = [[0.0]]\n[axis.compensation.mesh.probe]", "3 rows of 3"),
    ],
)
def test_keys_that_do_not_fit_are_refused_with_their_reason(old: str, new: str, says: str) -> None:
    with pytest.raises(MachineFileRejected, match=says):
        printer(FILE.replace(old, new))


def test_a_machine_that_is_no_printer_or_has_no_probe_cannot_have_them() -> None:
    for one, other in (('profile = "printer"', 'profile = "cnc"'), ("[probe]\ninput = 4\n", "")):
        with pytest.raises(MachineFileRejected, match="on a machine with"):
            parse_machine(text_of(FILE, "input = 4", "ideal").replace(one, other))


@cache
def reports_behind(text: str) -> AxisReports:
    """What a server knows of the mesh behind a program, or where none has run."""
    made = printer()
    reports = AxisReports(made.axes, cast("References", None), cast("EventLog", None))
    for event in Bed(made, text).run().of(EventKind.MESHED) if text else []:
        assert reports.handle(event, None)
    return reports


@pytest.mark.parametrize(
    ("begins", "now", "line", "refused"),
    [
        ("", "", "G29", True),
        ("", "G29\n", "G29", False),
        ("", "G29\nM420 S0\n", "G29", True),
        ("", "G29\nM420 S0\nM420 S1\n", "G29", False),
        ("", "", "M420 S0", True),
        ("", "M420 S0\n", "M420 S0", False),
        ("", "", "M420 S1", False),
        # the mesh of a program before, which a restart has lost
        ("G29\n", "", "G1 X5", True),
        ("G29\n", "G29\n", "G1 X5", False),
    ],
)
def test_a_start_behind_a_line_where_another_mesh_counted_is_refused(
    begins: str, now: str, line: str, refused: bool
) -> None:
    made = printer()

    def held(text: str) -> StartState:
        return msgspec.structs.replace(StartState.of(made), mesh=reports_behind(text).mesh)

    state = state_before([*HEAD.split("\n")[:3], line, "G1 X9"], 5, made, held(begins))
    approach = plan_approach(made, state, held(now), [0, 1, 2])
    assert ("MC594" in [each.code for each in approach.needs]) is refused


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "file"),
        ("G29\n", "probed"),
        ("M420 S0\n", "off"),
        ("G29\nM420 S0\n", "off"),
        ("G29\nM420 S0\nM420 S1\n", "probed"),
    ],
)
def test_status_says_which_mesh_counts(text: str, said: str) -> None:
    assert reports_behind(text).bed_mesh == said
