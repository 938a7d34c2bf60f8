"""The operator's page of one machine, driven in a browser as an operator would."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from mcclient import MachineStatus, sync

from tests.browser.conftest import (
    LIMIT_MS,
    LIMIT_S,
    TRIES,
    Page,
    PageProcess,
    expect,
    expect_no_overflow,
    opened,
    page_of,
)

LOOK_MS = 25
LOOKS = LIMIT_MS // LOOK_MS
# a minute at 10 %, with room for a browser on a busy computer
LONG = "G1010\nG01 X2000 F20000\n"
# for as long as a test may take, a millimetre each second
OUTLASTING = f"G1010\nG91\nG01 X{LIMIT_S:g} F60\n"


def wait_for(machine: sync.Machine, page: Page, wanted: Callable[[MachineStatus], bool]) -> MachineStatus:
    """The first state that fits; the page goes on meanwhile."""
    for _ in range(LOOKS):
        status = machine.status()
        if wanted(status):
            return status
        page.wait_for_timeout(LOOK_MS)
    raise AssertionError(f"not seen: {status}")


def held_until(machine: sync.Machine, page: Page, wanted: Callable[[MachineStatus], bool]) -> None:
    """Press, and press again where the dead man's time of a busy computer has ended the move."""
    for _ in range(TRIES):
        page.mouse.down()
        for _ in range(50):
            if wanted(machine.status()):
                return
            page.wait_for_timeout(LOOK_MS)
        page.mouse.up()
    raise AssertionError(f"not seen: {machine.status()}")


def stands(status: MachineStatus) -> bool:
    return max(map(abs, status.axes.velocity)) < 0.01


def at_rest(status: MachineStatus) -> bool:
    return stands(status) and all(program.ended_at for program in status.programs)


def upload(page: Page, name: str, text: str) -> None:
    """Upload a file; once more where a busy browser had lost its link, and the page was built anew."""
    field = page.get_by_label("Program", exact=True)
    for _ in range(TRIES):
        page.locator("input[type=file]").set_input_files(
            {"name": name, "mimeType": "text/plain", "buffer": text.encode()}
        )
        try:
            expect(field).to_have_value(name, timeout=LIMIT_MS / TRIES)
        except AssertionError:
            continue
        return
    raise AssertionError(f"{name} is not uploaded")


