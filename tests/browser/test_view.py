"""A program played by ``mcserver view`` in the browser."""

from __future__ import annotations

from playwright.sync_api import Page, expect

from tests.e2e.servers import ROOT, CommandProcess


def test_a_program_plays_to_its_end_and_is_wound_back(page: Page) -> None:
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    command = CommandProcess("view", str(ROOT / "examples" / "square.gcode"), "--port", "0")
    try:
        page.goto(command.url)
        expect(page.get_by_role("img", name="square.gcode on cartesian")).to_be_visible()
        # it began by itself, and stops at its end
        expect(page.get_by_role("button", name="Play", exact=True)).to_be_visible()
        for name in ("repeat", "joint frames"):
            page.get_by_role("checkbox", name=name).click()
        page.get_by_role("slider").click()
        expect(page.get_by_text("G01", exact=False)).to_be_visible()
        page.get_by_role("button", name="Play", exact=True).click()
        expect(page.get_by_role("button", name="Pause")).to_be_visible()
    finally:
        command.close()
    assert faults == []
