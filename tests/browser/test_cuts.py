"""A link that is cut: the page goes on as it is, shows what it has missed, and nothing is done twice."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from mcclient import sync

from tests.browser.conftest import Page, PageProcess, expect, opened, page_of, playwright
from tests.browser.test_machine_page import OUTLASTING, stands, upload, wait_for

# a radio link that has died: what is sent goes nowhere, and nobody has noticed yet
DEAF = "() => { window.socket.io.engine.transport.ws.onmessage = () => {}; }"
DUMB = "() => { window.socket.io.engine.transport.ws.send = () => {}; }"
CUT = "() => { window.whole = (window.whole ?? 0) + 1; window.socket.io.engine.close(); }"
# a browser that is busy with something else: what comes waits, but for what keeps the link
BUSY = """() => {
  const { ws } = window.socket.io.engine.transport, take = ws.onmessage;
  window.waiting = [];
  ws.onmessage = (message) => message.data === "2" ? take(message) : window.waiting.push(message);
  window.goOn = () => { ws.onmessage = take; window.waiting.forEach((each) => take(each)); };
}"""
# how many wait that the page's process has sent on its own, and whether as many did five seconds ago
NO_MORE = """() => {
  const now = performance.now(), count = window.waiting.length;
  if (window.waited?.count !== count) window.waited = { count, since: now };
  return count > 0 && now - window.waited.since > 5000;
}"""
BACK = "() => window.whole && window.socket.connected"


@contextmanager
def cut(page: Page) -> Iterator[None]:
    """Cut the link for as long as it is wanted; the page may not be loaded anew afterwards."""
    page.context.set_offline(True)
    page.evaluate(CUT)
    yield
    page.context.set_offline(False)
    page.wait_for_function(BACK)


def machine_file(page: Page) -> playwright.Locator:
    return page.get_by_role("textbox", name="Machine file")


def test_a_dialog_its_text_and_what_is_typed_stay_and_what_was_missed_is_shown(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    upload(page, "chosen.gcode", "G1010\n")
    line, switch = page.get_by_label("G-code line"), page.get_by_role("switch", name="Freeze")
    line.fill("G101")
    switch.click()
    page.get_by_role("button", name="Look at the machine file").click()
    text = machine_file(page).input_value() + "# by ada\n"
    machine_file(page).fill(text)
    with cut(page):
        machine.override(50.0)
        machine_file(page).press_sequentially("#")
    expect(machine_file(page)).to_have_value(re.compile("# by ada"))
    typed = machine_file(page).input_value()
    assert len(typed) == len(text) + 1
    # the page's process has it, too
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="Check", exact=True).click()
    expect(dialog.get_by_text("+# by ada", exact=True)).to_be_visible()
    dialog.get_by_role("button", name="Close").click()
    expect(page.get_by_text("Override 50 %", exact=True)).to_be_visible()
    expect(line).to_have_value("G101")
    expect(switch).to_be_checked()
    expect(page.get_by_label("Program", exact=True)).to_have_value("chosen.gcode")
    line.press("End")
    line.press_sequentially("0")
    line.press("Enter")
    expect(page.get_by_text("G1010 done")).to_be_visible()
    assert page.evaluate("window.whole") == 1


def test_a_browser_that_is_behind_is_sent_no_more_until_it_has_drawn_that_and_then_what_is_so_by_then(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    upload(page, "moving.gcode", OUTLASTING)
    page.get_by_role("button", name="Run", exact=True).first.click()
    expect(page.get_by_role("status")).to_have_text("running")
    shown, before = page.locator(".mc-positions td.n").first, machine.status().axes.position[0]
    page.evaluate(BUSY)
    page.wait_for_function(NO_MORE)
    assert not stands(machine.status())
    # what is old says so
    expect(page.locator("body.mc-silent")).to_have_count(1)
    machine.abort()
    rest = wait_for(machine, page, stands).axes.position[0]
    assert rest > before + 1.0
    at_rest = re.compile(rf"^{rest:.3f}\b")
    expect(shown).not_to_have_text(at_rest)
    page.evaluate("window.goOn()")
    expect(shown).to_have_text(at_rest)
    expect(page.locator("body.mc-silent")).to_have_count(0)


def run_line(page: Page, line: str) -> None:
    field = page.get_by_label("G-code line")
    field.fill(line)
    field.press("Enter")
    expect(field).to_have_value("")


def test_a_line_whose_answer_was_lost_is_run_once(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    run_line(page, "G90 G0 X10")
    wait_for(machine, page, lambda status: abs(status.axes.position[0] - 10.0) < 0.01)
    page.evaluate(DEAF)
    run_line(page, "G91 G0 X5")
    # the next one is typed while this one is on its way
    page.get_by_label("G-code line").fill("G04 P0.1")
    wait_for(machine, page, lambda status: abs(status.axes.position[0] - 15.0) < 0.01)
    with cut(page):
        pass
    expect(page.get_by_text("G91 G0 X5 done")).to_be_visible()
    page.get_by_label("G-code line").press("Enter")
    expect(page.get_by_text("G04 P0.1 done")).to_be_visible()
    assert machine.status().axes.position[0] == pytest.approx(15.0, abs=0.01)


def test_a_line_that_was_lost_is_refused_where_it_comes_too_late_and_stands_in_its_field_again(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    before = machine.status().axes.position[0]
    page.evaluate(DUMB)
    # ten seconds before it comes
    page.evaluate("() => { const t = performance.now(); performance.now = () => t - 10_000; }")
    run_line(page, "G91 G0 X7")
    # the line goes once its field is empty, with the next turn of the browser's loop
    page.evaluate("() => new Promise((sent) => setTimeout(sent, 0))")
    page.evaluate("delete performance.now")
    with cut(page):
        pass
    expect(page.get_by_text(re.compile(r"^This was pressed \d+\.\d s ago: .*\[MC604\]"))).to_be_visible()
    expect(page.get_by_label("G-code line")).to_have_value("G91 G0 X7")
    assert machine.status().axes.position[0] == before
    page.get_by_label("G-code line").press("Enter")
    wait_for(machine, page, lambda status: abs(status.axes.position[0] - before - 7.0) < 0.01)


def test_machines_of_the_fleet_stay_ticked_and_are_stopped(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    page.goto(site.url)
    box = page.locator(".ag-pinned-left-cols-container input[type=checkbox]")
    box.check()
    with cut(page):
        machine.override(50.0)
    expect(box).to_be_checked()
    page.evaluate(DUMB)
    page.get_by_role("button", name="Emergency stop of the selected").click()
    with cut(page):
        pass
    # a stop stops, however late
    wait_for(machine, page, lambda status: status.state == "estop")
    expect(page.get_by_text("1 of 1 machines: emergency stop confirmed")).to_be_visible()


def test_a_line_on_its_way_to_a_page_process_that_dies_is_named_as_uncertain_and_runs_never(
    page: Page, server: Any, machine: sync.Machine, tmp_path: Path
) -> None:
    with page_of(server.endpoint, tmp_path) as mortal:
        opened(page, mortal)
        page.get_by_label("G-code line").fill("G04 P0.1")
        page.get_by_label("Name", exact=True).fill("typed")
        page.evaluate(DUMB)
        before = machine.status().axes.position[0]
        run_line(page, "G91 G0 X9")
        page.get_by_label("G-code line").fill("G04 P0.2")
        mortal.process.kill()
        mortal.process.wait()
    port = mortal.url.rstrip("/").rpartition(":")[2]
    with page_of(server.endpoint, tmp_path, "--port", port):
        # the name may have got through
        named = re.compile(r"^It is not certain that this arrived: (Name typed, )?G-code line G91 G0 X9$")
        expect(page.get_by_text(named)).to_be_visible()
        expect(page.get_by_role("status")).to_have_text("ready")
        expect(page.get_by_label("G-code line")).to_have_value("G04 P0.2")
        assert machine.status().axes.position[0] == before
    page.goto("about:blank")
