"""Lasers (D-77): power as a function of the path that is played, without a stop for S."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from mcserver.executor.entries import EventKind
from mcserver.gcode.program_check import check_program
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before
from mcserver.service.approach import plan_approach
from mcserver.simulation.simulation import Simulation, simulate
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.executor.planned import Planned
from tests.machine_text import axes_text

Array = NDArray[np.float64]
HEAD = ["G21 G90 G94 F6000"]


def machine(*, laser: str = "laser = true", extra: str = "", rapids: str = "independent") -> Machine:
    text = '[machine]\nname = "cutter"\n[motion]\npath_tolerance_mm = 0.05\n'
    text += axes_text(range(3), velocity=400.0)
    text += f'[dialect]\nprofile = "cnc"\nrapids = "{rapids}"\n[dialect.outputs]\n'
    text += 'M3 = { power = "S" }\nM4 = { power = "S" }\nM5 = { power = 0 }\n'
    return parse_machine(
        f'{text}[[output]]\nnumber = 0\nname = "power"\nkind = "analog"\nmax = 1000.0\n{laser}\n{extra}'
    )


def run(lines: list[str], described: Machine | None = None) -> Simulation:
    found = simulate("\n".join([*HEAD, *lines]), described or machine(), record=True)
    assert found.report["ok"], found.report["diagnostics"]
    return found


def columns(found: Simulation) -> tuple[Array, Array, Array]:
    """Return path speed in the plane [mm/s], power, and line of every cycle."""
    recorded = found.recording
    assert recorded is not None
    velocity = np.gradient(recorded.setpoint[:, :2], 0.001, axis=0)
    return np.linalg.norm(velocity, axis=1), recorded.outputs["power"], recorded.line


def test_m3_is_the_same_at_any_speed_and_dark_at_rest() -> None:
    found = run(["M3 S400", "G1 X30", "G4 P0.1", "G1 Y30", "M5", "G1 X0"])
    speed, power, line = columns(found)
    feeding = (line == 3) | (line == 5)
    assert set(power[feeding & (speed > 2.5)]) == {400.0}
    assert (power[line == 4] == 0.0).all()
    assert (power[line == 7] == 0.0).all()
    assert power[-1] == 0.0


@pytest.mark.parametrize("rapids", ["independent", "straight"])
@pytest.mark.parametrize("code", ["M3", "M4"])
def test_rapids_are_dark_and_the_power_is_back_behind_them(code: str, rapids: str) -> None:
    lines = [f"{code} S800", "G1 X20", "G0 X40 Y30", "G1 X60", "G0 Y0", "G1 X0"]
    _, power, line = columns(run(lines, machine(rapids=rapids)))
    for number in (4, 6):
        inside = line == number
        # the row on the boundary is the motion's before
        assert (power[inside][1:] == 0.0).all()
    for number in (3, 5, 7):
        assert power[line == number].max() == pytest.approx(800.0)


def test_m4_is_in_proportion_to_the_speed_through_corners_and_ramps() -> None:
    lines = ["M4 S500", "G1 X30", "Y30", "X0 F3000", "Y5", "M5"]
    speed, power, line = columns(run(lines))
    for number, feed in ((3, 100.0), (4, 100.0), (5, 50.0), (6, 50.0)):
        inside = np.flatnonzero(line == number)[1:-1]
        wanted = 500.0 * np.minimum(1.0, speed[inside] / feed)
        np.testing.assert_allclose(power[inside], wanted, atol=500.0 * 1.1 / feed)
        assert power[inside].min() < 400.0 or number == 4


def test_m4_follows_the_times_of_g93() -> None:
    speed, power, line = columns(run(["G93 M4 S500", "G1 X30 F120", "Y30 F60", "M5"]))
    for number, feed in ((3, 60.0), (4, 30.0)):
        # the peak passes length / T, where the power is no more than S
        assert power[line == number].max() == pytest.approx(500.0)
        slow = np.flatnonzero((line == number) & (speed < 0.95 * feed))[1:-1]
        np.testing.assert_allclose(power[slow], 500.0 * speed[slow] / feed, atol=500.0 * 1.1 / feed)


@pytest.mark.parametrize("code", ["M3", "M4"])
def test_a_thousand_powers_on_chords_take_the_time_of_the_chords(code: str) -> None:
    chords = [f"G1 X{0.1 * n:.3f} Y{5.0 * np.sin(0.01 * n):.4f}" for n in range(1, 1001)]
    plain = run([f"{code} S500", *chords])
    powered = run([f"{code} S0", *(f"{each} S{n % 7 * 100 + 50}" for n, each in enumerate(chords))])
    assert powered.report["duration_s"] <= 1.05 * plain.report["duration_s"]
    _, power, line = columns(powered)
    for number in range(200, 800):
        rows = np.flatnonzero(line == number + 3)
        if len(rows) and code == "M3":
            # the row on the boundary may have either
            assert set(power[rows[1:]]) <= {number % 7 * 100 + 50.0}


def play(lines: list[str], orders: dict[int, Callable[[VirtualExecutor], None]]) -> tuple[Array, Array]:
    """Play a program with orders in some cycles; return the setpoints of X [m] and the power by cycle."""
    played = Planned(machine(), "\n".join([*HEAD, *lines]))
    powers = []
    for cycle in range(3000):
        orders.get(cycle, lambda _: None)(played.executor)
        played.step()
        powers.append(float(played.executor.executor.row.outputs[0]))
        if played.of(EventKind.FINISHED):
            break
    return np.array(played.rows)[:, 0], np.array(powers)


@pytest.mark.parametrize("code", ["M3", "M4"])
def test_a_hold_is_dark_in_the_very_cycle_in_which_the_axes_stand(code: str) -> None:
    places, powers = play(
        [f"{code} S500", "G1 X100", "M5"],
        {300: lambda to: to.mailbox.set_hold(True, 0), 800: lambda to: to.mailbox.set_hold(False, 0)},
    )
    moved = np.diff(places, prepend=places[0])
    (stood,) = np.nonzero((moved == 0.0) & (np.arange(len(moved)) > 300) & (np.arange(len(moved)) < 800))
    assert powers[300] > 0.0
    assert (powers[stood] == 0.0).all()
    assert powers[stood[0] - 2] > 0.0
    assert len(stood) > 300
    assert powers[900] == pytest.approx(500.0)
    assert places[-1] == pytest.approx(0.1)


def test_an_override_scales_the_power_of_m4_and_not_that_of_m3() -> None:
    for code, wanted in (("M3", 500.0), ("M4", 250.0)):
        _, powers = play([f"{code} S500", "G1 X100"], {0: lambda to: to.mailbox.set_override(0.5, 0)})
        assert powers[500] == pytest.approx(wanted)


@pytest.mark.parametrize("order", ["abort", "estop"])
def test_an_abort_is_dark_from_its_cycle_on(order: str) -> None:
    def stop(to: VirtualExecutor) -> None:
        if order == "abort":
            to.mailbox.abort(0)
        else:
            to.mailbox.emergency_stop()

    places, powers = play(["M3 S500", "G1 X100"], {300: stop})
    assert powers[299] == 500.0
    assert (powers[300:] == 0.0).all()
    assert places[320] > places[300]


def test_a_pause_and_the_end_are_dark() -> None:
    _, powers = play(["M3 S500", "G1 X30", "M0", "G1 X60"], {})
    assert powers.max() == 500.0
    assert (powers[600:] == 0.0).all()


def test_what_the_machine_file_cannot_mean_is_refused() -> None:
    for written in ("laser = true\ninitial = 10.0", "laser = true\nmin = 5.0", 'laser = true\nsafe = "keep"'):
        with pytest.raises(MachineFileRejected, match="of a laser are 0"):
            machine(laser=written)


def test_only_outputs_that_stop_the_motion_are_warned_of() -> None:
    text = "\n".join([*HEAD, "M3 S0", *(f"G1 X{at} S{100 * at}" for at in range(1, 7)), "M5"])
    assert "MC148" in [each.code for each in check_program(text, machine(laser=""))]
    assert "MC148" not in [each.code for each in check_program(text, machine())]


def test_a_start_in_the_midst_of_m4_is_refused_and_one_of_m3_is_asked_for() -> None:
    described = machine()
    for code, confirm in (("M4", ""), ("M3", "outputs")):
        start = StartState.of(described)
        before = state_before([*HEAD, f"{code} S500", "G1 X10", "G1 X20"], 4, described, start)
        needs = plan_approach(described, before, start, [0, 1, 2]).needs
        assert confirm in [each.confirm for each in needs if each.code == "MC593"]


def test_a_start_in_a_raster_has_the_power_of_the_line_before_it() -> None:
    described = machine()
    lines = [*HEAD, "M3 S500", *(f"G1 X{at} S{10 * at}" for at in range(1, 60))]
    before = state_before(lines, len(lines) + 1, described, StartState.of(described))
    assert before.outputs == {0: 590.0}


def one_by_one(*_: object) -> int:
    """As if no lines could be read in columns."""
    return 0


@pytest.mark.parametrize("code", ["M3", "M4"])
@pytest.mark.parametrize("mode", ["G94 F6000", "G93 F900", "G61"])
def test_a_raster_in_columns_shines_as_one_line_by_line(
    code: str, mode: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    lines = [f"{code} S300 {mode}", "G1 X1"]
    for row in range(4):
        ends = range(1, 30) if row % 2 else range(30, 1, -1)
        lines += [f"G1 X{0.5 * at} S{100 * (at % 7)}" if at % 5 else f"X{0.5 * at}" for at in ends]
        lines += [f"G0 Y{row}", f"F{3000 + 500 * row}", "G91", "G2 X2 I1 S50", "G90 G1"]
        lines.append("M5" if row == 2 else code)
    quick = columns(run(lines))
    monkeypatch.setattr("mcserver.gcode.semantics.interpreter.Interpreter.batch_window", one_by_one)
    for one, other in zip(quick, columns(run(lines)), strict=True):
        np.testing.assert_array_equal(one, other)
