"""An operator before the page: by the mouse, a finger or the keyboard alone, in a window of some width."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from contextlib import contextmanager

from tests.browser.conftest import LIMIT_MS, Browser, Locator, Page, playwright

# the least side of what is pressed [px]: WCAG 2.2, 2.5.8
LEAST_TARGET = 24
MOST_TABS = 400
# Quasar's lists take the next key once they are drawn
MOST_OPTIONS = 60
# What is pressed, of which the element found may be a part, and how it lies in the window.
PLACE = """(element) => {
  const parts = "button, a, [role=option], [role=checkbox], [role=switch], .q-field, .q-uploader__header";
  const whole = element.closest(parts) ?? element;
  const { left, right, top, bottom } = whole.getBoundingClientRect();
  return { left, right, width: right - left, height: bottom - top, window: innerWidth };
}"""
# Where the focus is beside an element: 0: at it; 1: it comes later in the document; -1: it comes before.
FOCUS = """(element) => {
  const at = document.activeElement, parts = "button, a, label, .q-uploader__header";
  if (element === at || element.contains(at) || (at.matches(parts) && at.contains(element))) return 0;
  return at.compareDocumentPosition(element) & Node.DOCUMENT_POSITION_PRECEDING ? -1 : 1;
}"""
# Whether the focus is in the dialog of an element that is in one.
IN_DIALOG = """(element) => {
  const dialog = element.closest(".q-dialog");
  return !dialog || dialog.contains(document.activeElement);
}"""
# Whether who has the focus sees it: in the window, below nothing else, with a mark.
SEEN = """() => {
  const at = document.activeElement, box = at.getBoundingClientRect();
  const inside = box.bottom > 0 && box.top < innerHeight && box.right > 0 && box.left < innerWidth;
  const x = Math.min(Math.max(box.left + box.width / 2, 0), innerWidth - 1);
  const y = Math.min(Math.max(box.top + box.height / 2, 0), innerHeight - 1);
  const over = document.elementFromPoint(x, y);
  const near = at.closest(".q-field, .q-uploader__header") ?? at;
  const free = !inside || !over || near.contains(over) || over.contains(at);
  return { inside, over: free ? "" : over.outerHTML.slice(0, 120) };
}"""


class Way(enum.Enum):
    """By what somebody operates the page."""

    MOUSE = "mouse"
    TOUCH = "touch"
    KEYBOARD = "keyboard"


class OutOfReach(AssertionError):
    """What has to be pressed is too small, not in the window, covered, or not to be had by the keyboard."""


def seat(browser: Browser, way: Way, width: int, height: int) -> Page:
    """Return a tab in a profile of its own, of a window or device of that size."""
    context = browser.new_context(
        viewport={"width": width, "height": height},
        has_touch=way is Way.TOUCH,
        is_mobile=way is Way.TOUCH and width < 1000,
    )
    context.set_default_timeout(LIMIT_MS)
    return context.new_page()


class Operator:
    """Somebody before the page.

    Attributes:
        page: before whom. way: by what.
    """

    def __init__(self, page: Page, way: Way) -> None:
        self.page, self.way = page, way

    def click(self, where: Locator) -> None:
        """Press what has been found, once it may be pressed."""
        target = where.first
        playwright.expect(target).to_be_enabled()
        if self.way is Way.KEYBOARD:
            if target.get_attribute("role") == "option":
                self._go_to_option(target)
            else:
                self.tab_to(target)
            self.page.keyboard.press("Enter")
            return
        target.scroll_into_view_if_needed()
        self._judge(target)
        if self.way is Way.TOUCH:
            target.tap()
        else:
            target.click()

    def fill(self, where: Locator, value: str) -> None:
        """Type a text into a field in the place of what is there."""
        target = where.first
        if self.way is Way.KEYBOARD:
            self.tab_to(target)
            self.page.keyboard.press("Control+A")
            self.page.keyboard.type(value)
        else:
            self.click(target)
            target.fill(value)

    def turn(self, where: Locator) -> None:
        """Turn a switch over, or tick a box."""
        if self.way is Way.KEYBOARD:
            self.tab_to(where.first)
            self.page.keyboard.press(" ")
        else:
            self.click(where)

    def tab_to(self, target: Locator) -> None:
        """Go to an element by Tab or Shift+Tab.

        Raises:
            OutOfReach: no number of them leads there, or who is there cannot see it.
        """
        # a dialog that opens takes the focus to its safe button
        self.page.wait_for_function(IN_DIALOG, arg=target.element_handle())
        for _ in range(MOST_TABS):
            side = target.evaluate(FOCUS)
            # what has come above it meanwhile may have moved it away: then there once more
            if side == 0 and self.page.evaluate(SEEN)["inside"]:
                break
            self.page.keyboard.press("Tab" if side > 0 else "Shift+Tab")
        else:
            raise OutOfReach(f"no way by Tab to {target}")
        # messages, and lists that close, pass by themselves
        seen = f"() => {{ const seen = ({SEEN})(); return seen.inside && !seen.over; }}"
        try:
            self.page.wait_for_function(seen)
        except playwright.TimeoutError as error:
            raise OutOfReach(f"the focus is not seen at {target}: {self.page.evaluate(SEEN)}") from error

    @contextmanager
    def held(self, where: Locator) -> Iterator[None]:
        """Hold a button down."""
        target = where.first
        if self.way is Way.KEYBOARD:
            self.tab_to(target)
            self.page.keyboard.down(" ")
            yield
            self.page.keyboard.up(" ")
            return
        target.scroll_into_view_if_needed()
        self._judge(target)
        box = target.bounding_box()
        assert box is not None
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        if self.way is Way.TOUCH:
            session = self.page.context.new_cdp_session(self.page)
            session.send(
                "Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]}
            )
            yield
            session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
            session.detach()
        else:
            self.page.mouse.move(x, y)
            self.page.mouse.down()
            yield
            self.page.mouse.up()

    def _go_to_option(self, option: Locator) -> None:
        """Go to an entry of the list that is open by the arrow keys."""
        wanted = option.inner_text().strip()
        at = self.page.locator(".q-manual-focusable--focused")
        for _ in range(MOST_OPTIONS):
            if at.count() and at.first.inner_text().strip() == wanted:
                return
            self.page.keyboard.press("ArrowDown")
        raise OutOfReach(f"no way by the arrow keys to {wanted}")

    def _judge(self, target: Locator) -> None:
        """Raise `OutOfReach` where what is to be pressed is too small, or not all of it in the window."""
        place = target.evaluate(PLACE)
        if min(place["width"], place["height"]) < LEAST_TARGET:
            raise OutOfReach(f"{place['width']:.0f} x {place['height']:.0f} px: {target}")
        if place["left"] < -0.5 or place["right"] > place["window"] + 0.5:
            raise OutOfReach(f"not within {place['window']} px: {place}: {target}")
