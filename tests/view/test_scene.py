"""What is shown of a run: where the tips go, how the machine stands, what the panel says."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mcserver.machine.machine_file import load_machine, parse_machine
from mcserver.simulation.simulation import simulate
from mcserver.view.body_of import body_of
from mcserver.view.panel import axes_html, axis_names, line_html
from mcserver.view.playback import Playback
from mcserver.view.stage import stage, up_of
from mcserver.view.tracks import portal_axes, portal_points, tip_frames, tracks_of, work_zeros
from tests.kinematics.tool_machines import built_in

ENDLESS = """[machine]
name = "table"
[[axis]]
index = 3
type = "rotary"
max_velocity = 10.0
max_acceleration = 10.0
"""


def test_a_track_leads_from_where_the_tool_starts_to_where_the_line_ends() -> None:
    machine, kinematics, start = built_in("arm6")
    text = "G1010\nG93 F60\nG01 T1 X500 Z600\nG01 Y50\n"
    recording = simulate(text, machine, kinematics=kinematics, record=True).recording
    assert recording is not None
    (track,) = tracks_of(machine, kinematics, recording)
    assert track.label == "T1"
    np.testing.assert_allclose(track.points[0], kinematics.pose(1, start).position, atol=1e-9)
    np.testing.assert_allclose(track.points[-1], (0.5, 0.05, 0.6), atol=1e-4)
    np.testing.assert_allclose(track.of_line(4)[0], (0.5, 0.0, 0.6), atol=2e-3)
    assert len(track.of_line(99)) == len(track.of_line(0)) == 0


def test_only_tools_that_move_have_a_track() -> None:
    machine, kinematics, _ = built_in("robot-dog")
    text = "G1010\nG93 F60\nG01 T3 Z100\n"
    recording = simulate(text, machine, kinematics=kinematics, record=True).recording
    assert recording is not None
    assert [track.label for track in tracks_of(machine, kinematics, recording)] == ["T3"]


def test_the_track_of_a_machine_without_tools_is_that_of_its_linear_axes() -> None:
    machine = load_machine("cartesian")
    recording = simulate("G1010\nG94 F6000\nG01 X100 Z-20\n", machine, record=True).recording
    assert recording is not None
    (track,) = tracks_of(machine, None, recording)
    np.testing.assert_allclose(track.points[-1], (0.1, 0.0, -0.02), atol=1e-6)


def test_a_portal_s_quill_is_at_the_programmed_point() -> None:
    machine = load_machine("cartesian")
    body = body_of(machine, None, (), np.zeros(3))
    positions = {axis.index: 0.0 for axis in machine.axes} | {0: 0.1, 1: 0.2, 2: -0.05}
    np.testing.assert_allclose(body.poses(positions)["quill"][:3, 3], (0.1, 0.2, -0.05))
    quill = next(part for part in body.parts if part.name == "quill")
    # its lowest vertex is the tip, but for the roundness
    lowest = min(solid.vertices[:, 2].min() for solid in quill.solids)
    assert lowest == pytest.approx(0.0, abs=0.01)


def test_a_machine_of_rotary_axes_alone_has_values_and_no_body() -> None:
    machine = parse_machine(ENDLESS)
    assert portal_axes(machine) == ()
    assert body_of(machine, None, (), np.zeros(3)).parts == ()
    assert tip_frames(machine, None, {3: 0.0}) == {}


def test_axes_that_a_portal_lacks_stay_at_zero() -> None:
    machine = load_machine("cartesian")
    points = portal_points(machine, {axis: np.array([0.5]) for axis in range(12)})
    np.testing.assert_allclose(points, [[0.5, 0.5, 0.5]])


def test_a_machine_of_several_tools_stands_on_them() -> None:
    machine, kinematics, start = built_in("robot-dog")
    tips = [frame[:3, 3] for frame in tip_frames(machine, kinematics, start).values()]
    hips = [kinematics.tool(tool).chain.points[0] for tool in kinematics.tools]
    np.testing.assert_array_equal(up_of("auto", tips, hips), (0.0, 1.0, 0.0))


def test_a_machine_of_one_tool_has_z_up_unless_configured_otherwise() -> None:
    point = [np.array([0.4, 0.0, 0.6])]
    np.testing.assert_array_equal(up_of("auto", point, [np.zeros(3)]), (0.0, 0.0, 1.0))
    np.testing.assert_array_equal(up_of("-x", point, [np.zeros(3)]), (-1.0, 0.0, 0.0))


def test_the_stage_holds_the_feet_and_all_that_comes_later() -> None:
    machine, kinematics, start = built_in("robot-dog")
    body = body_of(machine, kinematics, (), np.zeros(3))
    far = np.array([[0.0, 0.0, 3.0]])
    found = stage(body.parts, body.poses(start), [far], np.array([0.0, 1.0, 0.0]))
    # the feet's balls of 22 mm are 400 mm below the hips
    assert found.floor == pytest.approx(-0.422, abs=2e-3)
    assert found.size > 3.0
    assert np.linalg.norm(found.camera - found.middle) > 0.5 * found.size


def test_playing_stops_at_the_end_and_begins_anew_when_asked() -> None:
    playback = Playback(np.linspace(0.0, 2.0, 2001), speed=2.0)
    playback.advance(0.4)
    assert playback.now == pytest.approx(0.8)
    assert playback.row == 800
    playback.advance(5.0)
    assert (playback.now, playback.playing, playback.row) == (2.0, False, 2000)
    playback.toggle()
    assert (playback.now, playback.playing) == (0.0, True)


def test_a_pause_stands_still_and_a_seek_stays_within_the_run() -> None:
    playback = Playback(np.linspace(0.0, 2.0, 2001))
    playback.toggle()
    playback.advance(1.0)
    assert playback.now == 0.0
    playback.seek(7.0)
    assert playback.now == 2.0


def test_repeating_goes_on_from_the_start() -> None:
    playback = Playback(np.linspace(0.0, 2.0, 2001), repeat=True)
    playback.advance(3.0)
    assert (playback.now, playback.playing) == (2.0, True)
    playback.advance(0.1)
    assert (playback.now, playback.playing) == (0.0, True)


def test_the_panel_escapes_what_the_program_says() -> None:
    assert "<script>" not in line_html(3, "G01 X1 (<script>)", "red")


def test_the_panel_tells_values_in_mm_and_degrees_by_the_joints_names() -> None:
    machine, kinematics, start = built_in("robot-dog")
    shown = axes_html(machine.axes, start, axis_names(machine, kinematics))
    assert "1 front left thigh" in shown
    assert "81.09&nbsp;°" in shown


def test_an_endless_axis_has_a_dial() -> None:
    machine = parse_machine(ENDLESS)
    shown = axes_html(machine.axes, {3: math.pi / 2.0}, axis_names(machine, None))
    assert 'x2="12.0" y2="4.0"' in shown
    assert "90.00&nbsp;°" in shown


def test_zeros_of_work_coordinate_systems_stand_in_the_machine_s_coordinates() -> None:
    offsets = [{"system": "G55", "origin": {"0": 120.0, "2": -5.0, "3": 90.0}}]
    zeros = work_zeros(load_machine("cartesian"), offsets)
    assert {name: at.tolist() for name, at in zeros.items()} == {
        "machine": [0.0, 0.0, 0.0],
        "G55": [0.12, 0.0, -0.005],
    }
    assert work_zeros(load_machine("cartesian"), []) == {}
    assert work_zeros(load_machine("robot-dog"), offsets) == {}
