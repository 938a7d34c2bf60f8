"""Fingers on the page: a jog for as long as one is down; what is tapped is `test_ways`."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from mcclient import sync

from tests.browser.conftest import LIMIT_MS, TRIES, WIDE, Browser, Page, PageProcess, expect, opened
from tests.browser.test_machine_page import LOOK_MS, at_rest, wait_for


@pytest.fixture(scope="module")
def touched(browser: Browser) -> Iterator[Page]:
    """A tab of a device that is touched."""
    context = browser.new_context(viewport=WIDE, has_touch=True)
    context.set_default_timeout(LIMIT_MS)
    yield context.new_page()
    context.close()


class Finger:
    """One finger on a page, which can stay down."""

    def __init__(self, page: Page) -> None:
        self._session = page.context.new_cdp_session(page)

    def __enter__(self) -> Finger:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.detach()

    def down(self, x: float, y: float) -> None:
        self._touch("touchStart", x, y)

    def slide(self, x: float, y: float) -> None:
        self._touch("touchMove", x, y)

    def up(self) -> None:
        self._session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    def _touch(self, kind: str, x: float, y: float) -> None:
        self._session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y}]})


def middle_of(page: Page, button: str) -> tuple[float, float]:
    """Return where a button's middle is, once it is in view."""
    found = page.get_by_role("button", name=button)
    found.scroll_into_view_if_needed()
    box = found.bounding_box()
    assert box is not None
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def hold_until_it_moves(page: Page, finger: Finger, machine: sync.Machine, axis: int, button: str) -> None:
    """Keep a finger down until the axis has gone 2 mm; again where the dead man of a busy computer let go."""
    start = machine.status().axes.position[axis]
    for _ in range(TRIES):
        finger.down(*middle_of(page, button))
        for _ in range(50):
            if abs(machine.status().axes.position[axis] - start) > 2.0:
                return
            page.wait_for_timeout(LOOK_MS)
        finger.up()
    raise AssertionError(f"not moved: {machine.status()}")


@pytest.mark.parametrize("width", [360, WIDE["width"]])
def test_a_finger_moves_an_axis_for_as_long_as_it_is_down(
    touched: Page, site: PageProcess, machine: sync.Machine, width: int
) -> None:
    touched.set_viewport_size({"width": width, "height": 800})
    opened(touched, site)
    with Finger(touched) as finger:
        hold_until_it_moves(touched, finger, machine, 1, "jog axis Y plus")
        finger.up()
        rest = wait_for(machine, touched, at_rest).axes.position[1]
    # several keep-alives' time
    touched.wait_for_timeout(500)
    assert machine.status().axes.position[1] == pytest.approx(rest, abs=0.1)


def test_a_finger_that_leaves_the_button_stops_the_axis(
    touched: Page, site: PageProcess, machine: sync.Machine
) -> None:
    touched.set_viewport_size({"width": 360, "height": 800})
    opened(touched, site)
    with Finger(touched) as finger:
        hold_until_it_moves(touched, finger, machine, 1, "jog axis Y minus")
        x, y = middle_of(touched, "jog axis Y minus")
        finger.slide(x, y + 120.0)
        expect(touched.locator(".held")).to_have_count(0)
        wait_for(machine, touched, at_rest)
        finger.up()
