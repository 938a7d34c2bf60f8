"""A page that has no link: what cannot be reached looks so, and no text that is typed is lost."""

from __future__ import annotations

import re

import pytest
from mcclient import sync

from tests.browser.conftest import Page, PageProcess, WebSocketRoute, expect, opened
from tests.browser.test_cuts import cut
from tests.browser.test_machine_page import wait_for

IS_OUT_OF_REACH = "(element) => element.closest('[inert]') !== null"
WAITS = re.compile("^Connecting …$")
LOST = re.compile("^No connection: ")


@pytest.mark.usefixtures("machine")
@pytest.mark.parametrize(("path", "field"), [("", "Search"), ("machine/bench", "G-code line")])
def test_a_page_that_is_not_connected_yet_says_so_and_takes_no_text_and_no_press_but_the_emergency_stop(
    page: Page, site: PageProcess, path: str, field: str
) -> None:
    own = page.context.new_page()
    sockets: list[WebSocketRoute] = []
    own.route_web_socket("**/*", lambda socket: sockets.append(socket))
    own.goto(f"{site.url}{path}")
    expect(own.get_by_text(WAITS)).to_be_visible()
    search, stop = own.get_by_label(field), own.locator("[data-estop]")
    assert search.evaluate(IS_OUT_OF_REACH)
    # a click there, as who does not look at it makes it
    box = search.bounding_box()
    assert box is not None
    own.mouse.click(box["x"] + 5.0, box["y"] + 5.0)
    own.keyboard.type("bench")
    expect(search).to_have_value("")
    assert own.get_by_role("button", name="Menu").evaluate(IS_OUT_OF_REACH)
    assert not stop.evaluate(IS_OUT_OF_REACH)
    sockets[-1].connect_to_server()
    search.fill("bench")
    expect(search).to_have_value("bench")
    expect(own.get_by_text(WAITS)).to_have_count(0)
    own.close()


def test_while_the_link_is_lost_a_text_goes_on_and_nothing_can_be_pressed_but_what_stops(
    page: Page, site: PageProcess, machine: sync.Machine
) -> None:
    opened(page, site)
    line, hold = page.get_by_label("G-code line"), page.get_by_role("button", name="Hold", exact=True)
    line.fill("G04 P0")
    with cut(page):
        expect(page.get_by_text(LOST)).to_be_visible()
        # the field has kept the focus
        page.keyboard.type(".1")
        page.keyboard.press("Enter")
        for name in ("Resume", "Energize", "jog axis Y plus", "Menu"):
            assert page.get_by_role("button", name=name, exact=True).evaluate(IS_OUT_OF_REACH)
        assert page.get_by_label("Program", exact=True).evaluate(IS_OUT_OF_REACH)
        abort = page.get_by_role("button", name="Abort", exact=True)
        for stop in (hold, abort, page.locator("[data-estop]")):
            assert not stop.evaluate(IS_OUT_OF_REACH)
        page.locator("[data-estop]").click()
    wait_for(machine, page, lambda status: status.state == "estop")
    expect(page.get_by_text(LOST)).to_have_count(0)
    # Enter was held back
    expect(line).to_have_value("G04 P0.1")
    expect(page.get_by_text("G04 P0.1 done")).to_have_count(0)


@pytest.mark.usefixtures("machine")
def test_a_text_that_a_page_loaded_anew_cannot_bring_back_is_named(page: Page, site: PageProcess) -> None:
    opened(page, site)
    name = page.get_by_label("Name", exact=True)
    with cut(page):
        name.press_sequentially("mine")
        page.evaluate("window.socket.io.opts.reconnection = false; window.socket.disconnect()")
        page.context.set_offline(False)
        page.reload()
        page.evaluate("window.whole = 1")
    expect(page.get_by_text("It is not certain that this arrived: Name mine", exact=True)).to_be_visible()
