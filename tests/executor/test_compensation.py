"""Backlash and errors of pitch: taken away at the setpoint, within the limits of the file."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.executor.planned import Planned
from tests.executor.rig import CYCLE_S, Array
from tests.machine_text import axes_text

VELOCITY, ACCELERATION, JERK = 0.2, 2.0, 50.0
BACKLASH = 20e-6
BOTH = "compensation = { backlash = 0.02, pitch_errors = [[-60.0, 0.0], [0.0, 0.01], [60.0, -0.005]] }"


def machine(axis: str, drive: str = "ideal") -> Machine:
    text = '[machine]\nname = "worn"\n[motion]\npath_tolerance_mm = 0.05\n'
    limits = {"velocity": 1e3 * VELOCITY, "acceleration": 1e3 * ACCELERATION}
    return parse_machine(
        text + axes_text(range(2), **limits, keys=f"max_jerk = {1e3 * JERK}\n{axis}", drive=drive)
    )


class Told(Planned):
    """A program, and what drives are told: setpoints and corrections together."""

    def __init__(self, text: str, axis: str, drive: str = "ideal", made: Machine | None = None) -> None:
        self.targets: list[Array] = []
        super().__init__(made or machine(axis, drive), f"G90 G94 G17\nG1010\n{text}")

    def _record(self, time: float, line: int, setpoint: Array, actual: Array) -> None:
        super()._record(time, line, setpoint, actual)
        compensator = self.executor.executor.bank.compensator
        self.targets.append(setpoint + (0.0 if compensator is None else compensator.correction))

    def play(self, orders: dict[int, float] | None = None) -> Told:
        for cycle in range(30_000):
            if orders and cycle in orders:
                self.executor.mailbox.set_override(orders[cycle], 0)
            self.step()
            if self.ended:
                break
        assert self.faults == []
        return self

    @property
    def told(self) -> Array:
        return np.array(self.targets)


def load_of(motor: Array, backlash: float) -> Array:
    """Where a load is whose motor turns by ``backlash`` before it follows, shape (n, K)."""
    load = np.empty_like(motor)
    place = motor[0]
    for number, at in enumerate(motor):
        place = np.clip(place, at - backlash / 2.0, at + backlash / 2.0)
        load[number] = place
    return load


def test_a_circle_of_100_mm_is_round_where_backlash_would_have_left_its_quadrants() -> None:
    text = "G01 X1 Y1 F6000\nX0 Y0\nG02 X0 Y0 I50 J0"

    def rounding(axis: str) -> Array:
        load = load_of(Told(text, axis).play().told, BACKLASH)
        return np.abs(np.hypot(load[:, 0] - 0.05, load[:, 1]) - 0.05)[-3000:-50]

    before, after = rounding(""), rounding("compensation = { backlash = 0.02 }")
    assert (before > 1e-6).mean() > 0.8
    # what is left is there while backlash is being taken up
    assert (after > 1e-6).mean() < 0.04
    assert np.square(after).mean() < 0.2 * np.square(before).mean()


def test_drives_are_told_what_keeps_the_limits_of_the_file_at_any_override() -> None:
    text = "\n".join(f"G01 X{40 * (-1) ** n} Y{7 * n % 31} F12000" for n in range(6)) + "\nG00 X0 Y0"
    rng = np.random.default_rng(5)
    orders = {int(at): float(rng.choice([0.2, 0.6, 1.0, 1.7])) for at in np.arange(200, 6000, 170)}
    run = Told(text, BOTH).play(orders)
    for order, most in enumerate((VELOCITY, ACCELERATION, JERK), start=1):
        assert np.abs(np.diff(run.told, order, axis=0)).max() / CYCLE_S**order <= 1.01 * most, order


@pytest.mark.parametrize("drive", ["ideal", "simulated"])
def test_encoders_are_read_back_as_programmed(drive: str) -> None:
    run = Told("G61\nG01 X30 F6000\nX-30\nX0", BOTH, drive).play()
    error = np.abs(np.array(run.rows) - np.array(run.actuals))[20:]
    assert error.max() < (1e-12 if drive == "ideal" else 3e-5)
    # on the way there from below: half the backlash, and the error of the table taken away
    assert run.told[-1, 0] == pytest.approx(0.5 * BACKLASH - 10e-6, abs=1e-12)


def test_an_exact_stop_waits_until_backlash_is_taken_up() -> None:
    run = Told("G61\nG01 X1 F6000\nX0.9999\nM02", "compensation = { backlash = 0.02 }").play()
    assert run.told[-1, 0] == pytest.approx(0.9999e-3 - 0.5 * BACKLASH, abs=1e-12)
    assert 1 <= len(run.told) - np.flatnonzero(np.diff(run.told[:, 0]))[-1] < 10


def test_an_axis_that_is_off_is_where_it_was() -> None:
    text = "G61\nG01 X1 F6000\nG1020 X0.99\nG04 P0.012\nG1001 P0\nG04 P0.1\nG1010\nG00 X2\nM02"
    run = Told(text, "compensation = { backlash = 0.02 }", "simulated").play()
    for order, most in enumerate((VELOCITY, ACCELERATION), start=1):
        assert np.abs(np.diff(run.told[:, 0], order)).max() / CYCLE_S**order <= 1.2 * most, order
    assert np.array(run.rows)[-1, 0] == pytest.approx(2e-3, abs=1e-12)


def test_a_table_that_takes_too_much_of_the_limits_is_refused_with_the_share() -> None:
    steep = "compensation = { pitch_errors = [[0.0, 0.0], [1.0, 0.05]] }"
    with pytest.raises(MachineFileRejected, match=r"at the axis's limits they take \d+"):
        machine(steep)
    with pytest.raises(MachineFileRejected, match="do not ascend"):
        machine("compensation = { pitch_errors = [[1.0, 0.0], [1.0, 0.05]] }")


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("pitch_errors = [[0.0, 0.0], [1e-300, 0.0]]", "do not ascend by 0.001"),
        ("pitch_errors = [[0.0, 20.0]]", "10 mm or deg at most"),
        ("pitch_errors = [[0.0, 0.0], [10.0, nan]]", "finite"),
        ("square_errors = [[1.5, 0.1]]", "[axis, error for 1000 mm]"),
        # half of it would be further than corrections go, and no exact stop would ever be over
        ("backlash = 3000.0", "expected float <= 10"),
    ],
)
def test_errors_that_no_mechanics_have_are_refused(key: str, says: str) -> None:
    with pytest.raises(MachineFileRejected) as refused:
        machine(f"compensation = {{ {key} }}")
    first = refused.value.diagnostics[0]
    assert first.code == "MC004"
    assert says in f"{first.message} {first.hint}"


def test_an_axis_without_compensation_is_told_its_setpoint_beside_one_with_it() -> None:
    one = machine("").axes[0]
    both = machine("compensation = { backlash = 0.02 }")
    mixed = msgspec.structs.replace(both, axes=(both.axes[0], msgspec.structs.replace(one, index=1)))
    run = Told("G61\nG01 X10 Y10 F6000\nX0 Y5\nM02", "", made=mixed).play()
    assert np.array_equal(run.told[:, 1], np.array(run.rows)[:, 1])
    assert np.array_equal(np.array(run.actuals)[:, 1], np.array(run.rows)[:, 1])
    assert run.told[-1, 0] == pytest.approx(-0.5 * BACKLASH, abs=1e-12)


def test_a_table_alone_may_take_all_of_the_reserve_without_a_jerk_limit() -> None:
    made = machine("compensation = { pitch_errors = [[-1.0, 0.0], [40.0, 0.1]] }")
    # as where exactly nothing is left for backlash
    axes = [
        msgspec.structs.replace(
            axis, max_jerk=np.inf, compensation=msgspec.structs.replace(axis.compensation, share=0.0)
        )
        for axis in made.axes
        if axis.compensation is not None
    ]
    run = Told("G61\nG01 X40 F6000", "", made=msgspec.structs.replace(made, axes=tuple(axes))).play()
    assert run.told[-1, 0] == pytest.approx(40e-3 - 1e-4, abs=1e-12)


def test_without_compensation_drives_are_told_the_setpoint_itself() -> None:
    executor = VirtualExecutor(machine(""))
    assert executor.executor.bank.compensator is None
