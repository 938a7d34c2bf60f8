"""What is played of a run: its rows, its axes' gauges, the machine's parts, and where in its time it is."""

from __future__ import annotations

import base64
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcclient.types import ModelBody

from mcserver.machine.machine_file import load_machine, parse_machine
from mcserver.simulation.recorder import Recorded
from mcserver.simulation.simulation import simulate
from mcserver.view.stage import Up, up_of
from mcserver.view.zeros import work_zeros
from mcserver.web.panels.replay import axes_html, moving, spans_of
from mcserver.web.playback import Playback
from mcserver.web.replay import MOST_ROWS, axes_of, main, replay_of
from mcserver.web.replay_format import Replay, ReplayAxis
from mcserver.web.robot_model import model_json, portal_json
from mcserver.web.viewer import model_of
from tests.kinematics.tool_machines import built_in

ENDLESS = """[machine]
name = "table"
[[axis]]
index = 3
type = "rotary"
max_velocity = 10.0
max_acceleration = 10.0
"""
TIMES = [index * 1e-3 for index in range(2001)]


def played(name: str, text: str) -> Replay:
    machine, kinematics, _ = built_in(name)
    recording = simulate(text, machine, kinematics=kinematics, record=True).recording
    assert recording is not None
    return replay_of(recording, machine, kinematics)


def at_rest(name_or_text: str, **ends: float) -> Replay:
    machine = parse_machine(name_or_text) if "\n" in name_or_text else load_machine(name_or_text)
    position = np.array([[0.0] * len(machine.axes), [ends.get(str(a.index), 0.0) for a in machine.axes]])
    numbers = np.array([axis.index for axis in machine.axes], float)
    cycles = Recorded(np.array([0.0, 1.0]), np.zeros(2), numbers, position, position)
    return replay_of(cycles, machine, None)


def test_a_replay_is_thinned_and_has_the_tips_of_the_machine() -> None:
    machine, kinematics, _ = built_in("arm6")
    count = 3 * MOST_ROWS
    positions = np.zeros((count, 6))
    positions[:, 0] = np.linspace(0.0, 90.0, count)
    cycles = Recorded(np.arange(count) * 1e-3, np.ones(count), np.arange(6.0), positions, positions)
    made = replay_of(cycles, machine, kinematics)
    assert len(made.time_s) == len(made.position) == MOST_ROWS
    (tip,) = made.tips
    assert (tip.label, len(tip.points)) == ("T1", MOST_ROWS)
    first, last = np.array(tip.points[0]), np.array(tip.points[-1])
    # a quarter turn about Z
    assert last[:2] == pytest.approx([-first[1], first[0]], abs=0.1)
    assert last[2] == pytest.approx(first[2], abs=0.01)


def test_what_is_no_recording_leaves_no_replay(tmp_path: Path) -> None:
    (tmp_path / "bad.mcap").write_bytes(b"no recording")
    assert main(str(tmp_path / "out.json"), str(tmp_path / "bad.mcap")) == 1
    assert not (tmp_path / "out.json").exists()


def test_a_replay_leads_from_where_the_tool_starts_to_where_the_line_ends() -> None:
    _, kinematics, start = built_in("arm6")
    made = played("arm6", "G1010\nG93 F60\nG01 T1 X500 Z600\nG01 Y50\n")
    (tip,) = made.tips
    np.testing.assert_allclose(tip.points[0], 1e3 * np.array(kinematics.pose(1, start).position), atol=0.1)
    np.testing.assert_allclose(tip.points[-1], (500.0, 50.0, 600.0), atol=0.1)
    first, last = spans_of(made.line)[made.line.index(4)] or (0, 0)
    np.testing.assert_allclose(tip.points[first], (500.0, 0.0, 600.0), atol=2.0)
    assert last == len(made.line) - 1 - made.line[::-1].index(4)


def test_a_line_is_drawn_from_the_row_that_it_begins_at() -> None:
    assert spans_of([0, 3, 3, 5, 0]) == [None, (0, 2), (0, 2), (2, 3), None]
    assert spans_of([3, 3]) == [(0, 1), (0, 1)]


def test_without_tools_the_tip_is_that_of_the_axes_0_1_and_2() -> None:
    made = at_rest("cartesian", **{"0": 100.0, "2": -20.0})
    assert [tip.label for tip in made.tips] == [""]
    assert made.tips[0].points[-1] == [100.0, 0.0, -20.0]


def test_axes_that_move_have_gauges_or_all_where_none_does() -> None:
    assert [axis.name for _, axis in moving(at_rest("cartesian", **{"1": 5.0}))] == ["Y"]
    assert len(moving(at_rest("cartesian"))) == 12


def test_values_are_told_in_mm_and_degrees_by_the_joints_names() -> None:
    machine, kinematics, start = built_in("robot-dog")
    values = (math.degrees(start[axis.index]) for axis in machine.axes)
    shown = axes_html(zip(axes_of(machine, kinematics), values, strict=True))
    assert "Y front left thigh" in shown
    assert "81.09&nbsp;°" in shown


def test_an_endless_axis_has_a_dial_and_a_limited_one_its_travel() -> None:
    (endless,) = axes_of(parse_machine(ENDLESS), None)
    shown = axes_html([(endless, 90.0)])
    assert 'x2="0.0" y2="-8.0"' in shown
    assert "90.00&nbsp;°" in shown
    assert "left:75.00%" in axes_html([(ReplayAxis(0, "X", "mm", 0.0, 100.0), 75.0)])


