"""How old is what the operator's page shows: from the moment at which an axis was at a position to a frame in
Chromium in which the page shows that position.
"""

from __future__ import annotations

import shutil
import threading
from collections.abc import Sequence

from mcclient import sync

from tests.bench.figures import Figure, NotAvailable, percentile
from tests.bench.page import moving, page
from tests.bench.server import server

FRAMES = 300
ATTEMPTS = 3
# the position as shown, and the wall clock, at frames some time apart
LOOK = """async (count) => {
  const found = [];
  while (found.length < count) {
    await new Promise((done) => setTimeout(done, 40 * Math.random()));
    await new Promise(requestAnimationFrame);
    const cell = document.querySelector('.mc-positions td.n');
    found.push([parseFloat(cell.textContent), Date.now() / 1000]);
  }
  return found;
}"""

Passed = list[tuple[float, float]]


def measure() -> list[Figure]:
    """The age at frames some time apart, while two axes move."""
    with (
        server() as reached,
        sync.Machine.connect("bench", reached.endpoint) as machine,
        page(reached.endpoint) as (_, url),
        moving(machine),
    ):
        return _age(machine, f"{url}machine/bench")


def _age(machine: sync.Machine, url: str) -> list[Figure]:
    """Age of the position that is seen in Chromium."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        raise NotAvailable("playwright is not installed") from error
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        raise NotAvailable("chromium is not installed")
    passed: Passed = []
    ended = threading.Event()

    def follow() -> None:
        for status in machine.telemetry():
            passed.append((status.wall, status.axes.position[0]))
            if ended.is_set():
                return

    follower = threading.Thread(target=follow)
    follower.start()
    try:
        with sync_playwright() as driver:
            flags = ["--no-sandbox", "--enable-unsafe-swiftshader"]
            browser = driver.chromium.launch(executable_path=chromium, args=flags)
            seen = browser.new_page(viewport={"width": 1280, "height": 900})
            seen.goto(url)
            seen.locator("[data-jog]").first.wait_for()
            seen.wait_for_timeout(3000)
            for attempt in range(ATTEMPTS):
                try:
                    frames = seen.evaluate(LOOK, FRAMES)
                    break
                except Error as error:
                    # a page that has lost its process for a while is loaded anew by itself
                    if attempt == ATTEMPTS - 1:
                        raise NotAvailable(f"the page did not stay: {error.message}") from error
                    seen.wait_for_timeout(3000)
            browser.close()
    finally:
        ended.set()
        follower.join(10.0)
    ages = [age for position, at in frames if (age := age_of(position, at, passed)) is not None]
    if len(ages) < FRAMES // 2:
        raise NotAvailable("the axis stood while the page was looked at")
    return [
        Figure(f"age of the position seen, p{round(100 * share)}", 1e3 * percentile(ages, share), "ms")
        for share in (0.5, 0.99)
    ]


def age_of(position: float, at: float, passed: Sequence[tuple[float, float]]) -> float | None:
    """Seconds since an axis was last at a position before ``at``; None where it was not of late.

    Args:
        passed: wall clock [s] and position of the axis, in order.
    """
    for (before, start), (after, end) in zip(reversed(passed[:-1]), reversed(passed[1:]), strict=True):
        if before > at or start == end:
            continue
        share = (position - start) / (end - start)
        # the page shows thousandths
        if -0.001 <= share <= 1.001:
            return at - (before + share * (after - before))
    return None
