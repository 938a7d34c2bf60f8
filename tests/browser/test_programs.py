"""Programs that are kept: what an upload has replaced comes back, and how each one ran last is said."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import pytest
from mcclient import sync

from tests.browser.conftest import PageProcess, opened, playwright
from tests.browser.test_machine_page import upload

if TYPE_CHECKING:
    from playwright.sync_api import Page
else:
    Page = Any

expect = playwright.expect


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
    page.get_by_role("button", name="Bring the one before back").press("Enter")
    expect(page.get_by_text("kept.gcode: no faults")).to_be_visible()
    expect(replaced).to_be_hidden()


def test_a_chosen_program_says_how_it_ran_last(page: Page, site: PageProcess, machine: sync.Machine) -> None:
    opened(page, site)
    upload(page, "short.gcode", "G1010\nG04 P0.1\n")
    page.get_by_role("button", name="Run", exact=True).first.click()
    expect(page.get_by_text(re.compile(r"^last run .* by local: finished after 0:\d\d$"))).to_be_visible()
    assert not machine.programs(ended=False)
