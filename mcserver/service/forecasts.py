"""How long programs still take: by a simulation of their text, without one by what is planned."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable, Sequence

from mcserver.executor.view import SlotView
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.planning.line_marks import LineMarks
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.program import Program
from mcserver.service.timeline import Timeline

# Texts whose times are kept, the newest.
TEXTS = 16


class Forecasts:
    """Times of the texts that were simulated last, by the SHA-256 of the text and the operator's switches.

    Args:
        port: where the slots of running programs are read. cycle_s: of the executor [s].
    """

    def __init__(self, port: ExecutorPort, cycle_s: float) -> None:
        self._port = port
        self._cycle_s = cycle_s
        self._timelines: OrderedDict[tuple[str, Switches], Timeline] = OrderedDict()

    def take(
        self,
        sha256: str,
        marks: LineMarks,
        programs: Iterable[Program],
        total: int | None = None,
        switches: Switches = AS_WRITTEN,
    ) -> None:
        """Keep the times of a text, and give them to the programs that run it.

        Args:
            marks: of the simulation. programs: those that are there. total: how many lines the text has.
            switches: that it was simulated with.
        """
        timeline, key = Timeline(marks, total), (sha256, switches)
        self._timelines.pop(key, None)
        self._timelines[key] = timeline
        while len(self._timelines) > TEXTS:
            self._timelines.popitem(last=False)
        for program in programs:
            if (program.sha256, program.switches) == key and not program.over:
                program.clock.foresee(timeline)

    def knows(self, sha256: str, switches: Switches = AS_WRITTEN) -> bool:
        """Return whether the times of a text are those of its whole simulation."""
        timeline = self._timelines.get((sha256, switches))
        return timeline is not None and timeline.simulated >= 1.0

    def begin(self, program: Program) -> None:
        """Give a program that opens the times of its text, where they are known."""
        timeline = self._timelines.get((program.sha256 or "", program.switches))
        if timeline is not None:
            program.clock.foresee(timeline)

    def estimate(self, programs: Iterable[Program], now: float) -> None:
        """Bring the time left of all that run up to date; ``now``: executor time [s].

        Without a simulation it is the time left of what is planned, None where nothing of that is left: what
        still comes is not known then. Waits and dwells come on top.
        """
        slots: Sequence[SlotView] | None = None
        for program in programs:
            if program.slot is None:
                continue
            override, progress = program.override, program.progress
            program.eta_s = program.clock.observe(
                now,
                progress.done,
                override,
                running=program.state == "running" and progress.started > 0,
                done_at=progress.ended_at,
            )
            if program.eta_s is None and program.planned_end_u is not None:
                # only read where something runs: it is half of what a call of an idle machine costs
                slots = slots or self._port.slots()
                slot = slots[program.slot]
                left = (program.planned_end_u - slot.u) * self._cycle_s
                program.eta_s = left / (slot.rate or min(1.0, override) or 1.0) if left > 0.0 else None
