"""Chromium, for what only a browser can say: opened within a time, and never waited for without end."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tests.bench.figures import NotAvailable

if TYPE_CHECKING:
    from playwright.sync_api import Page

OPEN_LIMIT_MS = 120_000
FLAGS = ["--no-sandbox", "--enable-unsafe-swiftshader"]


@contextmanager
def opened(url: str, width: int = 1280, height: int = 900) -> Iterator[Page]:
    """A page in a browser of its own.

    Raises:
        NotAvailable: there is no browser, or the page did not come or stay.
    """
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        raise NotAvailable("playwright is not installed") from error
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise NotAvailable("chromium is not installed")
    with sync_playwright() as driver:
        try:
            browser = driver.chromium.launch(executable_path=chromium, args=FLAGS, timeout=OPEN_LIMIT_MS)
            try:
                say("opening the page")
                page = browser.new_page(viewport={"width": width, "height": height})
                page.set_default_timeout(OPEN_LIMIT_MS)
                page.goto(url)
                yield page
            finally:
                browser.close()
        except Error as error:
            raise NotAvailable(f"the page did not come or stay: {error.message}") from error


def reached(page: Page, condition: str, limit_ms: float) -> bool:
    """Wait until an expression is true in the page; whether it came to that in the time."""
    from playwright.sync_api import TimeoutError

    try:
        page.wait_for_function(condition, timeout=limit_ms)
    except TimeoutError:
        return False
    return True


def say(what: str) -> None:
    """Show progress: a section may take minutes on a busy computer."""
    print(f"  {what}", file=sys.stderr, flush=True)
