"""G43.5, the tool's direction as I J K, held against forward kinematics of the test's own (D-140)."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from random import Random

import numpy as np
import pytest

from mcserver.errors import ProgramRejected
from mcserver.gcode.modal_codes import modal_codes
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.planning.start_state import StartState
from mcserver.planning.state_before import state_before

from .five_axes import (
    HEAD_HEAD,
    MILLS,
    TABLE_TABLE,
    Array,
    FiveAxes,
    assert_within_limits,
    at_end,
    place,
    reader,
    rows,
    run,
    tips,
)

# tilting axis, and the one about Z; the first that counts of two positions
ROTARY = {"tables": (3, 5), "mixed": (4, 5), "heads": (4, 5)}
FIRST = {"tables": 3, "mixed": 5, "heads": 5}
BEGIN = ("G10 L2 P1 X5 Y-7 Z-200", "G54 G64 F900")


def direction(mill: FiveAxes, positions: dict[int, Array]) -> Array:
    """Where the tool points in the work piece's frame, shape (n, 3), by where a longer one's tip is."""
    longer = dataclasses.replace(mill, length=2.0 * mill.length)
    return (mill.tip(positions) - longer.tip(positions)) / mill.length


@pytest.mark.parametrize("name", MILLS)
def test_the_tool_points_along_i_j_k_at_the_end_of_each_move_and_goes_the_least_way(
    name: str, tmp_path: Path
) -> None:
    """Of the two positions, the tilt one way or the other, by Fanuc's order of axes."""
    mill = MILLS[name]
    machine = mill.machine(tmp_path)
    random = Random(11)
    found = reader(machine, *BEGIN, "G43.5 H1")
    tilting, turning = ROTARY[name]
    for number in range(4, 64):
        vector = np.array([random.uniform(-1, 1), random.uniform(-1, 1), random.uniform(0.1, 1)])
        vector = np.round(vector * random.choice([1.0, 7.0, 0.01]), 5)
        point = np.round([random.uniform(-30, 30) for _ in range(3)], 3)
        before = place(machine, found)
        words = "X{} Y{} Z{}".format(*point) + " I{:.5f} J{:.5f} K{:.5f}".format(*vector)
        found.interpret_text(f"{random.choice(['G0', 'G1'])} {words}", number)
        after = at_end(machine, found)
        np.testing.assert_allclose(tips(mill, after)[0], point, atol=1e-6)
        np.testing.assert_allclose(direction(mill, after)[0], vector / np.linalg.norm(vector), atol=1e-9)
        tilt, turn = float(after[tilting][0]), float(after[turning][0])
        other = {
            tilting: -tilt,
            turning: turned_like(mill, after, {**after, tilting: -after[tilting]}, turning),
        }
        other[turning] += 360.0 * round((before[turning] - other[turning]) / 360.0)
        first = FIRST[name]
        own = abs(float(after[first][0]) - before[first])
        assert own <= abs(other[first] - before[first]) + 1e-6
        assert abs(turn - before[turning]) <= 180.0 + 1e-6


def turned_like(mill: FiveAxes, there: dict[int, Array], tilted: dict[int, Array], turning: int) -> float:
    """Where the axis about Z has to be for another tilt to point as it does there [deg]."""

    def azimuth(positions: dict[int, Array]) -> float:
        x, y, _ = direction(mill, positions)[0]
        return float(np.degrees(np.arctan2(y, x)))

    further = {**tilted, turning: tilted[turning] + 1.0}
    way = (azimuth(further) - azimuth(tilted) + 180.0) % 360.0 - 180.0
    return float(tilted[turning][0]) + (azimuth(there) - azimuth(tilted)) * round(way)


