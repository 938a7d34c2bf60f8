"""Pictures: every kind of run can be drawn, and each panel is there."""

from __future__ import annotations

import io

import numpy as np
import pytest

from mcserver.plot.figure import MAX_AXIS_ROWS, compose, draw_png
from mcserver.plot.scene import Scene, build_scene
from tests.plot.synthetic import machine, report, run, scene, smooth

pytest.importorskip("matplotlib")

STILL = np.zeros(300)
MOVING = smooth(300, 40.0)
KINDS = {
    "plane": scene(MOVING, smooth(300, 10.0)),
    "space": scene(MOVING, smooth(300, 10.0), np.sin(np.arange(300) / 50.0)),
    "rotary": scene(MOVING, MOVING, types=("rotary", "rotary")),
    "still": scene(STILL, STILL),
    "empty": build_scene("p", machine("linear"), run([np.empty(0)], np.empty(0)), report(0), []),
    "straight in space": scene(MOVING, MOVING, MOVING),
}


@pytest.mark.parametrize("drawn", KINDS.values(), ids=KINDS.keys())
def test_every_kind_of_run_gives_a_png(drawn: Scene) -> None:
    stream = io.BytesIO()
    # a row for each axis takes most of the time, and is the same in space as in a plane
    draw_png(drawn, stream, axes=len(drawn.axes) < 3)
    assert stream.getvalue().startswith(b"\x89PNG\r\n\x1a\n")


def test_the_panels_are_path_times_speed_errors_and_three_for_each_axis() -> None:
    titles = [axes.get_title(loc="left") for axes in compose(KINDS["plane"]).axes]
    assert titles[0].startswith("Path")
    assert titles[1].startswith("Time of each line")
    assert titles[2].startswith("Speed")
    assert titles[3:5] == ["Following error [mm]", "Path deviation [mm]"]
    assert titles[5:] == [f"{name} {what}" for name in "XY" for what in ("velocity", "acceleration", "jerk")]


def test_each_limit_is_drawn_on_both_sides_and_its_share_said() -> None:
    figure = compose(KINDS["plane"], limits=True)
    panel = next(axes for axes in figure.axes if axes.get_title(loc="left") == "X velocity")
    levels = sorted(float(line.get_ydata()[0]) for line in panel.lines if line.get_linestyle() == "--")
    assert levels == pytest.approx([-200.0, 200.0])
    assert "%" in panel.get_title(loc="right")


def test_more_axes_than_fit_are_said_to_be_left_out() -> None:
    figure = compose(scene(*[MOVING] * (MAX_AXIS_ROWS + 1)))
    assert any(f"first {MAX_AXIS_ROWS} of {MAX_AXIS_ROWS + 1}" in text.get_text() for text in figure.texts)


def test_without_being_asked_for_a_far_limit_flattens_no_curve() -> None:
    slow = scene(smooth(3000, 4.0), smooth(3000, 4.0))  # 2.5 of 200 mm/s
    panel = next(axes for axes in compose(slow).axes if axes.get_title(loc="left") == "X velocity")
    assert panel.get_ylim()[1] < 5.0
    assert "of 200" in panel.get_title(loc="right")


def test_axes_can_be_left_out() -> None:
    titles = [axes.get_title(loc="left") for axes in compose(KINDS["plane"], axes=False).axes]
    assert titles[-1] == "Path deviation [mm]"
