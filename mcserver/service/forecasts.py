"""Forecast the remaining time of programs: from a simulation of their text, else from what is planned."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence

from mcserver.executor.shm.feedback import SlotView
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.planning.line_marks import LineMarks
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.program import Program
from mcserver.service.timeline import Timeline

# Most texts whose times are kept; the newest.
TEXTS = 16


class Forecasts:
    """Times of the last simulated texts, by the SHA-256 of the text and the operator's switches.

    Args:
        port: to read the slots of running programs. cycle_s: of the executor [s].
        programs: all, by id. now: executor time [s].
    """

    def __init__(
        self,
        port: ExecutorPort,
        cycle_s: float,
        programs: Mapping[str, Program],
        now: Callable[[], float],
    ) -> None:
        self._port = port
        self._cycle_s = cycle_s
        self._programs = programs
        self._now = now
        self._timelines: OrderedDict[tuple[str, Switches], Timeline] = OrderedDict()

    def take(
        self,
        sha256: str,
        marks: LineMarks,
        total: int | None = None,
        switches: Switches = AS_WRITTEN,
    ) -> None:
        """Store the times of a text, and give them to the programs that run it.

        Args:
            marks: of the simulation. total: count of the text's lines. switches: of the simulation.
        """
        timeline, key = Timeline(marks, total), (sha256, switches)
        self._timelines.pop(key, None)
        self._timelines[key] = timeline
        while len(self._timelines) > TEXTS:
            self._timelines.popitem(last=False)
        for program in self._programs.values():
            if (program.sha256, program.switches) == key and not program.over:
                program.clock.foresee(timeline)

    def knows(self, sha256: str, switches: Switches = AS_WRITTEN) -> bool:
        """Return whether the times of a text are from a complete simulation."""
        timeline = self._timelines.get((sha256, switches))
        return timeline is not None and timeline.simulated >= 1.0

    def begin(self, program: Program) -> None:
        """Give a program that opens the times of its text, if known."""
        timeline = self._timelines.get((program.sha256 or "", program.switches))
        if timeline is not None:
            program.clock.foresee(timeline)

    def estimate(self) -> None:
        """Update the remaining time of all running programs.

        Without a simulation it is that of the planned motion, or None if there is none: what follows is
        unknown then. Waits and dwells are added.
        """
        slots: Sequence[SlotView] | None = None
        now = self._now()
        for program in self._programs.values():
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
                # read only if a program runs: this is half the cost of a call on an idle machine
                slots = slots or self._port.slots()
                slot = slots[program.slot]
                left = (program.planned_end_u - slot.u) * self._cycle_s
                program.eta_s = left / (slot.rate or min(1.0, override) or 1.0) if left > 0.0 else None
