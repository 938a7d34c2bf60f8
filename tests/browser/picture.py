"""Draws the pictures of pages in docs: ``python -m tests.browser.picture FOLDER``."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from mcclient import sync
from playwright.sync_api import Browser, sync_playwright

from tests.browser.conftest import CHROMIUM, FLAGS, LIMIT_MS, PageProcess
from tests.e2e.servers import ROOT, CommandProcess, ServerProcess
from tests.e2e_can.cell import running
from tests.e2e_can.machines import Raw, buses, slides


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
            draw_desk(browser, folder / "web-drives.png")
            draw_view(browser, folder / "view.png")
        finally:
            browser.close()
            server.close()


def draw_desk(browser: Browser, output: Path) -> None:
    """The commissioning desk of two drives, with a move in its scope."""

    def build(addresses: Sequence[str]) -> Raw:
        raw = slides(addresses, 250.0, 2)
        raw["machine"]["name"] = "cell-1"
        # a busy computer stops a process for seconds
        raw["bus"] = buses(addresses, silence_cycles=1000)
        for axis in raw["axis"]:
            axis["drive"]["eds"] = str(ROOT / "mcserver" / "drive_sim" / "cia402.eds")
            axis["drive"] |= {"heartbeat_ms": 10_000, "command_timeout_ms": 60_000, "sdo_timeout_ms": 3000}
        return raw

    with (
        tempfile.TemporaryDirectory() as temporary,
        running(Path(temporary), build, channels=1, processes=[(1, 2)]) as cell,
        sync.Machine.connect("cell-1", cell.server.endpoint) as machine,
    ):
        site = PageProcess(cell.server.endpoint, Path(temporary) / "programs")
        try:
            page = browser.new_page(viewport={"width": 1600, "height": 1060})
            page.set_default_timeout(LIMIT_MS)
            page.goto(f"{site.url}machine/cell-1/drives")
            page.get_by_label("Search: words").fill("torque")
            page.get_by_role("button", name="6072h:00 Max torque").click()
            page.get_by_role("button", name="Read what is shown").click()
            page.get_by_role("button", name="Listen for 5 s").click()
            page.get_by_text("error frames").wait_for()
            for field, option in (("Trigger", "rises above"), ("Of", "velocity")):
                page.get_by_label(field, exact=True).click()
                page.get_by_role("option", name=option, exact=True).click()
            page.get_by_label("Level", exact=True).fill("10")
            page.get_by_role("button", name="Start").click()
            page.get_by_text("waits for the trigger").wait_for()
            with machine.program("to and fro") as program:
                for line in ("G1010", "G01 X40 F6000", "G01 X0"):
                    program.send(line)
                page.get_by_text("500 cycles").wait_for()
            page.wait_for_timeout(1000)
            page.screenshot(path=output)
        finally:
            site.close()


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
