"""The page of all machines, and the login before it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from mcserver.service.reports import AxesStatus, MachineStatus
from mcserver.web.users import Role, add_user
from tests.browser.conftest import Page, PageProcess, expect, expect_no_overflow, page_of
from tests.zenoh_sessions import locator_of, opened

MACHINES = 20


class Answering:
    """Machines that answer ``status`` and count the holds that they are given."""

    def __init__(self, count: int) -> None:
        self.holds: list[str] = []
        self._session = opened(
            {"mode": "router", "listen/endpoints": ["tcp/127.0.0.1:0"], "adminspace/enabled": True}
        )
        self.endpoint = locator_of(self._session)
        self._declared = [
            self._declare(f"{'hall' if number < 5 else 'cell'}-{number:02}") for number in range(count)
        ]

    def _declare(self, name: str) -> object:
        state = "fault" if name == "cell-07" else "ready"
        status = msgspec.msgpack.encode(
            MachineStatus(
                t=0.0,
                wall=0.0,
                instance="one",
                state=state,
                axes=AxesStatus([], [], [], [], [], []),
                programs=[],
                faults=[],
                override=100.0,
                late_cycles=0,
                tools=[],
            )
        )

        def answer(query: zenoh.Query) -> None:
            with query:
                method = str(query.key_expr).rpartition("/")[2]
                if method == "hold":
                    self.holds.append(name)
                    query.reply(query.key_expr, msgspec.msgpack.encode({"programs": []}))
                elif method == "status":
                    query.reply(str(query.key_expr).replace("*", name), status)

        return (
            self._session.declare_queryable(
                f"mc/@v1/{name}/@rpc/**", zenoh.handlers.Callback(answer, indirect=False)
            ),
            self._session.liveliness().declare_token(f"mc/@v1/{name}/live/1.{self._session.zid()}"),
        )

    def close(self) -> None:
        self._session.close()


@pytest.fixture(scope="module")
def fleet() -> Iterator[Answering]:
    made = Answering(MACHINES)
    yield made
    made.close()


@pytest.fixture(scope="module")
def fleet_site(fleet: Answering, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    users = tmp_path_factory.mktemp("users") / "users"
    for name, role in (("ada", Role.OPERATOR), ("bob", Role.OBSERVER)):
        add_user(users, name, role, f"{name}'s battery staple")
    with page_of(fleet.endpoint, tmp_path_factory.mktemp("programs"), "--users", str(users)) as made:
        yield made


def log_in(page: Page, site: PageProcess, name: str, password: str) -> None:
    page.context.clear_cookies()
    page.goto(site.url)
    expect(page).to_have_url(re.compile("/login"))
    page.get_by_label("Name").fill(name)
    page.get_by_label("Password").fill(password)
    page.get_by_role("button", name="Log in").click()


def test_all_machines_are_shown_searched_and_several_held_after_a_question(
    page: Page, fleet: Answering, fleet_site: PageProcess
) -> None:
    log_in(page, fleet_site, "ada", "ada's battery staple")
    expect(page.get_by_role("status")).to_have_text(f"{MACHINES} of {MACHINES} online, 1 with faults")
    row = page.locator(".ag-center-cols-container [role=row]")
    # what is wrong stands first
    expect(page.locator(".ag-pinned-left-cols-container [role=row][row-index='0']")).to_contain_text(
        "cell-07"
    )
    page.get_by_label("State").click()
    page.get_by_role("option", name="fault", exact=True).click()
    expect(row).to_have_count(1)
    page.get_by_label("State").click()
    page.get_by_role("option", name="all states").click()
    page.get_by_label("Group").click()
    page.get_by_role("option", name="hall").click()
    expect(row).to_have_count(5)
    every, ticked = (
        page.locator(".ag-header-select-all input"),
        page.locator(".ag-pinned-left-cols-container input:checked"),
    )
    every.check()
    expect(ticked).to_have_count(5)
    every.uncheck()
    expect(ticked).to_have_count(0)
    page.get_by_label("Group").click()
    page.get_by_role("option", name="all groups").click()
    page.get_by_label("Search").fill("cell-07")
    expect(row).to_have_count(1)
    expect(row).to_contain_text("fault")
    page.locator(".ag-pinned-left-cols-container input[type=checkbox]").check()
    page.get_by_role("button", name="Hold selected").click()
    assert fleet.holds == []
    page.get_by_role("button", name="Hold", exact=True).click()
    expect(page.get_by_text("1 of 1 machines: hold")).to_be_visible()
    assert fleet.holds == ["cell-07"]


def test_a_wrong_password_is_refused_and_an_observer_may_look_but_not_hold(
    page: Page, fleet: Answering, fleet_site: PageProcess
) -> None:
    held = list(fleet.holds)
    log_in(page, fleet_site, "bob", "wrong password")
    expect(page.get_by_role("alert")).to_contain_text("Wrong name or password")
    log_in(page, fleet_site, "bob", "bob's battery staple")
    expect(page.get_by_role("status")).to_contain_text(f"{MACHINES} of {MACHINES}")
    for refused in ("Reset selected", "Run on selected …"):
        expect(page.get_by_role("button", name=refused)).to_be_disabled()
    page.get_by_role("link", name="cell-07").click()
    expect(page.get_by_role("button", name="Hold", exact=True)).to_be_disabled()
    assert fleet.holds == held


def test_who_logs_out_sees_nothing_more_on_any_tab(page: Page, fleet_site: PageProcess) -> None:
    log_in(page, fleet_site, "bob", "bob's battery staple")
    other = page.context.new_page()
    other.goto(fleet_site.url)
    expect(other.get_by_role("status")).to_contain_text(f"{MACHINES} of {MACHINES}")
    page.get_by_role("button", name="Menu").click()
    page.get_by_role("menuitem", name="Log out").click()
    for each in (page, other):
        expect(each).to_have_url(re.compile("/login"))
    other.close()


def test_what_is_asked_first_is_in_view_on_a_narrow_and_on_a_wide_screen(
    page: Page, fleet_site: PageProcess
) -> None:
    log_in(page, fleet_site, "bob", "bob's battery staple")
    expect(page.get_by_role("status")).to_contain_text(f"{MACHINES} of {MACHINES}")
    for width, columns in ((360, ("State",)), (1920, ("State", "Program", "Faults"))):
        page.set_viewport_size({"width": width, "height": 800})
        for name in columns:
            header = page.get_by_role("columnheader", name=name, exact=True)
            expect(header).to_be_in_viewport(ratio=0.9)
            box = header.bounding_box()
            assert box is not None
            assert box["x"] + box["width"] <= width
        for name in (
            "Hold selected",
            "Stop selected",
            "Emergency stop of the selected",
            "Emergency stop of all machines",
        ):
            expect(page.get_by_role("button", name=name)).to_be_in_viewport(ratio=0.9)
        expect_no_overflow(page, width)


def test_what_is_looked_for_outlasts_a_lost_link_also_where_it_was_chosen_while_there_was_none(
    page: Page, fleet_site: PageProcess
) -> None:
    log_in(page, fleet_site, "bob", "bob's battery staple")
    row = page.locator(".ag-center-cols-container [role=row]")
    for label, option, count in (("Group", "cell", MACHINES - 5), ("State", "fault", 1)):
        page.get_by_label(label).click()
        page.get_by_role("option", name=option, exact=True).click()
        expect(row).to_have_count(count)
    # as NiceGUI does it when a link is back that has lost something
    page.reload()
    for label, option in (("Group", "cell"), ("State", "fault")):
        expect(page.get_by_label(label)).to_have_value(option)
    expect(row).to_have_count(1)
    page.get_by_label("State").click()
    page.get_by_role("option", name="all states").click()
    expect(row).to_have_count(MACHINES - 5)
    # from here on nothing reaches the page's process
    page.evaluate("window.socket.emit = () => {}")
    page.get_by_label("Search").fill("-1")
    expect(row).to_have_count(10)
    page.reload()
    expect(page.get_by_label("Search")).to_have_value("-1")
    expect(row).to_have_count(10)


def test_a_page_whose_process_is_gone_says_that_what_it_shows_is_old(
    page: Page, fleet: Answering, tmp_path: Path
) -> None:
    with page_of(fleet.endpoint, tmp_path) as mortal:
        page.goto(mortal.url)
        expect(page.get_by_role("status")).to_contain_text(f"{MACHINES} of {MACHINES}")
        expect(page.locator("body.mc-unlinked")).to_have_count(0)
        mortal.process.kill()
        expect(page.locator("body")).to_have_class(re.compile("mc-silent"))
