"""The page of ``mcserver plot`` in Chromium."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from mcserver.plot.html import page_of
from tests.browser.conftest import playwright
from tests.plot.synthetic import scene, smooth

Page = playwright.Page


@pytest.fixture
def plot(page: Page, tmp_path: Path) -> Page:
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    file = tmp_path / "part.html"
    file.write_text(page_of(scene(smooth(400, 50.0), smooth(400, 20.0))), "utf-8")
    page.goto(file.as_uri())
    page.wait_for_function("charts.length > 2")
    assert errors == []
    return page


def shown(plot: Page, tmp_path: Path) -> list[list[str]]:
    with plot.expect_download() as download:
        plot.get_by_role("button", name="save shown data").click()
    target = tmp_path / "shown.csv"
    download.value.save_as(target)
    return list(csv.reader(target.read_text("utf-8").splitlines()))


def test_several_quantities_are_shown_at_once_and_saved(plot: Page, tmp_path: Path) -> None:
    plot.get_by_label("following error").check()
    assert plot.locator("#axes canvas").count() == 4
    header, *rows = shown(plot, tmp_path)
    assert header[2:] == [
        "X velocity [mm/s]",
        "X following error [mm]",
        "Y velocity [mm/s]",
        "Y following error [mm]",
    ]
    assert len(rows) == 400
    assert float(rows[200][3]) == pytest.approx(0.01)


def test_a_click_on_a_line_shows_that_line_alone(plot: Page, tmp_path: Path) -> None:
    plot.locator("#lines tbody tr").nth(1).click()
    times = [float(row[0]) for row in shown(plot, tmp_path)[1:]]
    assert times[0] == pytest.approx(0.18, abs=0.003)
    assert times[-1] == pytest.approx(0.399, abs=0.003)


def test_one_cursor_goes_through_all_charts(plot: Page) -> None:
    plot.locator("#axes canvas").first.hover(position={"x": 500, "y": 60})
    first = plot.evaluate("cursor")
    assert 0.0 < first < 0.4
    assert plot.locator("tr.now").count() == 1
    plot.locator("#speed").hover(position={"x": 500, "y": 60})
    assert plot.evaluate("cursor") == pytest.approx(first, abs=0.01)


def test_charts_are_scaled_to_the_motion_and_to_limits_on_demand(plot: Page) -> None:
    pixels = "(() => { const c = document.querySelector('#axes canvas'); return c.toDataURL(); })()"
    to_motion = plot.evaluate(pixels)
    plot.get_by_label("scale to limits").check()
    plot.wait_for_function(f"(before) => {pixels} !== before", arg=to_motion)
