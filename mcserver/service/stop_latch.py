"""The emergency stop and the faults of a machine, latched until a reset."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

import msgspec

from mcserver.errors import Refused
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.program_table import ProgramTable
from mcserver.service.reports import AxisState, Event, Fault, MachineState

# Least time between two confirmations of one emergency stop [s].
CONFIRM_PERIOD_S = 0.1


class StopLatch:
    """Latches what prevents motion until a reset. All methods run in the event loop.

    Args:
        on_first: called with client and reason by the stop that latches, before its event.

    Attributes:
        stops: count of emergency stops requested so far.
    """

    def __init__(
        self,
        table: ProgramTable,
        port: ExecutorPort,
        loop: asyncio.AbstractEventLoop,
        on_first: Callable[[str, str], None],
    ) -> None:
        self.stops = 0
        self._table = table
        self._port = port
        self._loop = loop
        self._on_first = on_first
        self._latched = False
        # of the newest stop, even after its reset: answers a late copy of that stop
        self._event: Event | None = None
        self._confirmed = 0.0

    @property
    def state(self) -> MachineState:
        """``estop``, ``fault`` or ``ready``."""
        if self._latched:
            return "estop"
        return "fault" if self._table.faults else "ready"

    @property
    def faults(self) -> list[Fault]:
        """Latched faults, oldest first."""
        return list(self._table.faults)

    def emergency_stop(self, client: str, reason: str) -> None:
        """Latch the stop, here and in the executor; if it is latched already, confirm it again."""
        self.stops += 1
        self._port.orders.emergency_stop()
        if self._latched:
            self._confirm()
            return
        self._on_first(client, reason)
        fault = Fault(
            code="MC400",
            message="emergency stop" + (f": {reason}" if reason else ""),
            hint="remove the cause, then reset",
            t=self._table.time.now(),
        )
        self._table.faults.latch(fault)
        self._latch(self._table.events.publish("estop", reason=reason, client=client or None))
        self._end_programs("emergency stop", fault)

    def confirm_copy(self) -> None:
        """Confirm a repeated copy of a stop, without latching it again if it was reset meanwhile."""
        self.stops += 1
        self._confirm()

    def stopped_by_machine(self, fault: Fault) -> None:
        """Latch a stop that the executor has latched itself, like one that was requested."""
        self._table.faults.latch(fault)
        if not self._latched:
            self._latch(self._table.events.publish("estop", reason=fault.message))
        self._end_programs(fault.message, fault)

    def refuse_latched(self) -> None:
        """Refuse motion while the stop is latched.

        Raises:
            ServiceError: MC509 the emergency stop is latched.
        """
        if self._latched:
            raise Refused(
                "MC509",
                "the emergency stop is latched",
                "remove the cause, then reset",
                faults=[msgspec.to_builtins(fault) for fault in self._table.faults],
            )

    def refresh_faults(self, states: Mapping[int, AxisState]) -> None:
        """Remove faults of axes that a G1000 has cleared, and of lines that no axis has latched."""
        if not self._latched and self._table.faults.forget_cleared(states):
            self._publish_reset()

    def reset(self, axes: frozenset[int]) -> None:
        """Clear the latch; the axes stay de-energized.

        Raises:
            ServiceError: MC509 programs are still stopping.
        """
        if any(each.state == "ending" and not each.over for each in self._table.programs.values()):
            raise Refused("MC509", "motion is still coming to rest", "try again in a moment", faults=[])
        self._port.reset(axes)
        self._latched = False
        self._table.faults.clear()
        self._publish_reset()

    def _publish_reset(self) -> None:
        self._table.events.publish("reset", message="the latch is cleared")

    def _end_programs(self, reason: str, fault: Fault) -> None:
        for program in list(self._table.programs.values()):
            if not program.over:
                self._table.stop(program, "faulted", reason, fault)

    def _latch(self, event: Event) -> None:
        self._latched = True
        self._event = event
        self._confirmed = self._loop.time()

    def _confirm(self) -> None:
        """Publish the newest stop's event again, under its number; at most once per `CONFIRM_PERIOD_S`."""
        if self._event is not None and self._loop.time() - self._confirmed >= CONFIRM_PERIOD_S:
            self._confirmed = self._loop.time()
            self._table.events.repeat(self._event)
