"""The page in the languages of its catalogues: asked for by the browser, or chosen; at all widths."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest

from tests.browser.conftest import LIMIT_MS, WIDE, Browser, Page, PageProcess, expect, opened, playwright

WIDTHS = (360, 768, 1920)
# what is wider than the page, or has more text than room for it
TOO_WIDE = """() => {
  const wide = document.documentElement.clientWidth;
  const words = [...document.querySelectorAll(".q-btn, .q-field__label, .mc-state, h2")];
  const cut = words.filter((each) => each.clientWidth && each.scrollWidth > each.clientWidth + 1);
  const parts = [...document.querySelectorAll("header *, .mc-place > *")];
  const boxes = parts.map((each) => each.getBoundingClientRect());
  return [
    ...cut.map((each) => each.textContent),
    ...(document.documentElement.scrollWidth > wide ? ["the page"] : []),
    ...(boxes.some((box) => box.width && (box.right > wide + 1 || box.left < -1)) ? ["a card"] : []),
  ];
}"""


def fits(page: Page) -> None:
    for width in WIDTHS:
        page.set_viewport_size({**WIDE, "width": width})
        # charts and the picture follow a new width when they are drawn
        with contextlib.suppress(playwright.TimeoutError):
            page.wait_for_function(f"innerWidth === {width} && ({TOO_WIDE})().length === 0")
        assert page.evaluate(TOO_WIDE) == [], width


@pytest.fixture
def german(browser: Browser) -> Iterator[Page]:
    context = browser.new_context(viewport=WIDE, locale="de-AT")
    context.set_default_timeout(LIMIT_MS)
    yield context.new_page()
    context.close()


def test_each_reads_the_page_in_a_language_of_their_own(german: Page, page: Page, site: PageProcess) -> None:
    opened(german, site, state="bereit")
    opened(page, site)
    expect(german.locator("html")).to_have_attribute("lang", "de")
    expect(german.get_by_role("button", name="Not-Halt")).to_have_text("NOT-HALT")
    # what is made once for all who look is made once for each language
    expect(german.locator(".mc-people")).to_contain_text("Auf dieser Seite:")
    expect(page.locator(".mc-people")).to_contain_text("At this page:")
    german.get_by_role("button", name="Simulieren").click()
    expect(german.get_by_text("Kein Programm gewählt — eines wählen oder hochladen")).to_be_visible()
    fits(german)


def test_a_language_that_was_chosen_stays_and_does_not_change_what_moves(
    german: Page, site: PageProcess
) -> None:
    opened(german, site, state="bereit")
    german.get_by_role("button", name="Menü").click()
    german.get_by_role("menuitem", name="中文").click()
    expect(german.locator("html")).to_have_attribute("lang", "zh-CN")
    opened(german, site, state="就绪")
    fits(german)
    german.get_by_label("点动轴 X 正向").press("Enter")
    expect(german.get_by_text("您拥有控制权")).to_be_visible()
    again = german.context.new_page()
    again.goto(site.url)
    expect(again.get_by_role("button", name="所有机床急停")).to_be_visible()
    expect(again.get_by_role("columnheader", name="剩余时间")).to_be_visible()
