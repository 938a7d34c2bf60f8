"""Programs that are kept: what an upload has replaced comes back, and how each one ran last is said."""

from __future__ import annotations

import io
import re

import matplotlib.pyplot as plt
import numpy as np
import pytest
from mcclient import sync

from tests.browser.conftest import Locator, Page, PageProcess, expect, opened, press
from tests.browser.test_machine_page import upload
from tests.web.test_thumbnails import block, png


@pytest.mark.usefixtures("machine")
def test_an_upload_that_replaces_another_text_says_so_and_is_taken_back(
    page: Page, site: PageProcess
) -> None:
    opened(page, site)
    replaced = page.get_by_text("kept.gcode was kept already with another text, which is replaced.")
    upload(page, "kept.gcode", "G1010\nG01 X10 F600\n")
    upload(page, "kept.gcode", "G1010\nG01 X10 F600\n")
    expect(replaced).to_be_hidden()
    upload(page, "kept.gcode", "G1010\nG02 X100 Y0 R1\n")
    expect(replaced).to_be_visible()
    expect(page.get_by_text(re.compile(r"line 2, column \d+: .*\[MC104\]"))).to_be_visible()
    press(page.get_by_role("button", name="Bring the one before back"))
    expect(page.get_by_text("kept.gcode: no faults")).to_be_visible()
    expect(replaced).to_be_hidden()


def test_a_chosen_program_says_how_it_ran_last(page: Page, site: PageProcess, machine: sync.Machine) -> None:
    opened(page, site)
    upload(page, "short.gcode", "G1010\nG04 P0.1\n")
    page.get_by_role("button", name="Run", exact=True).first.click()
    expect(page.get_by_text(re.compile(r"^last run .* by local: finished after 0:\d\d$"))).to_be_visible()
    assert not machine.programs(ended=False)


@pytest.mark.usefixtures("machine")
def test_a_program_of_a_slicer_has_its_picture_in_the_list_and_on_the_card_of_what_runs(
    page: Page, site: PageProcess
) -> None:
    opened(page, site)
    upload(page, "sliced.gcode", block(png(120, 80), "120x80") + "G1010\nG04 P0.1\n")
    upload(page, "plain.gcode", "G1010\n")
    pictures = page.locator("img.mc-thumbnail:visible")
    expect(pictures).to_have_count(0)
    page.get_by_label("Program", exact=True).click()
    shown = page.get_by_role("option", name="sliced.gcode", exact=True)
    page.wait_for_function(
        "[...document.querySelectorAll('img.mc-icon')].some((each) => each.naturalWidth === 120)"
    )
    shown.click()
    expect(pictures).to_have_count(1)
    page.get_by_role("button", name="Run", exact=True).first.click()
    expect(pictures).to_have_count(2)
    page.wait_for_function(
        "[...document.querySelectorAll('img.mc-thumbnail')].every((each) => each.naturalWidth === 120)"
    )


@pytest.mark.usefixtures("machine")
def test_programs_lie_in_folders_and_those_of_one_are_offered(page: Page, site: PageProcess) -> None:
    opened(page, site)
    upload(page, "outside.gcode", "G1010\n")
    folder, program = page.get_by_label("Folder"), page.get_by_label("Program", exact=True)
    folder.fill("../..")
    folder.press("Enter")
    expect(page.get_by_text(re.compile("^'../..' cannot be a folder's name"))).to_be_visible()
    expect(folder).to_have_value("")
    folder.fill("/jobs/vise")
    folder.press("Enter")
    expect(folder).to_have_value("jobs/vise")
    file = {"name": "inside.gcode", "mimeType": "text/plain", "buffer": b"G1010\nG04 P0.1\n"}
    page.locator("input[type=file]").set_input_files(file)
    expect(program).to_have_value("jobs/vise/inside.gcode")
    program.click()
    expect(page.get_by_role("option", name="jobs/vise/inside.gcode")).to_be_visible()
    expect(page.get_by_role("option", name="outside.gcode")).to_have_count(0)
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Run", exact=True).first.click()
    expect(page.get_by_text(re.compile("^jobs/vise/inside.gcode is finished after"))).to_be_visible()
    # all of them again
    page.locator(".q-field", has=folder).locator(".q-field__focusable-action").click()
    expect(folder).to_have_value("")
    program.click()
    page.get_by_role("option", name="outside.gcode").click()
    expect(program).to_have_value("outside.gcode")


def marked_pixels(
    picture: Locator, before: frozenset[tuple[int, int]] = frozenset()
) -> frozenset[tuple[int, int]]:
    """Return where a line is marked in the picture, once that is not where it was before."""
    for _ in range(100):
        shot = plt.imread(io.BytesIO(picture.screenshot()))[:, :, :3]
        near = np.abs(shot - np.array([0xF9, 0x73, 0x16]) / 255.0).max(axis=2) < 0.05
        found = frozenset((int(row), int(column)) for row, column in np.argwhere(near))
        if len(found) > 50 and found != before:
            return found
    raise AssertionError("no line is marked")


# the line of the newest click that has hit the path, which goes to the page's process at once
NOTE_PICKED = """() => {
  const { socket } = window, emit = socket.emit;
  socket.emit = (kind, content, ...rest) => {
    if (kind === "event") window.picked = content.args[0];
    return emit(kind, content, ...rest);
  };
}"""
SQUARE = "G1010\nG01 X200 F6000\nG01 Y200\nG01 X0\nG01 Y0\n"


@pytest.mark.usefixtures("machine")
def test_a_line_of_a_dry_run_is_marked_in_its_path_and_a_click_on_the_path_chooses_its_line(
    page: Page, site: PageProcess
) -> None:
    opened(page, site)
    upload(page, "square.gcode", SQUARE)
    page.get_by_role("button", name="Dry run").click()
    dialog = page.get_by_role("dialog", name="Dry run of square.gcode")
    picture, chosen = dialog.get_by_role("img"), dialog.locator(".mc-linked .now")
    expect(chosen).to_have_text(re.compile(r"^ *1  G1010"))
    # Chromium draws the picture when it has been laid out
    page.wait_for_function("document.querySelector('.mc-dry-run canvas').width > 300")

    dialog.locator(".mc-linked [data-line='3']").click()
    expect(chosen).to_have_text(re.compile(r"^ *3  G01 Y200"))
    expect(dialog.get_by_label("Line")).to_have_value("3")
    third = marked_pixels(picture)
    # what has changed while the browser had taken the picture's context away is drawn when it is back
    page.evaluate(
        "window.taken = document.querySelector('.mc-dry-run canvas').getContext('webgl2')"
        ".getExtension('WEBGL_lose_context'); window.taken.loseContext()"
    )
    dialog.get_by_label("Line").fill("4")
    expect(chosen).to_have_text(re.compile(r"^ *4  G01 X0"))
    page.evaluate("window.taken.restoreContext()")
    fourth = marked_pixels(picture, third)
    # two sides of a square
    assert len(third & fourth) < 25

    box = picture.bounding_box()
    assert box is not None
    # the picture is a square looked at from before and above: its middle column crosses two of its sides
    page.evaluate(NOTE_PICKED)
    for row in range(8, int(box["height"]) - 8, 12):
        picture.click(position={"x": box["width"] / 2, "y": row})
        picked = page.evaluate("window.picked")
        if picked not in (None, "4"):
            break
    expect(chosen).to_have_text(re.compile(rf"^ *{picked}  "))