@pytest.mark.parametrize("name", MILLS)
def test_the_moves_are_those_of_g43_4_with_the_rotary_axes_written(name: str, tmp_path: Path) -> None:
    mill = MILLS[name]
    machine = mill.machine(tmp_path)
    letters = ["XYZABC"[axis] for axis in ROTARY[name]]
    vectors, axes = [], []
    found = reader(machine, *BEGIN, "G43.5 H1")
    t = 0.05 * np.arange(60)
    points = np.round(np.stack([25 * np.sin(t), 20 * np.sin(1.3 * t), 30 + 10 * np.sin(0.7 * t)], axis=1), 4)
    lean = np.stack([0.3 + 0.2 * np.sin(t), 0.25 * np.cos(1.1 * t), np.ones(60)], axis=1)
    for number, (point, each) in enumerate(zip(points.tolist(), lean.tolist(), strict=True)):
        code = "G0" if number == 0 else "G1"
        vectors.append(
            f"{code} X{point[0]} Y{point[1]} Z{point[2]} I{each[0]:.9f} J{each[1]:.9f} K{each[2]:.9f}"
        )
        found.interpret_text(vectors[-1], number + 4)
        ends = place(machine, found)
        turns = " ".join(
            f"{letter}{ends[axis]:.10f}" for letter, axis in zip(letters, ROTARY[name], strict=True)
        )
        axes.append(f"{code} X{point[0]} Y{point[1]} Z{point[2]} {turns}")
    runs = [
        run(machine, "\n".join([*BEGIN, code, *lines]))
        for code, lines in (("G43.5 H1", vectors), ("G43.4 H1", axes))
    ]
    one, other = (np.stack(list(rows(each, machine).values()), axis=1) for each in runs)
    assert abs(len(one) - len(other)) <= 1
    least = min(len(one), len(other))
    np.testing.assert_allclose(one[:least], other[:least], atol=2e-4)
    assert_within_limits(runs[0], machine)


