"""How long programs still take: by a simulation of their text, without one by what is planned."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mcserver.executor.view import SlotView
from mcserver.service.motion_port import MotionPort
from mcserver.service.program import Program
from mcserver.service.timeline import Timeline

# What is kept of simulations, the newest: so many texts, and so many lines of them all.
TEXTS = 16
LINES = 2_000_000


class Forecasts:
    """Times of the texts that were simulated last, by the SHA-256 of the text.

    Args:
        port: where the slots of running programs are read. cycle_s: of the executor [s].
    """

    def __init__(self, port: MotionPort, cycle_s: float) -> None:
        self._port = port
        self._cycle_s = cycle_s
        self._timelines: OrderedDict[str, Timeline] = OrderedDict()

    def take(self, sha256: str, report: Mapping[str, Any], programs: Iterable[Program]) -> None:
        """Keep the times of a text, and give them to the programs that run it.

        Args:
            report: of the simulation; one with faults has no times. programs: those that are there.
        """
        if not report["ok"]:
            return
        timeline = Timeline(report)
        self._timelines.pop(sha256, None)
        self._timelines[sha256] = timeline
        while len(self._timelines) > TEXTS or (len(self._timelines) > 1 and self._lines() > LINES):
            self._timelines.popitem(last=False)
        for program in programs:
            if program.sha256 == sha256 and not program.ended:
                program.clock.simulated(timeline)

    def begin(self, program: Program) -> None:
        """Give a program that opens the times of its text, where they are known."""
        timeline = self._timelines.get(program.sha256 or "")
        if timeline is not None:
            program.clock.simulated(timeline)

    def estimate(self, programs: Iterable[Program], now: float) -> None:
        """Bring the time left of all that run up to date; ``now``: executor time [s].

        Without a simulation it is the time left of what is planned; waits and dwells come on top.
        """
        slots: Sequence[SlotView] | None = None
        for program in programs:
            if program.ended or program.slot is None:
                continue
            override, progress = program.override, program.progress
            program.eta_s = program.clock.observe(
                now,
                program.done,
                override,
                running=program.state == "running" and progress.started > 0,
                done_at=progress.ended_at,
            )
            if program.eta_s is None and program.planned_end_u is not None:
                # only read where something runs: it is half of what a call of an idle machine costs
                slots = slots or self._port.slots()
                left = max(0.0, program.planned_end_u - slots[program.slot].u) * self._cycle_s
                program.eta_s = left / (min(1.0, override) if override > 0.0 else 1.0)

    def _lines(self) -> int:
        return sum(each.size for each in self._timelines.values())
