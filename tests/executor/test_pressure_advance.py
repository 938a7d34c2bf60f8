"""E of a printer led ahead: by the flow alone, within its limits, and exact at rest (D-143)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from mcserver.executor.entries import Array
from mcserver.executor.fault_codes import FaultCode
from mcserver.gcode.modal_codes import modal_codes
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.language.grammar.dialect import build_grammar
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.machine.section_reader import MachineFileRejected
from mcserver.simulation.simulation import simulate
from mcserver.units import MM
from tests.executor.coupled import Coupled, under_orders
from tests.gcode.test_retraction import faults
from tests.language.grammar_reader import Recognizer
from tests.limits import broken_limits
from tests.machine_text import axes_text

K, E, COLUMN = 0.05, 6, 3
ADVANCE = "pressure_advance = { greatest_s = 0.05, flow = 10.0, initial_s = INITIAL }"
SQUARE = "M83\nF{feed}\nG1 X20 E0.8\nG1 Y20 E0.8\nG1 X0 E0.8\nG1 Y0 E0.8\n"
# prime, print, retraction, travel and firmware's stop of the flow, into each other
MIXED = "M83\nF6000\nG1 E0.5\nG1 X20 E0.8\nG1 Y20 E1\nG1 E-2 F2400\nG0 X0 Y0\nG1 E2\nG1 X9 Y3 E0.5 F4000\n"


def machine(
    initial: float = 0.0,
    *,
    more: str = "",
    advance: str = ADVANCE,
    profile: str = "printer",
    drive: str = "ideal",
) -> Machine:
    xyz = axes_text((0, 1, 2), velocity=300.0, acceleration=3000.0)
    keys = f"{advance.replace('INITIAL', str(initial))}\n{more}"
    extruder = axes_text((E,), velocity=120.0, acceleration=5000.0, keys=keys, drive=drive)
    return parse_machine(
        f'[machine]\nname = "p"\n[motion]\npath_tolerance_mm = 0.05\n[dialect]\nprofile = "{profile}"\n'
        f"letters = {{ E = {E} }}\n{xyz}{extruder}"
    )


MACHINE = machine(K)


def played(text: str, described: Machine) -> Array:
    """Setpoints of all axes [m]."""
    found = simulate(text, described, record=True)
    assert found.report["ok"], found.report["diagnostics"]
    assert found.recording is not None
    points = np.asarray(found.recording.setpoint) * MM
    # from the last motion on it rests
    (under_way,) = np.nonzero((points != points[-1]).any(axis=1))
    return points[: under_way[-1] + 2] if len(under_way) else points


def broken(points: Array) -> list[str]:
    """Limits of the machine file that E's setpoints pass in any cycle."""
    return broken_limits(points[:, COLUMN], [120.0 * MM, 5000.0 * MM])


def flow_error(points: Array) -> float:
    """Mean error of what a nozzle lets out beside what the path's speed needs [m/s], of first order in K."""
    step = np.diff(points, axis=0) / 1e-3
    needed, flow, found = 0.04 * np.hypot(step[:, 0], step[:, 1]), 0.0, []
    for pushed in step[:, COLUMN].tolist():
        flow += (pushed - flow) * 1e-3 / K
        found.append(flow)
    return float(np.sqrt(np.mean((np.array(found) - needed) ** 2)))


@pytest.mark.parametrize(("feed", "share"), [(3600, 0.35), (7200, 0.2)])
def test_the_nozzle_lets_out_what_the_path_needs(feed: int, share: float) -> None:
    plain, led = (played(f"{SQUARE.format(feed=feed)}M2", machine(each)) for each in (0.0, K))
    assert flow_error(led) < share * flow_error(plain)
    assert broken(led) == []
    # the path itself is the same
    both = slice(min(len(plain), len(led)))
    assert np.array_equal(plain[both, :3], led[both, :3])


def test_travel_retraction_and_e_alone_are_not_led_and_rest_is_exact() -> None:
    text = "M83\nG1 E3 F3000\nG1 E-2 F2400\nG0 X30 Y5\nG1 X10 E-0.5 F6000\nM2"
    plain, led = (played(text, machine(each)) for each in (0.0, K))
    assert np.array_equal(plain, led)
    printed = played(f"{MIXED}G4 P100\nM2", MACHINE)
    assert np.array_equal(printed[-1], played(f"{MIXED}G4 P100\nM2", machine())[-1])
    assert broken(printed) == []


def test_the_file_keeps_limits_for_it_and_its_path_is_left_no_further() -> None:
    axis, shaping = MACHINE.axes[COLUMN], MACHINE.shaping
    assert shaping is not None
    assert (axis.max_velocity, axis.max_acceleration) == pytest.approx((95.0 * MM, 2500.0 * MM))
    assert (shaping.deviations[COLUMN], shaping.speed_changes[COLUMN]) == pytest.approx((0.5 * MM, 25.0 * MM))
    assert (shaping.path_deviation, shaping.delay) == (0.0, 20)