def test_a_direction_left_out_stays_and_a_part_left_out_is_zero(trunnion: Machine) -> None:
    found = reader(trunnion, *BEGIN, "G43.5 H1", "G1 X10 Y0 Z20 I0.5 J0.5 K1")
    there = at_end(trunnion, found)
    found.interpret_text("X15 Y5", 5)
    stays = at_end(trunnion, found)
    assert [stays[axis][0] for axis in (3, 5)] == pytest.approx(
        [there[axis][0] for axis in (3, 5)], abs=1e-12
    )
    np.testing.assert_allclose(tips(TABLE_TABLE, stays)[0], [15.0, 5.0, 20.0], atol=1e-6)
    # the tool alone turns about its tip, by F of rotary axes
    found.interpret_text("J1", 6)
    np.testing.assert_allclose(direction(TABLE_TABLE, at_end(trunnion, found))[0], [0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(tips(TABLE_TABLE, at_end(trunnion, found))[0], [15.0, 5.0, 20.0], atol=1e-6)
    found.interpret_text("G91 X1 Z-2 I0 J0 K1", 7)
    np.testing.assert_allclose(tips(TABLE_TABLE, at_end(trunnion, found))[0], [16.0, 5.0, 18.0], atol=1e-6)
    np.testing.assert_allclose(direction(TABLE_TABLE, at_end(trunnion, found))[0], [0.0, 0.0, 1.0], atol=1e-9)


def test_where_the_tool_is_parallel_to_an_axis_that_one_stays(trunnion: Machine) -> None:
    found = reader(trunnion, *BEGIN, "G43.5 H1", "G1 X10 Y0 Z20 I0.3 J0.2 K1")
    turn = place(trunnion, found)[5]
    found.interpret_text("X5 I0 J0 K1", 5)
    there = place(trunnion, found)
    assert there[5] == pytest.approx(turn, abs=1e-12)
    assert there[3] == pytest.approx(0.0, abs=1e-9)


def test_arcs_have_their_centre_by_r_and_i_j_k_are_the_direction(trunnion: Machine) -> None:
    lines = [*BEGIN, "G43.5 H1", "G0 X20 Y0 Z10 I0 J0 K1", "G17 G3 X-20 Y0 R20 I0.2 J-0.3 K1"]
    found = run(trunnion, "\n".join(lines))
    assert found.recording is not None
    setpoints, last = rows(found, trunnion), found.recording.line == 5
    points = tips(TABLE_TABLE, {axis: each[last] for axis, each in setpoints.items()})
    assert np.abs(np.hypot(points[:, 0], points[:, 1]) - 20.0).max() <= 0.01
    pointing = direction(TABLE_TABLE, {axis: each[-1:] for axis, each in setpoints.items()})[0]
    np.testing.assert_allclose(pointing, np.array([0.2, -0.3, 1.0]) / np.sqrt(1.13), atol=1e-9)


def test_an_axis_that_rolls_over_counts_on_over_whole_turns(tmp_path: Path) -> None:
    machine = TABLE_TABLE.machine(tmp_path, turntable='rollover = "shortest"\n')
    found = reader(machine, *BEGIN, "G43.5 H1", "G0 X0 Y0 Z20 I0.5 J0 K1")
    start = place(machine, found)[5]
    turns = []
    for number in range(1, 31):
        angle = np.radians(40.0 * number)
        vector = f"I{0.5 * np.cos(angle):.9f} J{0.5 * np.sin(angle):.9f} K1"
        found.interpret_text(f"G1 {vector}", 4 + number)
        turns.append(place(machine, found)[5] - start)
    # against the part, the table turns the other way
    np.testing.assert_allclose(np.abs(turns), 40.0 * np.arange(1, 31), atol=1e-5)


def refused(machine: Machine, *lines: str) -> list[tuple[str, int | None, str]]:
    """Code, axis and message of each error of the last line."""
    found = reader(machine, *BEGIN, *lines[:-1])
    with pytest.raises(ProgramRejected) as rejected:
        found.interpret_text(lines[-1], len(BEGIN) + len(lines))
    return [(each.code, each.axis, each.message) for each in rejected.value.diagnostics]


@pytest.mark.parametrize(
    ("lines", "code"),
    [
        (["G43.5 H1", "G1 X5 A10"], "MC172"),
        (["G43.5 H1", "G1 X5 C10 I0 J0 K1"], "MC172"),
        (["G43.5 H1", "G1 X5 I0 J0 K0"], "MC176"),
        (["G43.5 H1", "G2 X5 Y5 I5 J0 K1"], "MC130"),
        (["G43.5 H1", "G1 X5 R3"], "MC112"),
        (["G43.5 H1 Q2"], "MC113"),
        (["G43.5 H7"], "MC143"),
        (["G43.5 H1", "G28 X0"], "MC172"),
        (["G43.5 H1", "G81 Z-5 R2"], "MC172"),
        # elsewhere I J K are an arc's
        (["G43.4 H1", "G1 X5 I0 J0 K1"], "MC112"),
        (["G43 H1", "G1 X5 I0 J0 K1"], "MC112"),
        (["G43.5 H1", "G49", "G1 X5 I0 J0 K1"], "MC112"),
        (["G43.5 H1", "G43.4 H1", "G1 X5", "I0 J0 K1"], "MC112"),
    ],
)
def test_what_could_go_elsewhere_is_refused(trunnion: Machine, lines: list[str], code: str) -> None:
    found = refused(trunnion, *lines)
    assert code in [each for each, _, _ in found]
    assert all("G43.4" not in message for _, _, message in found if "does not go together" in message)


def test_a_direction_beyond_the_travel_names_the_axis_and_its_limit(tmp_path: Path) -> None:
    machine = TABLE_TABLE.machine(tmp_path)
    text = (tmp_path / "mill.urdf").read_text().replace('"j3" type="continuous"', '"j3" type="revolute"')
    link, limit = '<child link="l3"/>', '<limit lower="-1.6" upper="0.2" effort="1" velocity="1"/>'
    (tmp_path / "mill.urdf").write_text(text.replace(link, link + limit))
    ((code, axis, message),) = refused(machine, "G43.5 H1", "G1 X0 Y0 Z0 I0 J1 K-1")
    assert (code, axis) == ("MC176", 3)
    assert "axis 3 at 135.000°, whose limit is 11.459°" in message
    ((code, axis, message),) = refused(HEAD_HEAD.machine(tmp_path), "G43.5 H1", "G1 X0 Y0 Z0 I0 J1 K-1")
    assert (code, axis) == ("MC176", None)
    assert "no position" in message


def test_it_is_shown_and_a_program_begins_in_its_middle_as_it_comes_there(trunnion: Machine) -> None:
    kinematics = build_kinematics(trunnion)
    lines = [*BEGIN, "G1010", "G43.5 H1", "G1 X10 Y0 Z20 I0.2 J0 K1", "X20 I0.1 J0.3 K1", "Y15", "X0 J-1 K3"]
    whole = reader(trunnion, *lines)
    assert "G43.5" in modal_codes(whole.modal)
    for first in (5, 6, 7, 8):
        before = state_before(lines, first, trunnion, StartState.of(trunnion), kinematics=kinematics)
        rest = Interpreter(trunnion, kinematics=kinematics, positions=before.positions, modal=before.modal)
        for number, line in enumerate(lines[first - 1 :], first):
            rest.interpret_text(line, number)
        assert rest.positions == pytest.approx(whole.positions, abs=1e-12)
    whole.interpret_text("M30", 9)
    assert "G43.5" not in modal_codes(whole.modal)
    assert place(trunnion, whole)[3] != 0.0
