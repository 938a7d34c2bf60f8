"""Telemetry out: every cycle in batches, the whole machine at 20 Hz, single axes while someone listens."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

import msgspec
import zenoh

from mcserver.net.keys import Keys
from mcserver.net.messages import TelemetryBlock
from mcserver.net.qos import axis_qos, batch_qos, state_qos
from mcserver.net.session import ZenohSession
from mcserver.net.status import CYCLES_A_MESSAGE, STATE_HZ, EdgeUnits, machine_status
from mcserver.service.service import MachineService

log = logging.getLogger(__name__)

# messages in one turn, where the loop was late
CATCH_UP = 20


class Telemetry:
    """Publishes until it is cancelled.

    Nothing is read or encoded for keys that nobody subscribes to.

    Args:
        session: what to publish on.
        keys: of this machine.
        service: what to publish.
    """

    def __init__(self, session: ZenohSession, keys: Keys, service: MachineService) -> None:
        self._service = service
        self._units = EdgeUnits(service.machine)
        self._encode = msgspec.msgpack.Encoder().encode
        self._batch = session.matched_publisher(keys.telemetry_batch, batch_qos())
        self._state = session.matched_publisher(keys.telemetry_state, state_qos())
        self._axes = [
            session.matched_publisher(keys.telemetry_axis(axis.index), axis_qos())
            for axis in service.machine.axes
        ]
        self._next_cycle = 0

    async def run(self) -> None:
        """Both clocks, each on absolute times, so that neither drifts."""
        batch_s = CYCLES_A_MESSAGE * self._service.machine.cycle_s
        async with asyncio.TaskGroup() as group:
            group.create_task(self._every(batch_s, self._publish_cycles))
            group.create_task(self._every(1.0 / STATE_HZ, self._publish_state))

    async def _every(self, period_s: float, publish: Callable[[], None]) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + period_s, loop.time())
            await asyncio.sleep(due - loop.time())
            try:
                publish()
            except zenoh.ZError as error:
                log.warning("telemetry could not be published: %s", error)

    def _publish_state(self) -> None:
        if not self._state.wanted:
            return
        self._state.put(self._encode(machine_status(self._service, self._units)))

    def _publish_cycles(self) -> None:
        whole = self._batch.wanted
        single = [column for column, publisher in enumerate(self._axes) if publisher.wanted]
        if not (whole or single):
            # whoever comes later begins with the newest cycles
            self._next_cycle = -1
            return
        for _ in range(CATCH_UP):
            cycles = self._service.port.cycles_since(self._next_cycle, CYCLES_A_MESSAGE)
            if cycles is None or len(cycles.setpoint) == 0:
                return
            self._next_cycle = cycles.first + len(cycles.setpoint)
            rows = self._units.rows(cycles)
            if whole:
                self._batch.put(self._encode(TelemetryBlock(cycles.first, cycles.start, rows.tobytes())))
            for column in single:
                block = TelemetryBlock(cycles.first, cycles.start, rows[:, column].tobytes())
                self._axes[column].put(self._encode(block))
