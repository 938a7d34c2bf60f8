"""A program played by ``mcserver view`` in the browser."""

from __future__ import annotations

from pathlib import Path

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


def test_the_path_of_a_tool_goes_along_with_the_table_that_carries_its_work(
    page: Page, tmp_path: Path
) -> None:
    program = tmp_path / "tilted.gcode"
    program.write_text("T1 M6\nG10 L2 P1 Z-500\nG43.4 H1\nG1 X40 Y5 Z60 A-20 C40 F6000\n")
    machine = str(ROOT / "examples" / "trunnion-mill.toml")
    command = CommandProcess("view", str(program), "--machine", machine, "--port", "0")
    try:
        page.goto(command.url)
        expect(page.get_by_text("G1 X40", exact=False)).to_be_visible()
        # the tip, which is given on the table, stays at the nose of the spindle, which is drawn by the axes
        page.wait_for_function(
            """() => {
                const space = document.querySelector(".mc-space").closest("[id^=c]").id.slice(1);
                const { world, tips, links } = getElement(Number(space));
                world.updateMatrixWorld(true);
                const at = (part) => part.matrixWorld.elements.slice(12, 15);
                const [tip, nose, table] = [tips.get("T1"), links.get("spindle"), links.get("table")].map(at);
                return tip.every((value, axis) => Math.abs(value - nose[axis]) < 0.05)
                    && table.some((value) => Math.abs(value) > 10);
            }"""
        )
    finally:
        command.close()
