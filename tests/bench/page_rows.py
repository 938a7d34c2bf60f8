"""Whether the fleet's page stays smooth with 1000 machines: frames and long tasks while it is scrolled."""

from __future__ import annotations

import os

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
    """Frames and long tasks while the table is scrolled."""
    say(f"starting {MACHINES} machines and their page")
    load = Figure("load of this computer before", os.getloadavg()[0], "tasks")
    with fleet() as endpoint, page(endpoint) as (_, url), opened(url, 1920, 1080) as seen:
        if not reached(
            seen, f"document.body.innerText.includes('{MACHINES} of {MACHINES} online')", LIMIT_MS
        ):
            raise NotAvailable(f"fewer than {MACHINES} machines are seen in the time")
        say("scrolling")
        seen.evaluate(SCROLL, 1e3 * SCROLL_S)
        if not reached(seen, "window.scrolled", LIMIT_MS):
            raise NotAvailable("the table did not come to its end in the time")
        frames: list[float] = seen.evaluate("window.frames_ms.slice(2)")
        long_tasks: list[float] = seen.evaluate("window.long_ms")
        drawn = seen.evaluate("document.querySelectorAll('.ag-center-cols-container [role=row]').length")
    return [
        load,
        Figure("rows in the document", drawn, "", MACHINES, "machines"),
        Figure("frames a second while scrolling", 1e3 * len(frames) / sum(frames), "", 60.0, "the screen"),
        *(
            Figure(f"time between frames, p{round(100 * share)}", percentile(frames, share), "ms")
            for share in (0.5, 0.99)
        ),
        Figure("tasks over 50 ms", len(long_tasks), f"in {SCROLL_S:g} s"),
        Figure("longest task", max(long_tasks, default=0.0), "ms"),
    ]
