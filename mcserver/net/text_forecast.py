"""Simulate stored texts while programs run them, to forecast their times."""

from __future__ import annotations

import msgspec

from mcserver.gcode.switches import Switches
from mcserver.service.program import Program
from mcserver.service.service import MachineService
from mcserver.simulation.foresight import Foreseen
from mcserver.simulation.program_checker import ProgramChecker


class TextForecast:
    """Starts the simulations of one machine's texts."""

    def __init__(self, service: MachineService, checker: ProgramChecker) -> None:
        self._service = service
        self._checker = checker

    def begin(self, sha256: str | None) -> None:
        """Simulate a stored text while programs run it, unless its times are known."""
        service = self._service
        if sha256 is None or not service.texts.has(sha256):
            return
        for switches in {each.switches for each in self._running(sha256)}:
            if not service.forecasts.knows(sha256, switches):
                self._begin(sha256, switches)

    def _begin(self, sha256: str, switches: Switches) -> None:
        service = self._service
        text = service.texts.find(sha256)

        def listen(found: Foreseen) -> bool:
            programs = [each for each in self._running(sha256) if each.switches == switches]
            if found.marks is not None:
                service.forecasts.take(sha256, found.marks, text.lines, switches)
            if found.fault is not None:
                for program in programs:
                    program.notice = f"line {found.fault.line} will be refused: {found.fault.message}"
            return bool(programs)

        start = msgspec.structs.replace(service.start_state(), switches=switches)
        self._checker.foresee(sha256, text.path, listen, start, checked=text.checked == switches)

    def _running(self, sha256: str) -> list[Program]:
        """Return the running programs of a text."""
        return [each for each in self._service.current() if each.sha256 == sha256 and not each.ended]
