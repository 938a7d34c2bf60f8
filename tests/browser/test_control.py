"""One person at a time drives: taken, seen by all, refused to others, given back; stops are for everybody."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from mcclient import sync

from mcserver.web.users import Role, add_user
from tests.browser.conftest import (
    LIMIT_MS,
    TRIES,
    WIDE,
    Browser,
    Locator,
    Page,
    PageProcess,
    expect,
    opened,
    page_of,
    press,
)
from tests.browser.test_fleet_page import log_in
from tests.browser.test_machine_page import OUTLASTING, at_rest, held_until, stands, upload, wait_for
from tests.e2e.servers import ServerProcess


@pytest.fixture(scope="module")
def guarded(server: ServerProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    """A page with logins of three operators."""
    users = tmp_path_factory.mktemp("users") / "users"
    for name in ("ada", "bob", "eve"):
        add_user(users, name, Role.OPERATOR, f"{name}'s battery staple")
    with page_of(server.endpoint, tmp_path_factory.mktemp("programs"), "--users", str(users)) as made:
        yield made


@contextmanager
def seat(browser: Browser, site: PageProcess, name: str) -> Iterator[Page]:
    """A browser of its own, logged in, on the machine's page."""
    context = browser.new_context(viewport=WIDE)
    context.set_default_timeout(LIMIT_MS)
    try:
        page = context.new_page()
        log_in(page, site, name, f"{name}'s battery staple")
        expect(page).not_to_have_url(re.compile("/login"))
        yield opened(page, site)
    finally:
        context.close()


@pytest.fixture(scope="module")
def ada(browser: Browser, guarded: PageProcess) -> Iterator[Page]:
    with seat(browser, guarded, "ada") as page:
        yield page


@pytest.fixture(scope="module")
def bob(browser: Browser, guarded: PageProcess) -> Iterator[Page]:
    with seat(browser, guarded, "bob") as page:
        yield page


def point_at(page: Page, button: str) -> None:
    # a browser's window that is behind another one jogs nothing
    page.bring_to_front()
    page.get_by_role("button", name=button).hover()


def test_who_drives_is_seen_by_all_and_others_are_refused_but_may_stop(
    ada: Page, bob: Page, machine: sync.Machine
) -> None:
    for page in (ada, bob):
        expect(page.get_by_text("Nobody has control", exact=True)).to_be_visible()
    # the first action takes control: who is alone notices nothing of it
    upload(ada, "slow.gcode", OUTLASTING)
    ada.get_by_role("button", name="Run", exact=True).first.click()
    expect(ada.get_by_text("You have control", exact=True)).to_be_visible()
    expect(bob.get_by_text(re.compile(r"^ada \(browser \w+\) has control$"))).to_be_visible()
    expect(bob.locator(".mc-people")).to_contain_text(re.compile(r"Drives: ada \(browser"))
    expect(bob.get_by_role("status")).to_have_text("running")
    refused = bob.get_by_text(re.compile(r"^ada .* has control \[MC078\] — press Take control"))
    press_until(bob.get_by_role("button", name="10 %", exact=True), refused)
    assert machine.status().override == 100.0
    bob.get_by_role("button", name="Hold", exact=True).click()
    expect(bob.get_by_role("status")).to_have_text("held")
    bob.locator("[data-estop]").click()
    wait_for(machine, bob, lambda status: status.state == "estop")
    # it is for the one who drives to say that the cause is removed
    close_all(bob.locator(".q-notification").filter(has=refused))
    bob.get_by_role("button", name="Reset").click()
    expect(refused).to_be_visible()
    ada.get_by_role("button", name="Reset").click()
    expect(bob.get_by_role("status")).to_have_text("ready")


def test_control_is_taken_over_by_the_keyboard_and_an_axis_that_was_jogged_stops(
    ada: Page, bob: Page, machine: sync.Machine
) -> None:
    start = machine.status().axes.position[1]
    point_at(ada, "jog axis Y plus")
    held_until(machine, ada, lambda status: status.axes.position[1] > start + 5.0)
    press(bob.get_by_role("button", name="Take control"))
    dialog = bob.get_by_role("dialog", name=re.compile(r"^ada .* has control of bench\. Take it\?$"))
    press(dialog.get_by_role("button", name="Take control"))
    expect(bob.get_by_text("You have control", exact=True)).to_be_visible()
    # her finger is still down
    rest = wait_for(machine, ada, at_rest).axes.position[1]
    expect(ada.get_by_text(re.compile(r"^bob \(browser \w+\) has taken control$"))).to_be_visible()
    ada.mouse.up()
    point_at(ada, "jog axis Y plus")
    ada.mouse.down()
    expect(ada.get_by_text(re.compile(r"^bob .* has control \[MC078\]"))).to_be_visible()
    ada.mouse.up()
    assert stands(machine.status())
    assert machine.status().axes.position[1] == pytest.approx(rest, abs=0.1)


def test_control_is_given_back_by_a_button_by_a_closed_page_and_by_the_end_of_a_login(
    browser: Browser, guarded: PageProcess, bob: Page
) -> None:
    free = bob.get_by_text("Nobody has control", exact=True)
    taken = bob.get_by_text(re.compile("^ada .* has control$"))
    with seat(browser, guarded, "ada") as ada:
        take_control(ada)
        expect(taken).to_be_visible()
        ada.get_by_role("button", name="Give back").click()
        expect(free).to_be_visible()
        take_control(ada)
        expect(taken).to_be_visible()
    expect(free).to_be_visible()
    with seat(browser, guarded, "ada") as ada:
        take_control(ada)
        expect(taken).to_be_visible()
        ada.get_by_role("button", name="Menu").click()
        ada.get_by_role("menuitem", name="Log out").click()
        expect(free).to_be_visible()
        # Chromium may never close a profile whose page is on its way to another
        expect(ada).to_have_url(re.compile("/login"))


def press_until(button: Locator, said: Locator) -> None:
    """Press a button until a sentence comes: on a busy computer a press may be refused as too late."""
    late = button.page.locator(".q-notification").filter(has_text="[MC604]")
    for _ in range(TRIES):
        button.click()
        expect(said.or_(late).first).to_be_visible()
        if said.count():
            return
        # what is said of the next press is told from what was said of this one
        close_all(late)
    raise AssertionError("every press was late")


def close_all(notifications: Locator) -> None:
    """Close what is said; what goes by itself meanwhile need not be closed."""
    buttons = notifications.get_by_role("button", name="close")
    buttons.evaluate_all("(buttons) => buttons.forEach((each) => each.click())")
    expect(notifications).to_have_count(0)


def take_control(page: Page) -> None:
    """Take control, from whoever has it."""
    page.get_by_role("button", name="Take control").click()
    mine = page.get_by_text("You have control", exact=True)
    dialog = page.get_by_role("dialog", name=re.compile("Take it"))
    expect(mine.or_(dialog).first).to_be_visible()
    if dialog.count():
        dialog.get_by_role("button", name="Take control").click()
    expect(mine).to_be_visible()
