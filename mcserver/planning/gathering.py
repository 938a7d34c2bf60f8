"""What comes to the planner's process and leaves it, gathered for a moment where nobody waits for it.

Each wake-up of a process costs more than the line that it is for, and most lines are streamed or submitted
without waiting for the verdict. So lines that nobody waits for are taken together, and news that nobody
waits for is sent together; the first line to a planner at rest is planned at once.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mcserver.executor.entries import EventKind
from mcserver.planning.planner_messages import (
    Consumed,
    Dropped,
    ExecutorEvents,
    Lines,
    Planned,
    PlannerCommand,
    PlannerEvent,
    Validated,
)

# how long at most [s]: a quarter of the tick of progress reports, and short beside what is planned ahead
GATHER_S = 0.005

_PROGRESS = frozenset({EventKind.LINE_START, EventKind.LINE_END, EventKind.AXIS_DONE, EventKind.SETTLED})


class Gathering:
    """Decides when to look for commands and when to send events. Times are of one clock that never steps [s].

    Attributes:
        events: not sent yet, in order.
    """

    def __init__(self) -> None:
        self.events: list[PlannerEvent] = []
        self._send_at = math.inf
        self._look_at = -math.inf
        # the last line of each program whose verdict somebody waits for
        self._awaited: dict[str, int] = {}

    def came(self, commands: Sequence[PlannerCommand], now: float) -> None:
        """Note the commands that woke the process at ``now``."""
        only_lines = bool(commands)
        for command in commands:
            if not isinstance(command, Lines):
                self._awaited.pop(command.program, None)
                only_lines = False
            elif command.awaited:
                self._awaited[command.program] = command.first + len(command.lines) - 1
                only_lines = False
        if only_lines:
            self._look_at = now + GATHER_S

    def happened(self, events: Sequence[PlannerEvent], now: float) -> None:
        """Note what the planner has said."""
        for event in events:
            self.events.append(event)
            wait = GATHER_S if self._can_wait(event) else 0.0
            self._send_at = min(self._send_at, now + wait)

    def due(self, now: float) -> bool:
        """Whether there are events to be sent now."""
        return now >= self._send_at

    def take(self) -> list[PlannerEvent]:
        """Return the events, which are sent now."""
        events, self.events = self.events, []
        self._send_at = math.inf
        return events

    def until_due(self, now: float) -> float:
        """How long the events may wait [s]; infinite where there are none."""
        return max(0.0, self._send_at - now)

    def until_look(self, now: float) -> float:
        """How long to leave new commands alone [s]."""
        return max(0.0, min(self._look_at, self._send_at) - now)

    def _can_wait(self, event: PlannerEvent) -> bool:
        match event:
            case Consumed() | Planned() | Dropped():
                return True
            case Validated():
                awaited = self._awaited.get(event.program)
                if awaited is None or event.through < awaited:
                    return True
                del self._awaited[event.program]
                return False
            case ExecutorEvents():
                return all(each.kind in _PROGRESS for each in event.events)
        return False
