"""The server's sign of life to the executor."""

from __future__ import annotations

import asyncio
import time

from mcserver.service.heartbeat import PLANNER_LIMIT_S, Heartbeat

LIMIT_S = 5.0


class Beats:
    """Counts beats, and tells when the next ones have come."""

    def __init__(self) -> None:
        self.count = 0
        self._loop = asyncio.get_running_loop()
        self._news = asyncio.Event()

    def __call__(self) -> None:
        self.count += 1
        self._loop.call_soon_threadsafe(self._news.set)

    async def next(self, limit_s: float) -> bool:
        """Whether a beat comes within a time."""
        self._news.clear()
        try:
            await asyncio.wait_for(self._news.wait(), limit_s)
        except TimeoutError:
            return False
        return True


async def test_it_beats_while_the_loop_and_the_planner_live() -> None:
    beats = Beats()
    heartbeat = Heartbeat(beats, time.monotonic)
    heartbeat.start()
    assert await beats.next(LIMIT_S)
    assert await beats.next(LIMIT_S)
    heartbeat.stop()


async def test_it_stays_out_when_the_planner_hangs() -> None:
    beats = Beats()
    hung_since = time.monotonic() - PLANNER_LIMIT_S - 1.0
    heartbeat = Heartbeat(beats, lambda: hung_since)
    heartbeat.start()
    assert not await beats.next(0.2)
    heartbeat.stop()
