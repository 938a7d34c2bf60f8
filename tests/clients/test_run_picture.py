"""The picture that an operator sees before arming: numbers of the simulation, no word of the program."""

from __future__ import annotations

from typing import Any
from xml.etree import ElementTree

from hypothesis import given
from hypothesis import strategies as st
from mcclient.run_picture import MAX_CHARTS, run_picture

SVG = "{http://www.w3.org/2000/svg}"
NUMBERS = st.floats(-1e6, 1e6)


def preview(positions: list[list[float]], tools: list[dict[str, Any]] | None = None) -> dict[str, Any]:
    moments = len(positions[0]) if positions else 0
    extents = [
        {"axis": axis, "low": min(values), "high": max(values), "unit": "mm"}
        for axis, values in enumerate(positions)
        if values
    ]
    run = {"axes": list(range(len(positions))), "extents": extents, "duration_s": 2.0}
    times = [0.001 * at for at in range(moments)]
    return {"run": run, "path": {"time_s": times, "positions": positions, "tools": tools or []}}


def lines(picture: str) -> list[list[tuple[float, ...]]]:
    found = ElementTree.fromstring(picture).iter(f"{SVG}polyline")
    return [
        [tuple(map(float, point.split(","))) for point in each.attrib["points"].split()] for each in found
    ]


def test_a_path_in_the_plane_has_one_view_at_one_scale() -> None:
    view, x, y = lines(run_picture(preview([[0.0, 100.0, 100.0], [0.0, 0.0, 50.0]])))
    (x0, y0), (x1, y1), (x2, y2) = view
    assert y0 == y1
    assert x1 == x2
    # X to the right, Y upwards, one scale
    assert abs((x1 - x0) - 2.0 * (y1 - y2)) < 0.2
    assert len(x) == len(y) == 3


def test_a_helix_is_seen_from_above_and_from_the_front() -> None:
    picture = run_picture(preview([[0.0, 10.0, 0.0], [0.0, 5.0, 10.0], [0.0, 1.0, 2.0]]))
    assert len(lines(picture)) == 2 + 3
    assert "Z 0.000 … 2.000 mm (up)" in picture


def test_tools_are_drawn_in_place_of_their_axes() -> None:
    foot = {"tool": 3, "position": [[0.0, 1.0], [0.0, 0.0], [0.0, 5.0]]}
    other = {"tool": 6, "position": [[0.0, 2.0], [0.0, 0.0], [0.0, 5.0]]}
    drawn = lines(run_picture(preview([[0.0, 1.0]], [foot, other])))
    assert len(drawn) == 2 + 1


def test_axes_that_stand_have_no_chart_and_many_are_counted() -> None:
    assert "nothing moves" in run_picture(preview([[1.0, 1.0], [2.0, 2.0]]))
    picture = run_picture(preview([[0.0, 1.0 + axis] for axis in range(64)]))
    assert f"{64 - MAX_CHARTS} further axes move" in picture


def test_a_run_without_a_path_still_has_its_duration() -> None:
    assert "2.000 s" in run_picture(preview([]))
    drawn = preview([[0.0, 5.0]])
    drawn["path"] = {"time_s": [], "positions": [[]], "tools": []}
    assert lines(run_picture(drawn)) == []


@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=6))
def test_any_path_gives_a_picture_that_is_well_formed(moments: list[tuple[float, float, float]]) -> None:
    ElementTree.fromstring(run_picture(preview([list(axis) for axis in zip(*moments, strict=True)])))
