"""Remote methods for whole texts: ``check``, ``simulate``, ``put_text``."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcserver.errors import Refused
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.net import messages as wire
from mcserver.net import text_messages as text_wire
from mcserver.net.text_forecast import TextForecast
from mcserver.planning.start_state import StartState
from mcserver.service.arming import hash_of
from mcserver.service.axes_of_requests import positions_in_si
from mcserver.service.reports import wire_diagnostic
from mcserver.service.service import MachineService
from mcserver.simulation.program_checker import ProgramChecker


class TextMethods:
    """Handles the messages for one machine's service and its checker."""

    def __init__(self, service: MachineService, checker: ProgramChecker, forecast: TextForecast) -> None:
        self._service = service
        self._checker = checker
        self._forecast = forecast
        # one part is written at a time
        self._writing = asyncio.Lock()

    async def put_text(self, _client: str, request: text_wire.PutTextRequest) -> text_wire.PutTextReply:
        """Store a part of a text; after the last part, forecast programs that already run the text."""
        async with self._writing:
            text = await asyncio.to_thread(
                self._service.texts.take, request.sha256, request.size, request.offset, request.part
            )
        if text.complete:
            self._forecast.begin(request.sha256)
        return text_wire.PutTextReply(text.received, text.lines, text.complete)

    async def check(self, client: str, request: wire.CheckRequest) -> wire.CheckReply:
        start = self._start(request.positions, Switches.of(request.block_delete, request.optional_stop))
        found = await self._checker.check(client, self._text(request), start)
        faulty = any(diagnostic.severity == "error" for diagnostic in found)
        if request.sha256 is not None and self._service.texts.has(request.sha256):
            self._service.texts.find(request.sha256).checked = None if faulty else start.switches
        return wire.CheckReply(not faulty, [wire_diagnostic(diagnostic) for diagnostic in found])

    async def simulate(self, client: str, request: wire.SimulateRequest) -> dict[str, Any]:
        start = self._start(request.positions, Switches.of(request.block_delete, request.optional_stop))
        report, marks = await self._checker.simulate(
            client,
            request.text,
            start,
            request.path_points,
            request.lines,
            request.assertions,
            request.against,
            request.role,
        )
        if marks is not None:
            self._service.forecasts.take(hash_of(request.text), marks, switches=start.switches)
        return report

    def _text(self, request: wire.CheckRequest) -> str | Path:
        if (request.text is None) == (request.sha256 is None):
            raise Refused("MC511", "a check is of one text", "give either `text` or `sha256`")
        return (
            request.text if request.text is not None else self._service.texts.find(str(request.sha256)).path
        )

    def _start(self, positions: Mapping[str, float] | None, switches: Switches | None) -> StartState:
        """Return the state of a machine at rest at given positions [mm or deg], with stored work offsets."""
        machine = self._service.machine
        start = StartState.of(machine, self._service.start_state().frame, switches or AS_WRITTEN)
        return start if positions is None else start.at(positions_in_si(machine, positions))
