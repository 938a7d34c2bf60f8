"""The same tasks by mouse, finger and keyboard at the widths of a phone, a tablet and a desk.

A sample of what ``python -m tests.browser.twenty_tasks --ways mouse touch keyboard --widths 360 768 1920``
does.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from mcclient import sync

from tests.browser.conftest import Browser, PageProcess, expect, expect_no_overflow, opened
from tests.browser.operator import Operator, Way, seat
from tests.browser.test_machine_page import stands, upload, wait_for

# what no other test of this folder does
SAMPLE = [(Way.TOUCH, 360), (Way.KEYBOARD, 360), (Way.TOUCH, 768), (Way.KEYBOARD, 1920)]


@pytest.fixture(params=SAMPLE, ids=lambda each: f"{each[0].value}-{each[1]}")
def hand(request: pytest.FixtureRequest, browser: Browser) -> Iterator[Operator]:
    """Somebody before a window or a device of their own."""
    way, width = request.param
    page = seat(browser, way, width, 800)
    yield Operator(page, way)
    page.context.close()


def test_an_axis_is_stepped_a_line_and_a_program_are_run_and_the_machine_is_stopped_and_reset(
    hand: Operator, site: PageProcess, machine: sync.Machine
) -> None:
    page = opened(hand.page, site)
    button, width = page.get_by_role("button", name="Run", exact=True), page.viewport_size
    assert width is not None
    expect_no_overflow(page, width["width"])
    before = machine.status().axes.position[2]
    hand.click(page.get_by_label("Distance"))
    hand.click(page.get_by_role("option", name="step 1", exact=True))
    hand.click(page.get_by_role("button", name="jog axis Z plus"))
    wait_for(machine, page, lambda status: abs(status.axes.position[2] - before - 1.0) < 0.02)
    hand.fill(page.get_by_label("G-code line"), "G1010")
    hand.click(button.last)
    expect(page.get_by_text(re.compile("G1010 +done"))).to_be_visible()
    upload(page, "ways.gcode", "G1010\nG90\nG01 X0 F6000\nG01 X200 F60\n")
    hand.click(page.get_by_role("button", name="Dry run"))
    hand.click(page.get_by_role("dialog").get_by_role("button", name="Run it"))
    expect(page.get_by_role("status")).to_have_text("running")
    hand.click(page.get_by_role("button", name="50 %", exact=True))
    expect(page.get_by_text("Override 50 %", exact=True)).to_be_visible()
    hand.click(page.locator("[data-estop]"))
    wait_for(machine, page, lambda status: status.state == "estop" and stands(status))
    hand.click(page.get_by_role("button", name="Reset"))
    expect(page.get_by_role("status")).to_have_text("ready")
