"""Paths in parallel planes are seen square."""

from __future__ import annotations

import io

import numpy as np
import pytest

from mcserver.plot.scene import Array, PathTrace, Scene

pytest.importorskip("matplotlib")

from mcserver.plot.figure import compose, draw_png
from mcserver.plot.side_views import MAX_VIEWS, side_views

TURN = np.linspace(0.0, 2.0 * np.pi, 200)
ROUND, UP = np.cos(TURN), np.sin(TURN)


def path(label: str, *columns: Array | float) -> PathTrace:
    points = np.stack(np.broadcast_arrays(*columns, TURN)[:3], axis=1)
    return PathTrace(label, ("X", "Y", "Z"), TURN, np.ones(len(TURN), dtype=np.int64), points, points)


def test_feet_in_two_planes_give_two_views_with_their_length_across() -> None:
    views = side_views(
        [path("T3", -159.0, 100.0 * UP, 400.0 * ROUND), path("T6", 159.0, 100.0 * UP, 400.0 * ROUND)]
    )
    assert [(view.at, view.depth, view.across, view.up) for view in views] == [
        (-159.0, 0, 2, 1),
        (159.0, 0, 2, 1),
    ]
    assert [[shown.label for shown in view.paths] for view in views] == [["T3"], ["T6"]]


def test_paths_in_one_plane_share_its_view() -> None:
    (view,) = side_views([path("T1", 40.0 * ROUND, 7.0, 90.0 * UP), path("T2", 40.0 * ROUND, 7.0, 9.0 * UP)])
    assert (view.depth, view.across, view.up) == (1, 0, 2)
    assert len(view.paths) == 2


def test_a_path_that_leaves_its_plane_is_drawn_in_space() -> None:
    assert side_views([path("T1", 40.0 * ROUND, 40.0 * UP, 10.0 * ROUND)]) == ()


def test_more_planes_than_fit_are_drawn_in_space() -> None:
    paths = [path("", 50.0 * number, 40.0 * UP, 40.0 * ROUND) for number in range(MAX_VIEWS + 1)]
    assert side_views(paths) == ()


def test_the_views_are_drawn_one_above_the_other() -> None:
    feet = (path("T3", -159.0, 100.0 * UP, 400.0 * ROUND), path("T6", 159.0, 100.0 * UP, 400.0 * ROUND))
    scene = Scene("walk", 0.001, 1.0, 1.0, TURN, np.ones(len(TURN), dtype=np.int64), (), feet, ())
    titles = [axes.get_title(loc="left") for axes in compose(scene).axes]
    assert titles[0].startswith("Path of T3 at X -159 mm")
    assert titles[1] == "Path of T6 at X 159 mm"
    stream = io.BytesIO()
    draw_png(scene, stream)
    assert stream.getvalue().startswith(b"\x89PNG")
