"""What an operator does beside running one file: queue, run from the middle, typed lines, a jog let go."""

from __future__ import annotations

import os
import re
import signal

import pytest
from mcclient import sync

from tests.browser.conftest import Page, PageProcess, choose, expect, opened
from tests.browser.test_machine_page import LONG, at_rest, held_until, stands, upload, wait_for

# at a call of some ms each, this is far more than any dead man's time
MOST_LOOKS = 20_000


def run(page: Page) -> None:
    page.get_by_role("button", name="Run", exact=True).first.click()


def test_what_waits_has_a_total_time_and_the_one_that_was_pressed_is_removed(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    # 200 mm at 1 mm/s, from wherever the axis is
    upload(page, "slow.gcode", "G1010\nG91\nG01 X200 F60\n")
    run(page)
    expect(page.get_by_role("status")).to_have_text("running")
    page.get_by_role("button", name="Hold").click()
    expect(page.get_by_role("status")).to_have_text("held")
    upload(page, "short.gcode", "G1010\nG91\nG01 X20 F60\n")
    run(page)
    run(page)
    expect(page.get_by_text(re.compile(r"^2 waiting: 0:40; all done in [1-4]:\d\d$"))).to_be_visible()
    remove = page.get_by_role("button", name="remove short.gcode from the queue")
    # while the finger is down on the second, the first goes: the second moves up, and is another button there
    remove.last.hover()
    page.mouse.down()
    remove.first.evaluate("(button) => button.click()")
    expect(page.get_by_text(re.compile(r"^1 waiting: 0:20"))).to_be_visible()
    page.mouse.up()
    expect(remove).to_have_count(0)
    # what was held up on the way moves nothing when it comes; a stop stops
    page.evaluate("() => { const t = performance.now(); performance.now = () => t - 10_000; }")
    page.get_by_role("button", name="Resume").click()
    expect(page.get_by_text(re.compile(r"^This was pressed \d+\.\d s ago: .*\[MC604\]"))).to_be_visible()
    expect(page.get_by_role("status")).to_have_text("held")
    page.get_by_role("button", name="Abort").click()
    page.evaluate("delete performance.now")
    wait_for(machine, page, at_rest)
    assert len(machine.programs(ended=False)) == 0


def test_a_run_from_a_line_asks_and_shows_where_the_program_would_be(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    with machine.program("energize") as program:
        program.send("G1010")
        program.send("G00 X0 Y0")
    upload(page, "middle.gcode", "G1010\nG90\nG01 X50 F6000\nG01 Y30\nG01 X60\n")
    before = wait_for(machine, page, at_rest).axes.position
    page.get_by_label("From line").fill("4")
    run(page)
    dialog = page.get_by_role("dialog", name="Run middle.gcode from line 4?")
    expect(dialog.get_by_role("row", name=re.compile(r"X\s+0\.000\s+50\.000"))).to_be_visible()
    expect(dialog).to_contain_text("G01 Y30")
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_have_count(0)
    assert machine.status().axes.position == pytest.approx(before, abs=1e-3)
    run(page)
    # the machine file names no safe height: the way has to be confirmed
    dialog.get_by_role("button", name="Take this way: run from line 4").click()
    wait_for(machine, page, lambda status: abs(status.axes.position[0] - 60.0) < 0.05 and stands(status))
    expect(page.get_by_text(re.compile("^middle.gcode is finished after"))).to_be_visible()
    page.get_by_label("From line").fill("")
    expect(page.get_by_label("From line")).to_have_attribute("placeholder", "1")


def test_a_pause_says_what_the_program_asks_for(page: Page, site: PageProcess, machine: sync.Machine) -> None:
    opened(page, site)
    upload(page, "pause.gcode", "G1010\nM00 ; turn the part\nG04 P0.1\n")
    run(page)
    expect(page.get_by_role("status")).to_have_text("paused")
    expect(page.get_by_role("alert", name="Notices")).to_contain_text("turn the part. Then press Resume")
    page.get_by_role("button", name="Resume").click()
    expect(page.get_by_text(re.compile("^pause.gcode is finished after"))).to_be_visible()
    expect(page.get_by_role("alert", name="Notices")).to_be_hidden()
    assert not machine.programs(ended=False)


def test_a_program_runs_line_by_line_in_single_step(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    start = wait_for(machine, page, at_rest).axes.position[0]
    upload(page, "step.gcode", "G1010\nG91\nG01 X5 F600\n\nG01 X5\n")
    switch = page.get_by_role("switch", name="Single step")
    switch.click()
    run(page)
    expect(page.get_by_text(re.compile("^step.gcode · running · .* · Single step$"))).to_be_visible()
    following = page.get_by_role("button", name="Next line")
    # the blank line goes with the one before
    for done, way in ((1, 0.0), (2, 0.0), (4, 5.0)):
        following.click()
        status = wait_for(machine, page, lambda status, done=done: status.programs[0].done == done)
        assert status.axes.position[0] == pytest.approx(start + way, abs=0.05)
    following.click()
    expect(page.get_by_text(re.compile("^step.gcode is finished after"))).to_be_visible()
    assert machine.status().axes.position[0] == pytest.approx(start + 10.0, abs=0.05)
    expect(following).to_be_hidden()
    switch.click()
    run(page)
    wait_for(machine, page, lambda status: abs(status.axes.position[0] - start - 20.0) < 0.05)


def test_a_line_is_completed_remembered_and_refused_while_a_program_runs(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    field = page.get_by_label("G-code line")
    field.press_sequentially("g103")
    field.press("Tab")
    expect(field).to_have_value(re.compile(r"^g1030$", re.IGNORECASE))
    for line in ("G04 P0.01", "G04 P0.02"):
        field.fill(line)
        field.press("Enter")
        expect(page.get_by_text(f"{line}   done")).to_be_visible()
    for key, line in (("ArrowUp", "G04 P0.02"), ("ArrowUp", "G04 P0.01"), ("ArrowDown", "G04 P0.02")):
        field.press(key)
        expect(field).to_have_value(line)
    upload(page, "long.gcode", "G1010\nG91\nG01 X20 F60\n")
    run(page)
    expect(page.get_by_role("status")).to_have_text("running")
    field.fill("G00 Y100")
    field.press("Enter")
    expect(
        page.get_by_text(re.compile(r"long.gcode of .* is running: a line typed now .*\[MC512\]"))
    ).to_be_visible()
    assert [program.name for program in machine.programs(ended=False)] == ["long.gcode"]


@pytest.mark.parametrize("lost", ["focus", "lid"])
def test_a_page_that_is_left_while_an_axis_is_jogged_stops_it(
    page: Page, site: PageProcess, machine: sync.Machine, lost: str
) -> None:
    opened(page, site)
    browser = page.context.new_cdp_session(page)
    assert page.context.browser is not None
    whole = page.context.browser.new_browser_cdp_session()
    start = machine.status().axes.position[1]
    page.get_by_role("button", name="jog axis Y minus").hover()
    held_until(machine, page, lambda status: status.axes.position[1] < start - 5.0)
    if lost == "focus":
        # as when another window comes before it
        browser.send("Emulation.setFocusEmulationEnabled", {"enabled": False})
        other = page.context.new_page()
        other.bring_to_front()
    else:
        # a closed lid stops all timers of the page with nothing said, and its connection stands
        processes = whole.send("SystemInfo.getProcessInfo")["processInfo"]
        renderers = [process["id"] for process in processes if process["type"] == "renderer"]
        assert renderers
        for renderer in renderers:
            os.kill(renderer, signal.SIGSTOP)
    # the page itself is asked for nothing meanwhile
    looks = (machine.status() for _ in range(MOST_LOOKS))
    rest = next((status.axes.position[1] for status in looks if at_rest(status)), None)
    if lost == "focus":
        other.close()
        browser.send("Emulation.setFocusEmulationEnabled", {"enabled": True})
    else:
        for renderer in renderers:
            os.kill(renderer, signal.SIGCONT)
    assert rest is not None
    # back again, with the button still down
    expect(page.get_by_role("status")).to_have_text("ready")
    page.wait_for_timeout(500)
    page.mouse.up()
    assert machine.status().axes.position[1] == pytest.approx(rest, abs=0.1)
    browser.detach()
    whole.detach()


def test_who_holds_which_axes_is_shown_and_a_deletion_asks(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    with machine.program("by another", axes=[0, 2]):
        expect(page.locator(".mc-people")).to_contain_text(re.compile(r"by another holds X, Z \("))
    upload(page, "gone.gcode", "G1010\n")
    page.get_by_role("button", name="Delete").click()
    dialog = page.get_by_role("dialog", name="Delete gone.gcode?")
    dialog.get_by_role("button", name="Cancel").click()
    expect(dialog).to_have_count(0)
    expect(page.get_by_label("Program", exact=True)).to_have_value("gone.gcode")
    page.get_by_role("button", name="Delete").click()
    dialog.get_by_role("button", name="Delete").click()
    expect(page.get_by_label("Program", exact=True)).not_to_have_value("gone.gcode")


def test_charts_of_other_signals_go_back_in_time_and_stand_still(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    machine.jog(0, 5.0)
    wait_for(machine, page, at_rest)
    choose(page, page.get_by_label("Span"), "120 s")
    signals = page.get_by_label("Signals")
    signals.fill("X position")
    page.get_by_role("option", name="X position [mm]", exact=True).click()
    signals.press("Escape")
    option = "getElement(Number(document.querySelector('.mc-chart').id.slice(1))).chart.getOption()"
    # what was before the signal was chosen is there too
    page.wait_for_function(
        f"{option}.series.some(each => each.name === 'X position' && each.data.length > 20)"
    )
    assert page.evaluate(f"{option}.xAxis[0].min") == -120
    page.get_by_role("switch", name="Freeze").click()
    page.wait_for_function(f"{option}.dataZoom?.length === 1")
    page.get_by_role("switch", name="Freeze").click()
    page.wait_for_function(f"!{option}.dataZoom?.length")


def test_the_keyboard_alone_runs_holds_and_ends_a_job(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    upload(page, "keys.gcode", LONG)
    expect(page.get_by_text("keys.gcode: no faults")).to_be_visible()
    page.evaluate("document.activeElement.blur()")

    def tab_to(name: str) -> None:
        for _ in range(200):
            page.keyboard.press("Tab")
            if page.evaluate("document.activeElement.innerText?.trim()").lower() == name.lower():
                return
        raise AssertionError(f"{name} is not reached by Tab")

    tab_to("10 %")
    page.keyboard.press("Enter")
    expect(page.get_by_text("Override 10 %", exact=True)).to_be_visible()
    tab_to("Run")
    page.keyboard.press("Enter")
    expect(page.get_by_role("status")).to_have_text("running")
    page.evaluate("document.activeElement.blur()")
    page.keyboard.press(" ")
    expect(page.get_by_role("status")).to_have_text("held")
    tab_to("Resume")
    page.keyboard.press("Enter")
    expect(page.get_by_role("status")).to_have_text("running")
    # a fold opens by Space, which is no feed hold there: that would have gone before the next order
    page.get_by_role("button", name='Expand "Drives"').press(" ")
    expect(page.get_by_role("button", name='Collapse "Drives"')).to_be_visible()
    page.get_by_role("button", name="+5").press("Enter")
    expect(page.get_by_text("Override 15 %", exact=True)).to_be_visible()
    assert machine.status().state != "held"
    tab_to("Abort")
    page.keyboard.press("Enter")
    expect(page.get_by_role("status")).to_have_text("ready")
    page.keyboard.press("Shift+Escape")
    expect(page.get_by_role("status")).to_have_text("EMERGENCY STOP")
    tab_to("Reset")
    page.keyboard.press("Enter")
    expect(page.get_by_role("status")).to_have_text("ready")
    assert machine.status().state == "ready"


def test_a_faulty_program_stands_in_the_program_card_at_its_line_with_the_way_back(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    page.get_by_role("button", name="Energize", exact=True).click()
    expect(page.get_by_text(re.compile("^energize · finished"))).to_be_visible()
    upload(page, "faulty.gcode", "G1010\nG01 X1 F600\nG02 X5\n")
    run(page)
    expect(page.get_by_text("faulty.gcode · failed", exact=True)).to_be_visible()
    expect(page.get_by_text("To go on: correct the file and upload it again.")).to_be_visible()
    assert all(program.name != "faulty.gcode" for program in machine.programs())


def test_block_delete_and_optional_stop_are_switched_on_the_page(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    start = wait_for(machine, page, at_rest).axes.position[0]
    delete, stop = (page.get_by_role("switch", name=name) for name in ("Block delete", "Optional stop"))
    expect(stop).to_be_checked()
    delete.click()
    stop.click()
    upload(page, "switched.gcode", "G1010\nG91\nG01 X2 F600\n/G01 X50\nM01\nG01 X2\nG04 P2\n")
    run(page)
    said = "^switched.gcode · running · .* · block delete on · optional stop off$"
    expect(page.get_by_text(re.compile(said))).to_be_visible()
    expect(page.get_by_text(re.compile("^switched.gcode is finished after"))).to_be_visible()
    assert machine.status().axes.position[0] == pytest.approx(start + 4.0, abs=0.05)
    delete.click()
    stop.click()
    run(page)
    wait_for(machine, page, lambda status: status.programs[-1].state == "paused")
    assert machine.status().axes.position[0] == pytest.approx(start + 56.0, abs=0.05)
    page.get_by_role("button", name="Abort").click()
    wait_for(machine, page, at_rest)
