"""What the folder of ``mcserver history`` says about machines, for the page."""

from __future__ import annotations

import asyncio
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from mcclient import MotionError
from mcclient.cli.history import QUESTIONS, SPANS, ask, days_of
from mcclient.errors import RequestRefused

from mcserver.web.translation import mark

# of one core beside motion servers
THREADS = 1
WHATS = (
    *("programs", "runs by program", "runs by day", "faults", "fault counts", "recordings", "who"),
    *("slow lines", "running time", "running time by hour"),
)
# what the columns of answers are called, other than those that have no words of their own
COLUMNS = (
    *(mark("time"), mark("program"), mark("name"), mark("state"), mark("took s"), mark("client")),
    *(mark("reason"), mark("code"), mark("axis"), mark("line"), mark("message"), mark("recording")),
    *(mark("times"), mark("latest"), mark("did"), mark("day"), mark("hour"), mark("running percent")),
    *(mark("states"), mark("finished"), mark("broken off"), mark("mean s"), mark("taken s")),
    *(mark("requested s"), mark("stretched by"), mark("bound by")),
)
WHENS = tuple(span for span in SPANS if span)

Answer = tuple[list[str], list[tuple[Any, ...]]]


class Past:
    """Ready questions to the history of a fleet, one at a time.

    Args:
        folder: of ``mcserver history``; read only.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._turn = asyncio.Lock()

    async def ask(self, what: str, when: str, machine: str | None = None) -> Answer:
        """Names of the columns, and at most 1000 rows; about one machine, or all.

        Raises:
            MotionError: MC511 there is no such question, no history, or no DuckDB.
        """
        if what not in QUESTIONS or when not in SPANS:
            raise RequestRefused("MC511", f"{what} {when} is no question", "choose one of the list")
        question = f"{what} {when}".strip()
        days = days_of(question, None, datetime.now(UTC).date())
        async with self._turn:
            return await asyncio.to_thread(
                ask, question, self._folder, days, machine=machine, threads=THREADS
            )

    async def running_today(self) -> dict[str, float]:
        """Share of the day's states in which a program ran, by machine [%]; empty: nothing is known."""
        try:
            names, rows = await self.ask("running time", "today")
        except MotionError:
            return {}
        machine, percent = names.index("machine"), names.index("running_percent")
        return {str(row[machine]): float(row[percent]) for row in rows}
