"""One machine's service on a fake executor."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest

from mcserver.service.program import Program
from mcserver.service.reports import Ack, Event
from mcserver.service.service import MachineService
from mcserver.service.service_options import ServiceOptions
from tests.service.fakes import FakePipelines, FakePort, three_axes
from tests.service.virtual_cell import VirtualCell

LIMIT_S = 5.0


class Bench:
    """A service, its fakes, and what it has said."""

    def __init__(self, journal: Path, instance: str = "one", **options: Any) -> None:
        self.machine = three_axes()
        self.port = FakePort(self.machine)
        self.pipelines = FakePipelines(self.port)
        self.acks: list[Ack] = []
        self.events: list[Event] = []
        self._news = asyncio.Event()
        self.service = MachineService(
            self.machine,
            self.port,
            self.pipelines,
            ServiceOptions(journal=journal, instance=instance, **options),
            on_ack=self._on_ack,
            on_event=self._on_event,
        )

    def _on_ack(self, ack: Ack) -> None:
        self.acks.append(ack)
        self._news.set()

    def _on_event(self, event: Event) -> None:
        self.events.append(event)
        self._news.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        """Waits for something that an acknowledgement or event announces."""
        async with asyncio.timeout(LIMIT_S):
            while not condition():
                self._news.clear()
                await self._news.wait()

    async def opened(self, *lines: str) -> Program:
        """A program of ``hmi`` that has been sent lines."""
        program = await self.service.open("hmi")
        await self.service.lines.submit("hmi", program.program, 1, list(lines))
        return program

    async def until_acked(self, program: str, *, done: int = 0, state: str = "") -> Ack:
        """The first acknowledgement that shows at least this."""

        def found() -> list[Ack]:
            these = (ack for ack in self.acks if ack.program == program)
            return [ack for ack in these if ack.done >= done and state in ("", ack.state)]

        await self.until(lambda: bool(found()))
        return found()[0]

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]


@pytest.fixture
async def bench(tmp_path: Path) -> AsyncIterator[Bench]:
    made = Bench(tmp_path / "journal.db")
    made.service.start()
    yield made
    await made.service.stop()


@pytest.fixture
async def cell(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[VirtualCell]:
    """A server of the module's ``machine()``, on a virtual clock."""
    made = VirtualCell(request.module.machine(), tmp_path)
    yield made
    await made.stop()
