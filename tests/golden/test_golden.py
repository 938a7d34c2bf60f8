"""Programs with their expectations: what `mcserver simulate` has to report, and where the setpoints pass.

Each ``name.gcode`` has a ``name.json`` beside it; numbers are {"value", "within"} in mm, degrees and seconds.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mcserver.machine.machine_file import BUILT_IN, Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.simulation import Simulation, simulate
from tests.limits import assert_keeps, limits_of

HERE = Path(__file__).parent
NAMES = sorted(path.stem for path in HERE.glob("*.gcode"))


@pytest.fixture(scope="module", params=NAMES)
def golden(request: pytest.FixtureRequest) -> tuple[Machine, Simulation, dict[str, Any]]:
    name: str = request.param
    expected = json.loads((HERE / f"{name}.json").read_text("utf-8"))
    wanted = expected["machine"]
    machine = load_machine(wanted if wanted in BUILT_IN else str(HERE / "machines" / f"{wanted}.toml"))
    text = (HERE / f"{name}.gcode").read_text("utf-8")
    return machine, simulate(text, machine, kinematics=build_kinematics(machine), record=True), expected


Golden = tuple[Machine, Simulation, dict[str, Any]]


def near(expected: dict[str, float]) -> Any:
    return pytest.approx(expected["value"], abs=expected["within"])


def test_the_report_is_as_expected(golden: Golden) -> None:
    _, simulation, expected = golden
    report = simulation.report
    assert report["ok"] is expected.get("ok", True), report["diagnostics"]
    assert simulation.exit_code == expected.get("exit_code", 0)
    for key in ("duration_s", "feed_length_mm"):
        if key in expected:
            assert report[key] == near(expected[key]), key
    for axis, wanted in expected.get("axes", {}).items():
        for key, value in wanted.items():
            assert report["axes"][axis][key] == near(value), f"axis {axis} {key}"


def test_lines_take_the_time_that_they_ask_for(golden: Golden) -> None:
    _, simulation, expected = golden
    lines = {str(line["line"]): line for line in simulation.report["lines"]}
    for number, wanted in expected.get("lines", {}).items():
        line = lines[number]
        if "took" in wanted:
            assert line["end_s"] - line["start_s"] == near(wanted["took"]), f"line {number}"
        if "requested" in wanted:
            asked = wanted["requested"]
            assert line["requested_s"] == (None if asked is None else near(asked)), f"line {number}"
        if "stretched_by" in wanted:
            assert line["stretched_by"] == near(wanted["stretched_by"]), f"line {number}"
        if "bound_by" in wanted:
            assert line["bound_by"] == wanted["bound_by"], f"line {number}"


def test_lines_follow_each_other_in_time(golden: Golden) -> None:
    _, simulation, expected = golden
    lines = simulation.report["lines"]
    for before, after in itertools.pairwise(lines):
        assert after["start_s"] >= before["end_s"] - 1e-9
        if expected.get("contiguous"):
            assert after["start_s"] == pytest.approx(before["end_s"], abs=1e-9)


def test_diagnostics_name_the_fault_and_its_line(golden: Golden) -> None:
    _, simulation, expected = golden
    found = simulation.report["diagnostics"]
    wanted = expected.get("diagnostics", [])
    assert len(found) == len(wanted)
    for diagnostic, keys in zip(found, wanted, strict=True):
        assert {key: diagnostic[key] for key in keys} == keys


def test_setpoints_pass_the_points_in_order(golden: Golden) -> None:
    _, simulation, expected = golden
    points = expected.get("passes", [])
    recording = simulation.recording
    if not points:
        return
    assert recording is not None
    path = recording.setpoint[:, : len(points[0])]
    row = 0
    for point in points:
        away = np.linalg.norm(path[row:] - np.array(point), axis=1)
        close = np.nonzero(away <= expected["passes_within_mm"])[0]
        assert len(close), f"{point} is missed by {away.min()} mm"
        row += int(close[0])


def test_axes_arrive_when_they_should(golden: Golden) -> None:
    machine, simulation, expected = golden
    lines = {line["line"]: line for line in simulation.report["lines"]}
    for arrival in expected.get("reaches", []):
        recording = recorded(simulation)
        column = machine.column_of(arrival["axis"])
        away = np.abs(recording.setpoint[:, column] - arrival["position"])
        begun = lines[arrival["line"]]["start_s"]
        there = recording.time_s[(away <= 0.01) & (recording.time_s > begun)]
        assert there[0] - begun == near(arrival["after_s"]), f"axis {arrival['axis']}"


def test_an_exact_stop_ends_with_the_encoder_in_position(golden: Golden) -> None:
    machine, simulation, expected = golden
    lines = {line["line"]: line for line in simulation.report["lines"]}
    for stop in expected.get("in_position", []):
        recording = recorded(simulation)
        end = int(np.searchsorted(recording.time_s, lines[stop["line"]]["end_s"] - 1e-9))
        actual = recording.actual[end, machine.column_of(stop["axis"])]
        assert abs(actual - stop["position"]) <= stop["within"]


def test_a_loop_comes_back_to_its_start(golden: Golden) -> None:
    _, simulation, expected = golden
    if "returns_to_start_within" in expected:
        setpoint = recorded(simulation).setpoint
        assert setpoint[-1] == pytest.approx(setpoint[0], abs=expected["returns_to_start_within"])


def test_setpoints_keep_every_velocity_and_acceleration_limit(golden: Golden) -> None:
    machine, simulation, _expected = golden
    recording = simulation.recording
    if recording is None or len(recording.time_s) < 3:
        return
    unit = np.array([axis.type.si_per_unit for axis in machine.axes])
    # a bus of simulated encoders has noise of its own where an axis is not energized
    assert_keeps(recording.setpoint * unit, limits_of(machine)[:2], machine.cycle_s)


def test_the_recording_is_uniform(golden: Golden) -> None:
    machine, simulation, _ = golden
    recording = simulation.recording
    if recording is None or len(recording.time_s) < 2:
        return
    assert np.diff(recording.time_s) == pytest.approx(machine.cycle_s, abs=1e-9)


def recorded(simulation: Simulation) -> Recorded:
    assert simulation.recording is not None
    return simulation.recording


def test_ten_thousand_short_segments_are_as_quick_as_one_line() -> None:
    machine = load_machine(str(HERE / "machines" / "plain.toml"))
    rows = [f"G01 X{0.05 * count:.2f}" for count in range(1, 10_001)]
    report = simulate("\n".join(["G1010", "G94 F12000", *rows]), machine).report
    took = report["lines"][-1]["end_s"] - report["lines"][0]["start_s"]
    # one trapezoid: 500 mm at 200 mm/s, and 0.2 s for the ramps
    assert 2.7 <= took + 1e-9 <= 2.71
    assert report["axes"]["0"]["position"] == pytest.approx(500.0, abs=1e-6)
