"""A server on a virtual clock, an agent that asks for runs, and a person who arms them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mcserver.errors import ServiceError
from mcserver.machine.machine_file import Machine
from mcserver.net import arming_messages as wire
from mcserver.net.arming_methods import ArmingMethods
from mcserver.planning.start_state import StartState
from mcserver.service.program import Program
from mcserver.simulation.preview import Preview, preview
from tests.machine_text import axes_text
from tests.service.virtual_cell import VirtualCell

TRAVEL = "max_jerk = 500000.0\nmin_position = -400.0\nmax_position = 400.0"
MILL = f"""
[machine]
name = "mill"
[dialect]
profile = "cnc"
capture = "auto"
{axes_text(range(3), velocity=500.0, acceleration=5000.0, keys=TRAVEL)}
{axes_text([3], rotary=True, velocity=3600.0, acceleration=36000.0)}
[[input]]
number = 0
name = "part there"
initial = 1
[[input]]
number = 1
name = "door"
[[output]]
number = 0
name = "clamp"
[[input]]
number = 2
name = "probe"
[probe]
input = 2
[[cutter]]
number = 2
length_mm = 30.0
"""
BOT, ANNA = "bot.agent-1", "anna.mcctl-1"
TEXT = "G54\nG1 X50 F6000\nG1 X0"
SHIFT = "G10 L2 P1 X300"


class Site:
    """One start of a server, an agent that asks, and a person who arms."""

    def __init__(self, machine: Machine, folder: Path, instance: str = "first") -> None:
        self.machine = machine
        self.cell = VirtualCell(machine, folder, instance)
        self.rows: list[np.ndarray[Any, np.dtype[np.float64]]] = []
        self.cell.executor.recorder = lambda _t, _line, setpoint, _actual: self.rows.append(setpoint.copy())
        self.arming = ArmingMethods(self.cell.service, self)  # type: ignore[arg-type]

    async def preview(self, _client: str, text: str, start: StartState, axes: tuple[int, ...]) -> Preview:
        return preview(text, self.machine, start, axes)

    async def ask(self, text: str = TEXT, client: str = BOT) -> wire.RunRequestStatus:
        reply = await self.arming.request_run(client, wire.RunRequestRequest(text=text))
        assert reply.run is not None, reply.diagnostics
        return reply.run

    async def arm(
        self, text: str = TEXT, override: float = 100.0, client: str = BOT
    ) -> wire.RunRequestStatus:
        run = await self.ask(text, client)
        request = wire.ArmRequest(sha256=run.sha256, override=override, number=run.number)
        return self.arming.arm(ANNA, request)

    async def start(self, text: str = TEXT, client: str = BOT) -> Program:
        reply = await self.arming.run_armed(client, wire.RunArmedRequest(text=text))
        return self.cell.service.program(reply.program)

    async def run(self, text: str = TEXT) -> Program:
        return await self.cell.ended(await self.start(text))

    async def by_hand(self, *lines: str) -> None:
        """A person's own program."""
        program = await self.cell.run(*lines)
        assert program.state == "finished", program.fault

    async def refusal(self, text: str = TEXT) -> str:
        with pytest.raises(ServiceError) as refused:
            await self.start(text)
        assert refused.value.code == "MC572"
        assert not [each for each in self.cell.service.current() if not each.ended]
        return refused.value.message

    def extent(self, axis: int = 0) -> tuple[float, float]:
        """Least and greatest setpoint so far [mm]."""
        places = np.array(self.rows)[:, axis] * 1000.0
        return float(places.min()), float(places.max())
