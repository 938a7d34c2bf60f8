"""How old is what the operator's page shows: from the moment at which an axis was at a position to a frame in
Chromium in which the page shows that position, while others look at it, too.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Sequence

from mcclient import sync

from tests.bench.chromium import opened, reached, say
from tests.bench.figures import Figure, NotAvailable, percentile
from tests.bench.page import moving, page, viewers
from tests.bench.server import server

FRAMES = 300
# beside the browser
VIEWERS = 9
ROUNDS = 10
# a browser that draws by software on a busy computer gives a frame now and then: so many are enough
FEWEST = 100
LOOK_LIMIT_MS = 60_000
# the position as shown, and the wall clock, at frames some time apart; kept in the page, so that what was
# seen counts even where the time is over
LOOK = """(count) => {
  window.seen = [];
  const look = () => {
    const cell = document.querySelector('.mc-positions td.n');
    if (cell) window.seen.push([parseFloat(cell.textContent), Date.now() / 1000]);
    if (window.seen.length < count) setTimeout(() => requestAnimationFrame(look), 40 * Math.random());
  };
  requestAnimationFrame(look);
}"""

Passed = list[tuple[float, float]]


def measure() -> list[Figure]:
    """The age at frames some time apart, while two axes move."""
    say("starting a server and its page")
    with (
        server() as served,
        sync.Machine.connect("bench", served.endpoint) as machine,
        page(served.endpoint) as (_, url),
        moving(machine),
        viewers(f"{url}machine/bench", VIEWERS),
    ):
        return _age(machine, f"{url}machine/bench")


def _age(machine: sync.Machine, url: str) -> list[Figure]:
    """Age of the position that is seen in Chromium."""
    load = Figure("load of this computer before", os.getloadavg()[0], "tasks")
    passed: Passed = []
    ended = threading.Event()

    def follow() -> None:
        for status in machine.telemetry():
            passed.append((status.wall, status.axes.position[0]))
            if ended.is_set():
                return

    # a server that falls silent must not keep this process
    follower = threading.Thread(target=follow, daemon=True)
    follower.start()
    try:
        frames = _frames(url)
    finally:
        ended.set()
        follower.join(10.0)
    known = list(passed)
    ages = [age for position, at in frames if (age := age_of(position, at, known)) is not None]
    if len(ages) < FEWEST:
        raise NotAvailable(f"of {len(frames)} frames {len(ages)} show where the axis was: too few")
    return [
        load,
        Figure("frames", len(ages), ""),
        *(
            Figure(f"age of the position seen, p{round(100 * share)}", 1e3 * percentile(ages, share), "ms")
            for share in (0.5, 0.99)
        ),
    ]


def _frames(url: str) -> Passed:
    """Position seen, and the wall clock [s], at the frames of a page that was opened for it."""
    frames: Passed = []
    with opened(url) as seen:
        seen.locator("[data-jog]").first.wait_for()
        seen.wait_for_timeout(3000)
        for _ in range(ROUNDS):
            seen.evaluate(LOOK, FRAMES // ROUNDS)
            reached(seen, f"window.seen?.length >= {FRAMES // ROUNDS}", LOOK_LIMIT_MS / ROUNDS)
            # a page that was built anew after a lost link begins again: it costs one round
            frames += [(at, when) for at, when in seen.evaluate("window.seen ?? []")]
            say(f"{len(frames)} of {FRAMES} frames")
    return frames


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
