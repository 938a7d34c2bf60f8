"""A server's drives on CAN buses: booted before the executor starts, closed after it.

Only a machine that has such drives imports the packages for them.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from typing import TYPE_CHECKING

from mcserver.canopen.drive_events import CanopenEvent
from mcserver.canopen.settings import uses_can
from mcserver.canopen.views import DriveAccess, NoDrives
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine
from mcserver.net.inbox import Inbox
from mcserver.service.event_log import EventLog

if TYPE_CHECKING:
    from mcserver.canopen.access import OperatorAccess
    from mcserver.canopen.service import CanopenService

EVENTS_WAITING = 256


class CanDrives:
    """Drives on CAN buses, as the server holds them; without any it does nothing.

    Attributes:
        access: for operators.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.access: DriveAccess = NoDrives()
        self._events: Inbox[CanopenEvent] = Inbox(loop, self._publish, limit=EVENTS_WAITING)
        self._early: deque[CanopenEvent] = deque(maxlen=EVENTS_WAITING)
        self._log: EventLog | None = None

    def on_event(self, event: CanopenEvent) -> None:
        """From any thread."""
        self._events.push(event)

    def _publish(self, event: CanopenEvent) -> None:
        if self._log is None:
            self._early.append(event)
            return
        self._log.publish(event.kind, axis=event.axis, reason=event.code, message=event.message)

    @contextlib.contextmanager
    def told_to(self, log: EventLog) -> Iterator[None]:
        """Events, those of the boot-up first, go into ``log`` inside the block."""
        self._log = log
        while self._early:
            self._publish(self._early.popleft())
        try:
            yield
        finally:
            self._log = None


@contextlib.asynccontextmanager
async def booted(
    machine: Machine, on_progress: Callable[[str], None], stopping: Callable[[], bool]
) -> AsyncIterator[CanDrives]:
    """The machine's drives on CAN buses, operational and without energy inside the block.

    Args:
        on_progress: a sentence for people, in any thread. stopping: whether to give up while drives boot.

    Raises:
        ConfigurationError: MC008, MC016 the packages are missing, MC552. RuntimeFault: MC424, MC550 … MC555.
        Stopped: ``stopping`` said so.
    """
    drives = CanDrives(asyncio.get_running_loop())
    if not uses_can(machine):
        yield drives
        return
    service, access = await asyncio.to_thread(_start, machine, drives, on_progress, stopping)
    drives.access = access
    try:
        yield drives
    finally:
        await asyncio.to_thread(access.close)
        await asyncio.to_thread(service.close)


def _start(
    machine: Machine, drives: CanDrives, on_progress: Callable[[str], None], stopping: Callable[[], bool]
) -> tuple[CanopenService, OperatorAccess]:
    try:
        from mcserver.canopen.access import OperatorAccess
        from mcserver.canopen.service import CanopenService
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("can", "canopen"):
            raise
        raise ConfigurationError(
            "MC016",
            f"drives on a CAN bus need the package {error.name}, which is not installed",
            "pip install 'mcserver[can]'",
        ) from error
    service = CanopenService.start(machine, drives.on_event, on_progress, stopping=stopping)
    return service, OperatorAccess(service)
