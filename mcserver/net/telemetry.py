"""Publish telemetry: every cycle in batches, the whole machine at 20 Hz, single axes while subscribed to."""

from __future__ import annotations

import asyncio
import logging
import threading
import time

import msgspec

from mcserver.net import qos
from mcserver.net.defects import DefectLog
from mcserver.net.keys import Keys
from mcserver.net.messages import TelemetryBlock
from mcserver.net.publishing import PublishingThread
from mcserver.net.session import ZenohSession, is_zenoh_fault
from mcserver.net.status import CYCLES_A_MESSAGE, STATE_HZ, EdgeUnits, machine_status
from mcserver.service.executor_port import ExecutorPort
from mcserver.service.service import MachineService

log = logging.getLogger(__name__)

# most messages in one turn, after the thread was delayed
CATCH_UP = 20
# interval of checks for subscribers while there are none
LOOK_S = 0.1
CLOSE_LIMIT_S = 1.0


class StateTelemetry:
    """Publishes the state of the whole machine; encoded in the loop, published from a thread."""

    def __init__(
        self, session: ZenohSession, keys: Keys, service: MachineService, publishing: PublishingThread
    ) -> None:
        self._service = service
        self._publishing = publishing
        self._units = EdgeUnits(service.machine)
        self._encode = msgspec.msgpack.Encoder().encode
        self._state = session.matched_publisher(keys.telemetry_state, qos.STATE)

    async def run(self) -> None:
        """Publish until cancelled, at absolute times, so that the period does not drift."""
        loop = asyncio.get_running_loop()
        due = loop.time()
        while True:
            due = max(due + 1.0 / STATE_HZ, loop.time())
            await asyncio.sleep(due - loop.time())
            if self._state.wanted:
                state = machine_status(self._service, self._units)
                self._publishing.put(self._state.put, self._encode(state))
            else:
                # remaining times are updated even without subscribers
                self._service.forecasts.estimate()


class CycleTelemetry:
    """Publishes every cycle from its own thread, which only reads the executor's shared memory.

    Nothing is read or encoded for keys without subscribers.
    """

    def __init__(self, session: ZenohSession, keys: Keys, service: MachineService) -> None:
        self._port: ExecutorPort = service.port
        self._period_s = CYCLES_A_MESSAGE * service.machine.cycle_s
        self._units = EdgeUnits(service.machine)
        self._encode = msgspec.msgpack.Encoder().encode
        self._batch = session.matched_publisher(keys.telemetry_batch, qos.BATCH)
        self._axes = [
            session.matched_publisher(keys.telemetry_axis(axis.index), qos.AXIS)
            for axis in service.machine.axes
        ]
        self._next_cycle = 0
        self._followed = False
        self._failed = DefectLog(log)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="telemetry", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread, within a time limit."""
        self._ending.set()
        self._thread.join(CLOSE_LIMIT_S)

    def _run(self) -> None:
        due = time.monotonic()
        while True:
            due = max(due + (self._period_s if self._followed else LOOK_S), time.monotonic())
            if self._ending.wait(max(0.0, due - time.monotonic())):
                return
            try:
                self._publish()
            except BaseException as error:
                # a failed batch does not end the thread
                self._failed.add(
                    f"telemetry could not be published: {error}", None if is_zenoh_fault(error) else error
                )

    def _publish(self) -> None:
        whole = self._batch.wanted
        single = [column for column, publisher in enumerate(self._axes) if publisher.wanted]
        self._followed = whole or bool(single)
        if not self._followed:
            # the next subscriber begins with the newest cycles
            self._next_cycle = -1
            return
        for _ in range(CATCH_UP):
            cycles = self._port.cycles_since(self._next_cycle, CYCLES_A_MESSAGE)
            if cycles is None or len(cycles.setpoint) == 0:
                return
            self._next_cycle = cycles.first + len(cycles.setpoint)
            rows = self._units.rows(cycles)
            if whole:
                self._batch.put(self._encode(TelemetryBlock(cycles.first, cycles.start, rows.tobytes())))
            for column in single:
                block = TelemetryBlock(cycles.first, cycles.start, rows[:, column].tobytes())
                self._axes[column].put(self._encode(block))
