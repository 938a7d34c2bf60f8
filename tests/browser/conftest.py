"""A motion server, the operator's page of it, and Chromium: each one for all tests of this folder."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from mcclient import sync

from tests.e2e.conftest import served, slower
from tests.e2e.servers import CommandProcess, ServerProcess

HERE = Path(__file__).parent
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
FLAGS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-quic",
    "--enable-unsafe-swiftshader",
    # Debian asks for it; emulating a GPU takes a tenth of the processor time of a page
    "--disable-gpu-rasterization",
]
# generous: the computer may be busy. What ends these tests is that
# something does not come at all, never that it comes late
LIMIT_MS = 100_000
LIMIT_S = 400.0
TRIES = 12
WIDE = {"width": 1920, "height": 1080}

if TYPE_CHECKING:
    from playwright import sync_api as playwright
else:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

if CHROMIUM is None:
    pytest.skip("chromium is not installed", allow_module_level=True)


Browser = playwright.Browser
Locator = playwright.Locator
Page = playwright.Page
WebSocketRoute = playwright.WebSocketRoute
expect = playwright.expect
expect.set_options(timeout=LIMIT_MS)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give each test of this folder the time of the servers and browsers that it may have to start."""
    for item in items:
        if item.path.is_relative_to(HERE):
            item.add_marker(pytest.mark.timeout(LIMIT_S))


class PageProcess:
    """``mcserver web`` as a process of its own."""

    def __init__(self, endpoint: str, folder: Path, *options: str) -> None:
        folders = ("--programs", str(folder))
        command = CommandProcess("web", "--port", "0", "--connect", endpoint, *folders, *options)
        self.process, self.url, self.close = command.process, command.url, command.close


# a motion server of a machine
serving = contextmanager(served)


@contextmanager
def page_of(endpoint: str, folder: Path, *options: str) -> Iterator[PageProcess]:
    """The operator's page of what answers at an endpoint."""
    made = PageProcess(endpoint, folder, *options)
    try:
        yield made
    finally:
        made.close()


@pytest.fixture(scope="package")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    folder = tmp_path_factory.mktemp("server")
    # test_cards has a machine at 1 kHz
    with serving(folder, slower(folder, "cartesian"), "bench", recorder=True) as made:
        yield made


@pytest.fixture(scope="package")
def site(server: ServerProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[PageProcess]:
    with page_of(server.endpoint, tmp_path_factory.mktemp("programs")) as made:
        yield made


# not longer than this folder: while it is open, no other loop can run in this thread
@pytest.fixture(scope="package")
def browser() -> Iterator[playwright.Browser]:
    with playwright.sync_playwright() as driver:
        made = driver.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield made
        made.close()


@pytest.fixture(scope="module")
def context(browser: playwright.Browser) -> Iterator[playwright.BrowserContext]:
    """One profile for all tests of a module: what the browser has loaded once, it need not load again."""
    made = browser.new_context(viewport=WIDE)
    made.set_default_timeout(LIMIT_MS)
    yield made
    made.close()


@pytest.fixture(scope="module")
def tab(context: playwright.BrowserContext) -> playwright.Page:
    """One tab for all tests of a module, which begin where they want to be with `opened`."""
    return context.new_page()


@pytest.fixture
def page(tab: playwright.Page, request: pytest.FixtureRequest) -> Iterator[playwright.Page]:
    yield tab
    if os.environ.get("SCREENSHOTS"):
        tab.screenshot(path=f"{os.environ['SCREENSHOTS']}/{request.node.name}.png", full_page=True)
    # as the next test expects it, whatever this one has left
    tab.mouse.up()
    tab.context.set_offline(False)
    tab.set_viewport_size(WIDE)


def opened(
    page: playwright.Page, site: PageProcess, name: str = "bench", *, state: str = "ready"
) -> playwright.Page:
    """The page of a machine, in that state; loaded anew only where another page, or a dialog, is open."""
    url = f"{site.url}machine/{name}"
    if page.url != url or page.locator(".q-dialog").count():
        page.goto(url)
    playwright.expect(page.locator("body.mc-unlinked")).to_have_count(0)
    playwright.expect(page.get_by_role("status")).to_have_text(state)
    playwright.expect(page.locator("[data-jog]").first).to_be_visible()
    return page


def expect_no_overflow(page: playwright.Page, width: int) -> None:
    """Wait until all fits the window's width: charts and pictures follow a new one when they are drawn."""
    page.wait_for_function(
        "(width) => innerWidth === width && document.documentElement.scrollWidth <= width", arg=width
    )


def press(button: playwright.Locator) -> None:
    """Press a button by the keyboard once it may be pressed: Playwright itself waits before clicks alone."""
    playwright.expect(button).to_be_enabled()
    button.press("Enter")


def choose(page: playwright.Page, field: playwright.Locator, name: str) -> None:
    """Take an option of a list; it closes where the page is laid out anew meanwhile, and is opened again."""
    option = page.get_by_role("option", name=name, exact=True)
    for _ in range(TRIES):
        field.click()
        try:
            option.click(timeout=LIMIT_MS / TRIES)
        except playwright.TimeoutError:
            continue
        return
    raise AssertionError(f"{name} was not offered")


@pytest.fixture
def machine(server: ServerProcess) -> Iterator[sync.Machine]:
    """The server as another client sees it, without latched faults before and after."""
    with sync.Machine.connect("bench", server.endpoint) as made:
        yield made
        made.abort()
        while made.programs(ended=False):
            pass
        made.reset()
        made.override(100.0)
