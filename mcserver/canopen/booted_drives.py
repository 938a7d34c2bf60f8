"""A server's drives on CAN buses: booted before the executor starts, closed after it.

Only a machine that has such drives imports the packages for them.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING

from mcserver.canopen.drive_events import CanopenEvent
from mcserver.canopen.settings import uses_can
from mcserver.machine.machine_file import Machine

if TYPE_CHECKING:
    from mcserver.canopen.access import OperatorAccess
    from mcserver.canopen.reachable_drives import LineAccess

EVENTS_WAITING = 256

OnEvent = Callable[[CanopenEvent], None]


class CanDrives:
    """Drives on CAN buses, as the server holds them; without any it does nothing.

    Attributes:
        access: for operators; None: no drive is on a bus.
        machine: with the process data that its drives have agreed to.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.machine: Machine | None = None
        self.access: OperatorAccess | None = None
        self._loop = loop
        # the oldest go where nobody takes them
        self._waiting: deque[CanopenEvent] = deque(maxlen=EVENTS_WAITING)
        self._publish: OnEvent | None = None

    def on_event(self, event: CanopenEvent) -> None:
        """Publish an event, or keep it until somebody listens; from any thread."""
        self._waiting.append(event)
        # the loop is closed when the server has ended
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._drain)

    def _drain(self) -> None:
        while self._publish is not None and self._waiting:
            self._publish(self._waiting.popleft())

    def reach(self, line: LineAccess) -> None:
        """Let operators reach drives on EtherCAT, too."""
        if self.access is None:
            from mcserver.canopen.access import OperatorAccess

            self.access = OperatorAccess(None)
        self.access.reachable.line = line

    @contextlib.contextmanager
    def published(self, publish: OnEvent) -> Iterator[None]:
        """Hand events, those of the boot-up first, to ``publish`` inside the block, in the loop."""
        self._publish = publish
        self._drain()
        try:
            yield
        finally:
            self._publish = None


@contextlib.asynccontextmanager
async def booted(
    machine: Machine,
    on_progress: Callable[[str], None],
    stopping: Callable[[], bool],
    *,
    take_over: bool = False,
) -> AsyncIterator[CanDrives]:
    """The machine's drives on CAN buses, operational and without energy inside the block.

    Args:
        on_progress: a sentence for people, in any thread. stopping: whether to give up while drives boot.
        take_over: reset the nodes even where another master is heard.

    Raises:
        ConfigurationError: MC008, MC552.
        RuntimeFault: MC424, MC550 … MC555, MC560.
        Stopped: ``stopping`` said so.
    """
    drives = CanDrives(asyncio.get_running_loop())
    drives.machine = machine
    on_ethercat, on_can = any(bus.kind == "ethercat" for bus in machine.buses), uses_can(machine)
    if on_ethercat or on_can:
        from mcserver.canopen.machine_file_check import refuse_soft_loops

        refuse_soft_loops(machine)
    if on_ethercat:
        # these drives are booted by the process of the cycle, the one master of their bus
        from mcserver.canopen.coe import agreed_on_ethercat

        drives.machine = machine = agreed_on_ethercat(machine)
    service = None
    if on_can:
        from mcserver.canopen.access import OperatorAccess
        from mcserver.canopen.service import CanopenService

        start = partial(CanopenService.start, machine, drives.on_event, on_progress, stopping=stopping)
        service = await asyncio.to_thread(start, take_over=take_over)
        drives.access = OperatorAccess(service)
        drives.machine = service.agreed(machine)
    try:
        yield drives
    finally:
        if drives.access is not None:
            await asyncio.to_thread(drives.access.close)
        if service is not None:
            await asyncio.to_thread(service.close)
