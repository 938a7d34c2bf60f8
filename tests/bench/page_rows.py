"""Whether the fleet's page stays smooth with 1000 machines: what scrolling costs, and what is seen.

How many frames a second there are depends on how fast this computer draws; what does not is how much the page
computes, how large its document is, and whether a row is missing where one should be.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tests.bench.chromium import opened, reached, say
from tests.bench.figures import Figure, NotAvailable, percentile
from tests.bench.page import MACHINES, fleet, page

if TYPE_CHECKING:
    from playwright.sync_api import Page

SCROLL_S = 10.0
REST_MS = 5_000
LIMIT_MS = 120_000
# Processor time of the browser's main thread since the page was opened [s], by what it was spent on.
SPENT = ("ScriptDuration", "LayoutDuration", "RecalcStyleDuration")
# moves the table a little at each frame, up and down over all rows; keeps how long each frame took [ms],
# and of every tenth how much of the table is without a row [px]
SCROLL = """(lasts_ms) => {
  window.frames_ms = [];
  window.long_ms = [];
  window.blank_px = [];
  new PerformanceObserver((list) => {
    for (const each of list.getEntries()) window.long_ms.push(each.duration);
  }).observe({ entryTypes: ["longtask"] });
  const table = document.querySelector(".ag-body-viewport");
  const start = performance.now();
  let before = start, step = 40;
  const blank = () => {
    const view = table.getBoundingClientRect();
    let rest = view.height;
    for (const row of document.querySelectorAll(".ag-center-cols-container [role=row]")) {
      const box = row.getBoundingClientRect();
      rest -= Math.max(0, Math.min(box.bottom, view.bottom) - Math.max(box.top, view.top));
    }
    return Math.max(0, rest);
  };
  const frame = (now) => {
    window.frames_ms.push(now - before);
    before = now;
    if (window.frames_ms.length % 10 === 0) window.blank_px.push(blank());
    const end = table.scrollHeight - table.clientHeight;
    if (table.scrollTop + step > end || table.scrollTop + step < 0) step = -step;
    table.scrollTop += step;
    if (now - start < lasts_ms) requestAnimationFrame(frame);
    else window.scrolled = true;
  };
  requestAnimationFrame(frame);
}"""


@dataclass(frozen=True)
class Scrolled:
    """What the browser's clock said [ms], what the page computed [% of a core], and what it holds."""

    frames_ms: list[float]
    long_ms: list[float]
    blank_px: list[float]
    rows: int
    elements: int
    scrolling: float
    at_rest: float


FIGURES: tuple[tuple[str, str, Callable[[Scrolled], float]], ...] = (
    ("elements in the document", "", lambda seen: float(seen.elements)),
    ("rows in the document", "", lambda seen: float(seen.rows)),
    ("computing at rest (scripts, styles, layout)", "% of a core", lambda seen: seen.at_rest),
    ("computing while scrolling", "% of a core", lambda seen: seen.scrolling),
    (
        "computing a frame",
        "ms",
        lambda seen: 0.01 * seen.scrolling * sum(seen.frames_ms) / len(seen.frames_ms),
    ),
    ("table without rows while scrolling, worst", "px", lambda seen: max(seen.blank_px, default=0.0)),
    ("frames a second while scrolling", "", lambda seen: 1e3 * len(seen.frames_ms) / sum(seen.frames_ms)),
    ("time between frames, p50", "ms", lambda seen: percentile(seen.frames_ms, 0.5)),
    ("time between frames, p99", "ms", lambda seen: percentile(seen.frames_ms, 0.99)),
    ("tasks over 50 ms", f"in {SCROLL_S:g} s", lambda seen: float(len(seen.long_ms))),
    ("longest task", "ms", lambda seen: max(seen.long_ms, default=0.0)),
)


def measure() -> list[Figure]:
    """What the table costs while it is scrolled; beside it the same with a tenth of the machines."""
    load = Figure("load of this computer before", os.getloadavg()[0], "tasks")
    few, many = _scrolled(MACHINES // 10), _scrolled(MACHINES)
    against = f"{MACHINES // 10} machines"
    return [load, *(Figure(what, value(many), unit, value(few), against) for what, unit, value in FIGURES)]


def _scrolled(machines: int) -> Scrolled:
    say(f"starting {machines} machines and their page")
    with fleet(machines) as endpoint, page(endpoint) as (_, url), opened(url, 1920, 1080) as seen:
        shown = f"document.body.innerText.includes('{machines} of {machines} online')"
        if not reached(seen, shown, LIMIT_MS):
            raise NotAvailable(f"fewer than {machines} machines are seen in the time")
        clock = Clock(seen)
        clock.share()
        seen.wait_for_timeout(REST_MS)
        at_rest = clock.share()
        say("scrolling")
        seen.evaluate(SCROLL, 1e3 * SCROLL_S)
        if not reached(seen, "window.scrolled", LIMIT_MS):
            raise NotAvailable("the table did not come to its end in the time")
        return Scrolled(
            seen.evaluate("window.frames_ms.slice(2)"),
            seen.evaluate("window.long_ms"),
            seen.evaluate("window.blank_px"),
            seen.evaluate("document.querySelectorAll('.ag-center-cols-container [role=row]').length"),
            seen.evaluate("document.querySelectorAll('*').length"),
            clock.share(),
            at_rest,
        )


class Clock:
    """What a page's thread has computed, by Chromium's own account of it."""

    def __init__(self, page: Page) -> None:
        self._session = page.context.new_cdp_session(page)
        # processor time of the thread, not of the clock on the wall, which others' work makes longer
        self._session.send("Performance.enable", {"timeDomain": "threadTicks"})
        self._before: dict[str, float] = {}
        self._since = time.perf_counter()

    def share(self) -> float:
        """Percent of the time since the call before that went into scripts, styles and layout."""
        answer = self._session.send("Performance.getMetrics")
        now = {each["name"]: float(each["value"]) for each in answer["metrics"]}
        before, self._before = self._before or now, now
        since, self._since = self._since, time.perf_counter()
        return 100.0 * sum(now[each] - before[each] for each in SPENT) / (self._since - since)
