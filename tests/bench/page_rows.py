"""Whether the fleet's page stays smooth with 1000 machines: frames and long tasks while it is scrolled."""

from __future__ import annotations

import os
from dataclasses import dataclass

from tests.bench.chromium import opened, reached, say
from tests.bench.figures import Figure, NotAvailable, percentile
from tests.bench.page import MACHINES, fleet, page

SCROLL_S = 10.0
LIMIT_MS = 120_000
# moves the table a little at each frame, up and down over all rows, and keeps how long each frame took [ms]
SCROLL = """(lasts_ms) => {
  window.frames_ms = [];
  window.long_ms = [];
  new PerformanceObserver((list) => {
    for (const each of list.getEntries()) window.long_ms.push(each.duration);
  }).observe({ entryTypes: ["longtask"] });
  const table = document.querySelector(".ag-body-viewport");
  const start = performance.now();
  let before = start, step = 40;
  const frame = (now) => {
    window.frames_ms.push(now - before);
    before = now;
    const end = table.scrollHeight - table.clientHeight;
    if (table.scrollTop + step > end || table.scrollTop + step < 0) step = -step;
    table.scrollTop += step;
    if (now - start < lasts_ms) requestAnimationFrame(frame);
    else window.scrolled = true;
  };
  requestAnimationFrame(frame);
}"""


def measure() -> list[Figure]:
    """Frames and long tasks while the table is scrolled; beside it the same with a tenth of the machines."""
    load = Figure("load of this computer before", os.getloadavg()[0], "tasks")
    few, many = _scrolled(MACHINES // 10), _scrolled(MACHINES)
    against = f"{MACHINES // 10} machines"
    found = [load]
    for what, unit, value in (
        ("rows in the document", "", lambda seen: float(seen.rows)),
        ("frames a second while scrolling", "", lambda seen: 1e3 * len(seen.frames_ms) / sum(seen.frames_ms)),
        ("time between frames, p50", "ms", lambda seen: percentile(seen.frames_ms, 0.5)),
        ("time between frames, p99", "ms", lambda seen: percentile(seen.frames_ms, 0.99)),
        ("tasks over 50 ms", f"in {SCROLL_S:g} s", lambda seen: float(len(seen.long_ms))),
        ("longest task", "ms", lambda seen: max(seen.long_ms, default=0.0)),
    ):
        found.append(Figure(what, value(many), unit, value(few), against))
    return found


@dataclass(frozen=True)
class Scrolled:
    """What the browser's own clock said [ms], and how many rows stood in the document."""

    frames_ms: list[float]
    long_ms: list[float]
    rows: int


def _scrolled(machines: int) -> Scrolled:
    say(f"starting {machines} machines and their page")
    with fleet(machines) as endpoint, page(endpoint) as (_, url), opened(url, 1920, 1080) as seen:
        shown = f"document.body.innerText.includes('{machines} of {machines} online')"
        if not reached(seen, shown, LIMIT_MS):
            raise NotAvailable(f"fewer than {machines} machines are seen in the time")
        say("scrolling")
        seen.evaluate(SCROLL, 1e3 * SCROLL_S)
        if not reached(seen, "window.scrolled", LIMIT_MS):
            raise NotAvailable("the table did not come to its end in the time")
        return Scrolled(
            seen.evaluate("window.frames_ms.slice(2)"),
            seen.evaluate("window.long_ms"),
            seen.evaluate("document.querySelectorAll('.ag-center-cols-container [role=row]').length"),
        )
