"""Draws the pictures of docs/web.md and docs/view.md: ``python -m tests.browser.picture FOLDER``."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from tests.browser.conftest import CHROMIUM, FLAGS, LIMIT_MS, PageProcess
from tests.e2e.servers import ROOT, CommandProcess, ServerProcess


def draw(folder: Path) -> None:
    """A dry run before the arcs run; while they do the page wide, in the dark, and narrow as on a phone."""
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as driver:
        server = ServerProcess(Path(temporary), "cartesian", "cell-1", recorder=True)
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        try:
            server.start()
            site = PageProcess(server.endpoint, Path(temporary) / "programs")
            try:
                page = browser.new_page(viewport={"width": 1600, "height": 1000})
                page.set_default_timeout(LIMIT_MS)
                page.goto(f"{site.url}machine/cell-1")
                page.locator("input[type=file]").set_input_files(ROOT / "examples" / "arcs.gcode")
                page.get_by_text("arcs.gcode: no faults").wait_for()
                page.get_by_role("button", name="Dry run").click()
                page.get_by_role("button", name="Run it").wait_for()
                page.wait_for_timeout(2000)
                page.screenshot(path=folder / "web-dry-run.png")
                page.get_by_role("button", name="Run it").click()
                page.get_by_text("line 13 of").wait_for()
                page.screenshot(path=folder / "web-machine.png")
                page.emulate_media(color_scheme="dark")
                page.wait_for_timeout(1000)
                page.screenshot(path=folder / "web-dark.png")
                page.emulate_media(color_scheme="light")
                page.set_viewport_size({"width": 390, "height": 844})
                page.wait_for_timeout(1000)
                page.screenshot(path=folder / "web-phone.png")
            finally:
                site.close()
            draw_view(browser, folder / "view.png")
        finally:
            browser.close()
            server.close()


def draw_view(browser: Browser, output: Path) -> None:
    """The robot dog in mid-stride, played."""
    command = CommandProcess("view", "examples/robot-dog.gcode", "--machine", "robot-dog", "--port", "0")
    try:
        page = browser.new_page(viewport={"width": 1280, "height": 920})
        page.set_default_timeout(LIMIT_MS)
        page.goto(command.url)
        page.get_by_text("line 5").wait_for()
        page.get_by_role("button", name="Pause").click()
        page.wait_for_timeout(1000)
        page.screenshot(path=output)
    finally:
        command.close()


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
