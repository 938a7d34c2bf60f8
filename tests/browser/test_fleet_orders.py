"""Orders of the fleet's page to a real machine: a text run, the emergency stop by its key, the reset."""

from __future__ import annotations

import re

import pytest
from mcclient import sync

from tests.browser.conftest import Page, PageProcess, expect, opened, press
from tests.browser.test_machine_page import stands, wait_for
from tests.web.test_thumbnails import block, png


@pytest.fixture
def fleet_page(page: Page, site: PageProcess) -> Page:
    """The fleet's page with its one machine ticked."""
    page.goto(site.url)
    expect(page.get_by_role("status")).to_contain_text("1 of 1 online")
    page.locator(".ag-pinned-left-cols-container input[type=checkbox]").check()
    return page


def run_on_selected(page: Page, text: str) -> None:
    page.get_by_role("button", name="Run on selected").click()
    dialog = page.get_by_role("dialog", name="Run on several machines")
    expect(dialog).to_contain_text("Run on 1 machines: bench")
    dialog.get_by_label("G-code").fill(text)
    dialog.get_by_role("button", name="Run", exact=True).click()


def test_a_text_is_run_on_the_selected_stopped_by_the_key_and_the_machine_is_reset(
    fleet_page: Page, machine: sync.Machine
) -> None:
    run_on_selected(fleet_page, "G1010\nG91\nG01 X200 F60\n")
    expect(fleet_page.get_by_text("1 of 1 machines: queued")).to_be_visible()
    wait_for(machine, fleet_page, lambda status: any(each.state == "running" for each in status.programs))
    fleet_page.keyboard.press("Shift+Escape")
    expect(fleet_page.get_by_text("1 of 1 machines: emergency stop confirmed")).to_be_visible()
    wait_for(machine, fleet_page, lambda status: status.state == "estop" and stands(status))
    press(fleet_page.get_by_role("button", name="Reset selected"))
    press(fleet_page.get_by_role("button", name="Reset", exact=True))
    expect(fleet_page.get_by_text("1 of 1 machines: reset")).to_be_visible()
    wait_for(machine, fleet_page, lambda status: status.state == "ready")


@pytest.mark.usefixtures("machine")
def test_a_text_that_is_faulty_stands_in_the_row_until_another_program_has_run(fleet_page: Page) -> None:
    faults = fleet_page.locator(".ag-center-cols-container [role=row] [col-id=faults]")
    run_on_selected(fleet_page, "G02 X100 Y0 R30\n")
    expect(faults).to_contain_text("text of the fleet's page: line 1: ")
    run_on_selected(fleet_page, "G04 P0\n")
    expect(faults).to_have_text("")


def test_the_selected_are_stopped_without_a_question_and_without_an_answer_of_the_browser(
    fleet_page: Page, machine: sync.Machine
) -> None:
    # one that is busy, or whose link is held up, answers nothing in time
    fleet_page.evaluate("""() => {
      const emit = window.socket.emit.bind(window.socket);
      window.socket.emit = (kind, ...rest) => kind === "javascript_response" ? null : emit(kind, ...rest);
    }""")
    fleet_page.get_by_role("button", name="Emergency stop of the selected").click()
    wait_for(machine, fleet_page, lambda status: status.state == "estop")


def test_a_machine_that_somebody_drives_is_stopped_by_all_and_moved_by_none(
    fleet_page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    at_the_machine = opened(fleet_page.context.new_page(), site)
    at_the_machine.get_by_role("button", name="Take control").click()
    expect(at_the_machine.get_by_text("You have control", exact=True)).to_be_visible()
    fleet_page.bring_to_front()
    run_on_selected(fleet_page, "G1010\nG91\nG01 X10 F600\n")
    expect(fleet_page.get_by_text(re.compile(r"^bench: .*has control.*"))).to_be_visible()
    assert not machine.programs(ended=False)
    fleet_page.locator("[data-estop]").click()
    wait_for(machine, fleet_page, lambda status: status.state == "estop")
    # who has closed a page has control for a while yet
    at_the_machine.get_by_role("button", name="Give back").click()
    expect(at_the_machine.get_by_text("Nobody has control", exact=True)).to_be_visible()
    at_the_machine.close()


def test_a_file_is_kept_and_run_at_the_selected_and_its_picture_stands_in_the_row(
    fleet_page: Page, machine: sync.Machine
) -> None:
    text = block(png(120, 80), "120x80") + "G1010\nG91\nG01 X200 F60\n"
    file = {"name": "sent.gcode", "mimeType": "text/plain", "buffer": text.encode()}
    row = fleet_page.locator(".ag-center-cols-container [role=row]")
    for waiting in ("", "1"):
        fleet_page.get_by_role("button", name="Run on selected").click()
        dialog = fleet_page.get_by_role("dialog", name="Run on several machines")
        dialog.locator("input[type=file]").set_input_files(file)
        expect(dialog.get_by_label("G-code")).to_be_hidden()
        dialog.get_by_role("button", name="Run", exact=True).click()
        expect(row.locator("[col-id=program]")).to_have_text("sent.gcode")
        expect(row.locator("[col-id=waiting]")).to_have_text(waiting)
    fleet_page.wait_for_function("document.querySelector('.mc-fleet img.mc-icon')?.naturalWidth === 120")
    fleet_page.locator("[data-estop]").click()
    wait_for(machine, fleet_page, lambda status: status.state == "estop")
