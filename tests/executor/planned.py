"""A text, planned beside a virtual executor cycle by cycle, and what the executor did."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

from mckinematics.pose import Kinematics

from mcserver.executor.entries import Array, EventKind
from mcserver.machine.machine_file import Machine
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.start_state import StartState
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.executor.rig import Watched


class Planned(Watched):
    """All lines of a text, from the planner to the drives.

    Args:
        start: where the planner begins; None: as the machine does. slot: what `open_slot` takes besides.

    Attributes:
        rows, actuals: setpoints and encoder readings of each cycle, shape (K,) each. ended: the program has.
    """

    def __init__(
        self,
        made: Machine,
        text: str,
        *,
        start: StartState | None = None,
        kinematics: Kinematics | None = None,
        homed: bool = True,
        **slot: Any,
    ) -> None:
        self.machine = made
        self.rows: list[Array] = []
        self.actuals: list[Array] = []
        self.events = []
        self.ended = False
        self.executor = VirtualExecutor(made, recorder=self._record, homed=homed)
        self.sink = self.executor.open_slot(0, **slot)
        self.pipeline = Pipeline(made, self.sink, start=start or StartState.of(made), kinematics=kinematics)
        self.pipeline.lines.put(1, text.split("\n"))
        self.pipeline.lines.closed = True

    def _record(self, _time: float, _line: int, setpoint: Array, actual: Array) -> None:
        self.rows.append(setpoint.copy())
        self.actuals.append(actual.copy())

    def step(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            while self.pipeline.pump(self.executor.u(0)):
                pass
            self.executor.step()
            for event in self.executor.events():
                self.pipeline.on_event(event)
                self.events.append(event)
                self.ended |= event.kind in (EventKind.FINISHED, EventKind.STOPPED)

    def run(self, script: Callable[[int], None] = lambda _: None, limit: int = 120_000) -> Self:
        """To the program's end; ``script`` is called with each cycle's number before it."""
        for cycle in range(limit):
            script(cycle)
            self.step()
            if self.ended:
                return self
        raise AssertionError(f"no end: {self.events[-5:]}")