def test_a_file_is_uploaded_run_held_overridden_and_finished(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    upload(page, "three.gcode", LONG)
    expect(page.get_by_text("three.gcode: no faults")).to_be_visible()
    page.get_by_role("button", name="10 %", exact=True).click()
    expect(page.get_by_text("Override 10 %", exact=True)).to_be_visible()
    # who clicks twice wants it once
    page.get_by_role("button", name="Run", exact=True).first.dblclick()
    expect(page.get_by_role("status")).to_have_text("running")
    page.get_by_role("button", name="Hold").click()
    expect(page.get_by_role("status")).to_have_text("held")
    held = wait_for(machine, page, stands)
    assert held.programs[-1].state == "held"  # the newest
    expect(page.get_by_role("button", name="remove three.gcode from the queue")).to_have_count(0)
    page.get_by_role("button", name="200 %").click()
    expect(page.get_by_text("Override 200 %", exact=True)).to_be_visible()
    page.get_by_role("button", name="Resume").click()
    expect(page.get_by_text("three.gcode · finished").first).to_be_visible(timeout=LIMIT_MS)
    assert machine.status().axes.position[0] == pytest.approx(2000.0, abs=0.1)


def test_a_fault_in_line_3_is_shown_at_its_place_and_nothing_moves(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    before = machine.status().axes.position
    upload(page, "wrong.gcode", "G1010\nG01 X10 F600\nG02 X100 Y0 R30\n")
    expect(page.get_by_text(re.compile(r"line 3, column \d+: .*\[MC104\]"))).to_be_visible()
    page.get_by_role("button", name="Run", exact=True).first.click()
    expect(page.get_by_text("wrong.gcode · failed").first).to_be_visible()
    assert machine.status().axes.position == before


def test_an_axis_moves_while_its_jog_button_is_held_and_stops_on_release(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    start = machine.status().axes.position[0]
    page.get_by_role("button", name="jog axis X plus").hover()
    held_until(machine, page, lambda status: status.axes.position[0] > start + 20.0)
    page.mouse.up()
    wait_for(machine, page, at_rest)
    assert [program.state for program in machine.programs(ended=False)] == []


def test_leaving_the_button_stops_the_axis(page: Page, site: PageProcess, machine: sync.Machine) -> None:
    opened(page, site)
    start = machine.status().axes.position[1]
    page.get_by_role("button", name="jog axis Y plus").hover()
    held_until(machine, page, lambda status: status.axes.position[1] > start + 5.0)
    page.mouse.move(5, 500)
    wait_for(machine, page, at_rest)
    page.mouse.up()


def test_the_keyboard_alone_jogs_while_the_key_is_down(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    start = machine.status().axes.position[2]
    page.get_by_role("button", name="jog axis Z minus").focus()
    page.keyboard.down(" ")
    wait_for(machine, page, lambda status: status.axes.position[2] < start - 5.0)
    page.keyboard.up(" ")
    wait_for(machine, page, at_rest)


def test_a_lost_link_stops_the_axis_and_nothing_starts_when_it_comes_back(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    start = machine.status().axes.position[0]
    page.get_by_role("button", name="jog axis X minus").hover()
    held_until(machine, page, lambda status: status.axes.position[0] < start - 5.0)
    # a websocket that is open already is not cut by the browser's offline mode: drop its messages
    page.context.set_offline(True)
    page.evaluate("window.socket.io.engine.close()")
    rest = wait_for(machine, page, at_rest).axes.position[0]
    page.context.set_offline(False)
    expect(page.get_by_role("status")).to_have_text("ready")
    # several keep-alives' time, with the button still down
    page.wait_for_timeout(500)
    page.mouse.up()
    assert machine.status().axes.position[0] == pytest.approx(rest, abs=0.1)


def test_a_killed_page_process_stops_the_axis_that_it_jogged(
    page: Page, server: Any, machine: sync.Machine, tmp_path: Any
) -> None:
    with page_of(server.endpoint, tmp_path) as mortal:
        opened(page, mortal)
        start = machine.status().axes.position[0]
        page.get_by_role("button", name="jog axis X plus").hover()
        held_until(machine, page, lambda status: status.axes.position[0] > start + 5.0)
        mortal.process.kill()
        wait_for(machine, page, at_rest)
        # what the page shows is old from now on, and it says so
        expect(page.locator("body")).to_have_class(re.compile("mc-silent"))
    page.mouse.up()


def test_the_emergency_stop_is_confirmed_shown_before_all_else_and_reset(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    # away from where the tests before have left it
    far = 0.0 if machine.status().axes.position[0] > 1000.0 else 2000.0
    upload(page, "long.gcode", f"G1010\nG01 X{far} F2000\n")
    page.get_by_role("button", name="Run", exact=True).first.click()
    expect(page.get_by_role("status")).to_have_text("running")
    page.get_by_role("button", name="Emergency stop").click()
    expect(page.get_by_role("status")).to_have_text("EMERGENCY STOP")
    shown = page.get_by_role("alert").filter(has=page.locator(".mc-faults"))
    expect(shown).to_contain_text("MC400")
    assert machine.status().state == "estop"
    wait_for(machine, page, stands)
    expect(page.get_by_text("long.gcode · failed").first).to_be_visible()
    # where it was, and the way back that stands above it
    expect(page.locator(".mc-program .now").first).to_contain_text(f"G01 X{far} F2000")
    back = "To go on: remove the cause, then Continue at line 2, or run it again."
    expect(page.get_by_text(back)).to_be_visible()
    page.get_by_role("button", name="Reset").click()
    expect(page.get_by_role("status")).to_have_text("ready")
    # the stop has emptied the queue: what is started now runs
    page.get_by_role("button", name="Run", exact=True).first.click()
    expect(page.get_by_role("status")).to_have_text("running")


def test_a_line_typed_in_runs_and_a_wrong_one_is_shown_with_its_column(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    field = page.get_by_label("G-code line")
    field.fill("G1020 X12")
    field.press("Enter")
    wait_for(machine, page, lambda status: abs(status.axes.position[0] - 12.0) < 0.01)
    expect(page.get_by_text("manual input by local · finished", exact=True)).to_be_visible()
    field.fill("G02 X100 Y0 R1")
    field.press("Enter")
    expect(page.get_by_text(re.compile(r"\^+ .*\[MC104\]"))).to_be_visible()


@pytest.mark.parametrize(("width", "height"), [(360, 740), (1920, 1080)])
def test_the_emergency_stop_stays_in_view_and_nothing_overflows(
    page: Page, site: PageProcess, width: int, height: int
) -> None:
    page.set_viewport_size({"width": width, "height": height})
    opened(page, site)
    expect_no_overflow(page, width)
    page.evaluate("window.scrollTo(0, document.body.scrollHeight)")
    expect(page.get_by_role("button", name="Emergency stop")).to_be_in_viewport()
