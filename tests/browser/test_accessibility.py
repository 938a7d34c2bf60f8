"""axe looks at a page in use: what is open, what was said, held, stopped; light and dark, wide and narrow."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest
from mcclient import sync

from tests.browser.conftest import LIMIT_MS, TRIES, WIDE, Page, PageProcess, expect, opened
from tests.browser.test_machine_page import OUTLASTING, upload

axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe is not installed")
# what fades in or out has no contrast of its own: what is still found after so many looks stays
LOOKS = 6
LOOK_MS = 500


def nothing_serious(page: Page, where: str) -> None:
    """Fail with what axe finds, and goes on finding."""
    for _ in range(LOOKS):
        found = [
            (each["id"], [node["html"][:200] for node in each["nodes"][:3]])
            for each in axe.Axe().run(page, options={"resultTypes": ["violations"]}).response["violations"]
            if each["impact"] in ("serious", "critical")
        ]
        if not found:
            return
        page.wait_for_timeout(LOOK_MS)
    raise AssertionError(f"{where}: {found}")


def use(page: Page) -> None:
    """Upload a program, and type a line that is refused; once more where a busy browser had lost its link,
    and the page was built anew.
    """
    field = page.get_by_label("G-code line")
    for _ in range(TRIES):
        upload(page, "used.gcode", OUTLASTING)
        field.fill("G02 X100 Y0 R1")
        field.press("Enter")
        refused = page.get_by_text(re.compile(r"\^+ .*\[MC104\]")).first
        try:
            expect(refused).to_be_visible(timeout=LIMIT_MS / TRIES)
        except AssertionError:
            continue
        return
    raise AssertionError("no line is refused")


def held(page: Page) -> None:
    """Hold what runs; once more where a busy browser had lost its link, and the page was built anew."""
    for _ in range(TRIES):
        page.get_by_role("button", name="Hold", exact=True).click()
        try:
            expect(page.get_by_role("status")).to_have_text("held", timeout=LIMIT_MS / TRIES)
        except AssertionError:
            continue
        return
    raise AssertionError("nothing is held")


LOOKS_OF_A_PAGE = ((1920, "light"), (360, "dark"))


def nothing_serious_as_worn(page: Page, where: str) -> None:
    """Look at one state wide and light, then narrow and dark."""
    for width, scheme in LOOKS_OF_A_PAGE:
        page.set_viewport_size({**WIDE, "width": width})
        page.emulate_media(color_scheme=scheme)
        nothing_serious(page, f"{where}, {width} px, {scheme}")


@pytest.fixture
def worn(page: Page) -> Iterator[Page]:
    yield page
    page.emulate_media(color_scheme="light")


def test_a_page_in_use_has_no_serious_findings(worn: Page, site: PageProcess, machine: sync.Machine) -> None:
    page = opened(worn, site)
    for waiting in page.get_by_role("button", name=re.compile("from the queue$")).all():
        waiting.click()
    use(page)
    page.get_by_text("Drives", exact=True).click()
    page.get_by_role("button", name="Save black box").click()
    for _ in range(2):
        page.get_by_role("button", name="Run", exact=True).first.click()
    expect(page.get_by_role("button", name="remove used.gcode from the queue")).to_be_visible()
    expect(page.get_by_role("link", name=re.compile("^plot ")).first).to_be_visible()
    nothing_serious_as_worn(page, "running, another waits, a line was refused")
    held(page)
    page.get_by_label("Distance").click()
    expect(page.get_by_role("option", name="while held")).to_be_visible()
    nothing_serious_as_worn(page, "held, a list is open")
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Menu").click()
    expect(page.get_by_role("menuitem", name="Dark")).to_be_visible()
    nothing_serious_as_worn(page, "the menu is open")
    page.keyboard.press("Escape")
    page.get_by_role("button", name="Dry run").click()
    expect(page.get_by_role("button", name="Run it")).to_be_visible()
    nothing_serious_as_worn(page, "a dry run is shown")
    page.get_by_role("dialog").get_by_role("button", name="Close").click()
    page.locator("[data-estop]").click()
    expect(page.locator(".mc-state")).to_have_text("EMERGENCY STOP")
    nothing_serious_as_worn(page, "stopped")
    assert machine.status().state == "estop"