def test_names_are_escaped() -> None:
    assert "<script>" not in axes_html([(ReplayAxis(0, "<script>", "mm"), 0.0)])


def vertices(part: dict[str, Any]) -> np.ndarray[Any, Any]:
    raw = b"".join(base64.b64decode(solid["vertices"]) for solid in part["solids"])
    return np.frombuffer(raw, "<f4").reshape(-1, 3)


def test_a_portal_s_quill_is_at_the_programmed_point() -> None:
    model = json.loads(portal_json((0, 1, 2), np.zeros(3), np.full(3, 0.5)))
    chain = [(part["parent"], part["name"], part["driver"], part.get("axis")) for part in model["parts"]]
    assert chain == [
        (None, "rails", None, None),
        ("rails", "bridge", 1, [0.0, 1.0, 0.0]),
        ("bridge", "carriage", 0, [1.0, 0.0, 0.0]),
        ("carriage", "quill", 2, [0.0, 0.0, 1.0]),
    ]
    # its lowest vertex is the tip, but for the roundness [mm]
    assert vertices(model["parts"][-1])[:, 2].min() == pytest.approx(0.0, abs=10.0)


def test_axes_that_a_portal_lacks_stay_at_zero() -> None:
    model = json.loads(portal_json((0,), np.zeros(3), np.ones(3)))
    assert [part["driver"] for part in model["parts"]] == [None, None, 0, None]


def test_a_portal_is_as_large_as_the_run_needs() -> None:
    content, missing = model_of(load_machine("cartesian"), at_rest("cartesian", **{"0": 100.0}), Up.AUTO)
    rails = vertices(json.loads(content)["parts"][0])
    assert 100.0 < np.ptp(rails[:, 0]) < 150.0
    assert missing == []


def test_a_machine_of_rotary_axes_alone_has_values_and_no_body() -> None:
    content, _ = model_of(parse_machine(ENDLESS), at_rest(ENDLESS), Up.AUTO)
    assert json.loads(content)["parts"] == []


def test_a_machine_of_several_tools_stands_on_them() -> None:
    content, missing = model_of(load_machine("robot-dog"), at_rest("robot-dog"), Up.AUTO)
    model = json.loads(content)
    assert model["up"] == [0.0, 1.0, 0.0]
    assert sorted(part["driver"] for part in model["parts"] if part["driver"] is not None) == [*range(12)]
    assert missing == []


def test_a_machine_of_one_tool_has_z_up_unless_configured_otherwise() -> None:
    point = [np.array([0.4, 0.0, 0.6])]
    np.testing.assert_array_equal(up_of(Up.AUTO, point, [np.zeros(3)]), (0.0, 0.0, 1.0))
    np.testing.assert_array_equal(up_of(Up.MINUS_X, point, [np.zeros(3)]), (-1.0, 0.0, 0.0))


def test_playing_stops_at_the_end_and_begins_anew_when_asked() -> None:
    playback = Playback(TIMES, speed=2.0)
    playback.advance(0.4)
    assert playback.now == pytest.approx(0.8)
    assert playback.row == 800
    playback.advance(5.0)
    assert (playback.now, playback.playing, playback.row) == (2.0, False, 2000)
    playback.toggle()
    assert (playback.now, playback.playing) == (0.0, True)


def test_a_pause_stands_still_and_a_seek_stays_within_the_run() -> None:
    playback = Playback(TIMES)
    playback.toggle()
    playback.advance(1.0)
    assert playback.now == 0.0
    playback.seek(7.0)
    assert playback.now == 2.0


def test_repeating_goes_on_from_the_start() -> None:
    playback = Playback(TIMES, repeat=True)
    playback.advance(3.0)
    assert (playback.now, playback.playing) == (2.0, True)
    playback.advance(0.1)
    assert (playback.now, playback.playing) == (0.0, True)


def test_zeros_of_work_coordinate_systems_stand_in_the_machine_s_coordinates() -> None:
    assert work_zeros({"G55": {"0": 120.0, "2": -5.0, "3": 90.0}}) == {
        "machine": [0.0, 0.0, 0.0],
        "G55": [120.0, 0.0, -5.0],
    }
    assert work_zeros({}) == {}


def test_bodies_hang_on_the_axes_that_carry_them_and_know_their_tools_and_inputs() -> None:
    quill = ModelBody("quill", "box", [10.0, 10.0, 20.0], [0.0, 0.0, 5.0], [0.0, 0.0, 90.0])
    quill = dataclasses.replace(quill, carried_by=[0, 2], directions=[0, 2], opposite=True, tool=2)
    door = ModelBody("door", "box", [1.0, 1.0, 1.0], [0.0] * 3, [0.0] * 3, zone="slow", input="curtain")
    parts = json.loads(model_json("", {}, {}, (), bodies=[quill, door]))["parts"]
    assert [(each["parent"], each["driver"]) for each in parts] == [
        ("", 0),
        ("quill on 0", 2),
        ("quill on 2", None),
        ("", None),
    ]
    assert [each["ratio"] for each in parts[:2]] == [-1.0, -1.0]
    assert (parts[2]["tool"], parts[3]["zone"], parts[3]["input"], parts[3]["high"]) == (
        2,
        "slow",
        "curtain",
        False,
    )
    # in mm, turned by a right angle about Z
    assert np.reshape(parts[2]["pose"], (4, 4))[:3, 3].tolist() == [0.0, 0.0, 5.0]
    assert np.reshape(parts[2]["pose"], (4, 4))[:2, 0] == pytest.approx([0.0, 1.0])
