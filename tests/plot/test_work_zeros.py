"""A picture is in the machine's coordinates and shows where the work's are zero."""

from __future__ import annotations

from typing import Any

import pytest
from matplotlib.figure import Figure

from mcserver.plot.html import page_of
from mcserver.plot.path_panel import draw_path
from mcserver.plot.scene import Scene, build_scene
from mcserver.simulation.simulation import simulate
from tests.corpus.test_corpus import machine_of


def scene_of(text: str) -> tuple[Scene, dict[str, Any]]:
    machine = machine_of("cnc")
    done = simulate(text, machine, record=True)
    assert done.recording is not None
    return build_scene("part", machine, done.recording, done.report, text.split("\n")), done.report


def texts(scene: Scene) -> set[str]:
    figure = Figure()
    draw_path(figure, figure.add_gridspec(1, 1)[0], scene, dict.fromkeys(range(99), "#123456"))
    return {text.get_text().strip() for axes in figure.axes for text in axes.texts}


def test_each_system_that_was_set_has_its_zero_in_the_picture() -> None:
    scene, report = scene_of("G10 L2 P1 X60 Y40\nG10 L2 P2 X120\nG0 X0 Y0\nG1 X5 F600\nG55 G1 X0 Y9")
    assert [(zero.name, zero.at) for zero in scene.zeros] == [
        ("G54", pytest.approx((60.0, 40.0))),
        ("G55", pytest.approx((120.0, 0.0))),
    ]
    assert [each["system"] for each in report["work_offsets"]] == ["G54", "G55"]
    assert {"machine", "G54", "G55"} <= texts(scene)
    assert '"zeros":[{"name":"G54","at":[60.0,40.0]}' in page_of(scene)


def test_g92_moves_the_zero_of_the_system_in_force_and_a_tool_s_length_does_not() -> None:
    scene, _ = scene_of("G0 X30 Y10\nG92 X0\nG1 X5 Y20 F900")
    assert [(zero.name, zero.at) for zero in scene.zeros] == [("G54", pytest.approx((30.0, 0.0)))]
    scene, _ = scene_of("T1 M6\nG43 H1\nG0 X5 Y5 Z5")
    assert scene.zeros == ()


def test_views_from_the_side_and_in_space_show_zeros_too() -> None:
    for z in ("", " Z-7"):
        scene, _ = scene_of(f"G10 L2 P1 X6 Z20\nG0 X0 Y0 Z0\nG1 X5 Y8 F600\nX9 Y1{z}\nG1 Z0")
        assert {"machine", "G54"} <= texts(scene)


def test_without_offsets_there_is_no_zero_to_show() -> None:
    scene, report = scene_of("G0 X5 Y5\nG1 X0 F600")
    assert scene.zeros == ()
    assert "work_offsets" not in report
    assert "machine" not in texts(scene)