@under_orders(2000, ends_from=300)
def test_whatever_is_ordered_limits_are_kept_and_a_stop_leaves_e_where_it_was_ordered(
    orders: dict[int, Callable[[Coupled], None]], at: int, end: Callable[[Coupled], None]
) -> None:
    cell = Coupled(MACHINE, f"{MIXED * 2}M900 K0.02\n{MIXED}M2")
    cell.play({**orders, at: end})
    assert broken(np.array(cell.rows)) == []
    row, shaper = cell.executor.executor.row, cell.executor.executor.bank.shaper
    assert shaper is not None
    assert row.setpoint[COLUMN] == row.ordered[COLUMN]
    assert shaper.added[COLUMN] == 0.0


def test_a_drive_that_fails_in_a_print_has_no_offset_left() -> None:
    cell = Coupled(machine(K, drive="simulated"), f"{SQUARE.format(feed=3600)}M2")
    cell.play({450: lambda each: each.bus.trip(COLUMN)})
    assert cell.faults == [FaultCode.OVER_TEMPERATURE]
    row, shaper = cell.executor.executor.row, cell.executor.executor.bank.shaper
    assert shaper is not None
    assert row.setpoint[COLUMN] == row.ordered[COLUMN]
    assert shaper.added[COLUMN] == 0.0


def test_a_new_k_comes_in_where_no_flow_counts_whoever_orders_it() -> None:
    cell = Coupled(MACHINE, f"{SQUARE.format(feed=3600)}M2")
    shaper = cell.executor.executor.bank.shaper
    assert shaper is not None
    advance = shaper.advance
    assert advance is not None
    cell.step(400)
    advance.choose(0.01)
    cell.step()
    assert advance.gain == K
    cell.play()
    assert advance.gain == 0.01
    assert broken(np.array(cell.rows)) == []


@pytest.mark.parametrize(
    "code",
    [
        "M900 K0.05",
        "M900 K0.05 L1000 M10",
        "M572 D0 S0.05",
        "SET_PRESSURE_ADVANCE EXTRUDER=extruder ADVANCE=0.05 SMOOTH_TIME=0.04",
    ],
)
def test_each_code_sets_k_from_its_line_on(code: str) -> None:
    before, behind = SQUARE.format(feed=3600), f"G4 P100\n{SQUARE.format(feed=6000)}M2"
    found = played(f"{before}{code}\n{behind}", machine())
    plain, led = (played(f"{before}{behind}", machine(each)) for each in (0.0, K))
    # from the end, as the change takes some cycles at an exact stop
    half = len(plain) // 3
    assert np.abs(found[-half:] - led[-half:]).max() < 1e-12
    assert np.array_equal(found[:half], plain[:half])
    assert not np.array_equal(plain[-half:], led[-half:])


def test_a_start_in_the_middle_has_k_and_the_next_program_that_of_the_file() -> None:
    whole = Interpreter(machine())
    whole.interpret_text("M900 K0.02", 1)
    later = Interpreter(machine(), modal=whole.modal)
    assert later.modal.advance == 0.02
    assert "M900 K0.02" in modal_codes(later.modal)
    later.interpret_text("M2", 2)
    assert later.modal.advance is None


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("M900 K0.06", "MC116"),
        ("M572 S-0.01", "MC116"),
        ("SET_PRESSURE_ADVANCE SMOOTH_TIME=0.02", "MC116"),
        ("SET_PRESSURE_ADVANCE EXTRUDER=extruder1 ADVANCE=0.01", "MC143"),
        ("SET_PRESSURE_ADVANCE ADVANCE=much", "MC113"),
        ("M900 T1 K0.01", "MC143"),
        ("M900 S0.01", "MC113"),
        ("M900 K0.01 G1 X5", "MC153"),
    ],
)
def test_what_it_cannot_do_is_refused(text: str, code: str) -> None:
    assert faults(text, MACHINE) == [code]
    # without the section these lines have no effect
    assert faults(text, machine(advance="")) == ["MC142"]


def test_the_grammar_has_k_of_the_file_and_no_other() -> None:
    accepts = Recognizer(build_grammar(MACHINE)).accepts
    lines = ("M900 K0.02", "M900 K9", "M572 S9", "SET_PRESSURE_ADVANCE ADVANCE=9")
    assert [line for line in lines if accepts(line)] == ["M900 K0.02"]
    without = Recognizer(build_grammar(machine(advance=""))).accepts
    assert all(without(line) for line in lines)


@pytest.mark.parametrize(
    ("described", "place"),
    [
        ({"advance": ADVANCE.replace("10.0", "20.0")}, "nothing is left of max_acceleration"),
        ({"more": "max_jerk = 50000.0"}, "nothing is left of max_jerk"),
        ({"initial": 0.06}, "initial_s"),
        ({"profile": "cnc"}, "axis E of a printer"),
        ({"more": 'shaper = { type = "zv", frequency_hz = 40.0 }'}, "shaper"),
    ],
)
def test_files_that_leave_nothing_are_refused(described: dict[str, str], place: str) -> None:
    with pytest.raises(MachineFileRejected, match=place):
        machine(**described)  # type: ignore[arg-type]
