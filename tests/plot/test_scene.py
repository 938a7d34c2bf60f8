"""What is chosen to be drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from mcserver.machine.machine_file import load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.plot.scene import PathTrace, Scene, build_scene
from mcserver.plot.strokes import runs_of
from mcserver.simulation.recorder import Recorded
from tests.plot.synthetic import machine, report, run, scene, smooth

STILL = np.zeros(400)


def peaks(scene: Scene) -> NDArray[np.float64]:
    """Greatest share of each limit that each axis uses, shape (axes, 3); 0 where there is no limit."""
    shares = np.zeros((len(scene.axes), 3))
    for row, trace in enumerate(scene.axes):
        for order, values in enumerate(trace.derivatives(scene.cycle_s)):
            if math.isfinite(trace.limits[order]):
                shares[row, order] = np.abs(values).max(initial=0.0) / trace.limits[order]
    return shares


def test_two_moving_linear_axes_give_a_path_in_their_plane() -> None:
    drawn = scene(smooth(400, 50.0), STILL, smooth(400, 20.0))
    assert [path.names for path in drawn.paths] == [("X", "Z")]


def test_three_moving_linear_axes_give_a_path_in_space() -> None:
    assert scene(*[smooth(400, 50.0)] * 3).paths[0].names == ("X", "Y", "Z")


@pytest.mark.parametrize("types", [("linear", "rotary"), ("rotary", "rotary")])
def test_fewer_than_two_linear_axes_give_no_path(types: tuple[str, ...]) -> None:
    assert scene(smooth(400, 50.0), smooth(400, 20.0), types=types).paths == ()


def test_an_axis_that_stands_still_is_not_drawn() -> None:
    assert [trace.name for trace in scene(STILL, smooth(400, 20.0)).axes] == ["Y"]


def test_derivatives_are_differences_of_whole_cycles() -> None:
    column = np.array([0.0, 0.0, 1.0, 3.0, 3.0])
    trace = scene(column, column).axes[0]
    velocity, acceleration, jerk = trace.derivatives(0.5)
    assert velocity.tolist() == [0.0, 0.0, 2.0, 4.0, 0.0]
    assert acceleration.tolist() == [0.0, 0.0, 4.0, 4.0, -8.0]
    assert jerk.tolist() == [0.0, 0.0, 8.0, 0.0, -24.0]


def test_limits_are_in_the_units_of_the_machine_file() -> None:
    assert scene(smooth(400, 50.0), STILL).axes[0].limits == pytest.approx((200.0, 1000.0, 50000.0))


def test_an_axis_without_a_jerk_limit_uses_no_share_of_it() -> None:
    described = machine("linear", "linear", jerk="")
    drawn = build_scene("p", described, run([smooth(400, 50.0)] * 2), report(400), [])
    assert peaks(drawn)[0, 2] == 0.0
    assert peaks(drawn)[0, 0] > 0.9


def test_the_speed_along_the_path_is_that_of_all_its_axes_together() -> None:
    ramp = np.arange(100) * 0.03
    path = scene(ramp, ramp / 3.0 * 4.0).paths[0]
    assert path.speed()[1:] == pytest.approx(50.0)


def test_source_lines_come_without_their_comments() -> None:
    assert scene(smooth(400, 50.0), STILL).timed_lines[0].source == "G01 X100"


def test_runs_are_the_stretches_of_one_line() -> None:
    assert runs_of(np.array([4, 4, 5, 4])) == [(4, 0, 2), (5, 2, 3), (4, 3, 4)]
    assert runs_of(np.array([], dtype=np.int64)) == []


def test_a_recording_without_a_row_gives_an_empty_scene() -> None:
    nothing = np.empty(0)
    drawn = build_scene("p", machine("linear", "linear"), run([nothing, nothing], nothing), report(0), [])
    assert drawn.axes == ()
    assert drawn.paths == ()


def test_a_reading_of_an_axis_without_energy_is_no_motion() -> None:
    described = machine("linear", "linear")
    recorded = run([smooth(400, 50.0), smooth(400, 50.0)])
    recorded.actual[-10:] = recorded.setpoint[-10:] = 49.0
    drawn = build_scene("p", described, recorded, report(400), [])
    assert peaks(drawn)[0, 0] < 2.0
    assert drawn.axes[0].derivatives(0.001)[0][-10:].tolist() == [0.0] * 10


def test_a_drive_that_lags_on_the_path_has_no_deviation() -> None:
    angle = np.linspace(0.0, np.pi, 2000)
    setpoint = np.stack([100.0 * np.cos(angle), 100.0 * np.sin(angle)], axis=1)
    lagging = np.concatenate([np.repeat(setpoint[:1], 30, axis=0), setpoint[:-30]])
    time_s = 0.001 * np.arange(2000)
    path = PathTrace("", ("X", "Y"), time_s, np.ones(2000, dtype=np.int64), setpoint, lagging)
    assert np.linalg.norm(setpoint - lagging, axis=1).max() > 4.0
    assert path.deviation().max() < 1e-9


def test_a_drive_beside_the_path_deviates_by_its_distance() -> None:
    along = np.linspace(0.0, 200.0, 2000)
    setpoint = np.stack([along, np.zeros(2000)], axis=1)
    path = PathTrace(
        "",
        ("X", "Y"),
        0.001 * np.arange(2000),
        np.ones(2000, dtype=np.int64),
        setpoint,
        setpoint + np.array([0.0, 0.3]),
    )
    assert path.deviation() == pytest.approx(0.3)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_a_path_of_hardly_any_points_has_a_deviation_for_each(count: int) -> None:
    points = np.zeros((count, 2))
    path = PathTrace("", ("X", "Y"), 0.001 * np.arange(count), np.ones(count, dtype=np.int64), points, points)
    assert path.deviation().tolist() == [0.0] * count


def test_axes_of_a_robot_have_the_names_of_its_joints() -> None:
    machine = load_machine("arm6")
    columns = np.zeros((100, 6))
    columns[:, 1] = smooth(100, 5.0)
    recorded = Recorded(0.001 * np.arange(100), np.ones(100), np.arange(6.0), columns, columns)
    drawn = build_scene("p", machine, recorded, report(100), [], build_kinematics(machine))
    assert [trace.name for trace in drawn.axes] == ["joint_2 (axis 1)"]
