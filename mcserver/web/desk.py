"""A drive's desk through a running server: that of `mcserver drives`, whose transfers are remote calls."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar, cast

from mcclient import Machine, MotionError
from mcclient.types import DriveParameters, SdoReply

from mcserver.canopen.canopen_errors import DriveError, Stopped
from mcserver.canopen.desk import Desk
from mcserver.canopen.parameters import Parameter
from mcserver.canopen.settings import DriveSettings
from mcserver.canopen.views import SdoType
from mcserver.web.link import MachineLink

T = TypeVar("T")


class RemoteSdo:
    """Objects of one axis's drive, as `mcserver.canopen.node_configuration.SdoClient`; for threads.

    Args:
        ask: carries a call out in the page's loop, and waits for its answer.

    Attributes:
        transfers: how many there were.
    """

    def __init__(
        self, axis: int, ask: Callable[[Callable[[Machine], Awaitable[SdoReply]]], SdoReply]
    ) -> None:
        self.transfers = 0
        self._axis = axis
        self._ask = ask

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        """Read an object; the server repeats what gets no answer.

        Raises:
            DriveError: MC553 the drive refuses, MC554 it does not answer; what else the server says.
        """
        del attempts
        return self._transfer(lambda machine: machine.sdo_read(index, subindex, axis=self._axis)).raw

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        """Write an object. Raises: as `upload`; MC559 it would fight the cycle."""
        del attempts
        # type and limits of the EDS have been kept by the desk (`mcserver.canopen.parameters.encode`)
        self._transfer(
            lambda machine: machine.sdo_write(index, payload.hex(), subindex, axis=self._axis, type="bytes")
        )

    def _transfer(self, call: Callable[[Machine], Awaitable[SdoReply]]) -> SdoReply:
        try:
            reply = self._ask(call)
        except MotionError as error:
            raise DriveError(
                error.code, error.message, error.hint, axis=self._axis, **error.details
            ) from error
        self.transfers += 1
        return reply


class DeskThread:
    """One thread in which desks of a machine's drives work, one after the other, for one browser.

    Attributes:
        transfers: of the desk that works, or worked last.
    """

    def __init__(self, link: MachineLink) -> None:
        self._link = link
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="desk")
        self._stopping = threading.Event()
        self._sdo: RemoteSdo | None = None
        self._busy = 0

    @property
    def transfers(self) -> int:
        return 0 if self._sdo is None else self._sdo.transfers

    @property
    def is_busy(self) -> bool:
        """Whether a desk works, or waits for one."""
        return self._busy > 0

    async def work(self, drive: DriveParameters, work: Callable[[Desk], T]) -> T:
        """Return what work at a drive's desk gives.

        Raises:
            Stopped: `stop` was called. McError: as the work.
        """
        loop = asyncio.get_running_loop()

        async def answered(call: Callable[[Machine], Awaitable[SdoReply]]) -> SdoReply:
            return await call(self._link.connected())

        sdo = RemoteSdo(
            drive.axis, lambda call: asyncio.run_coroutine_threadsafe(answered(call), loop).result()
        )
        line = drive.fieldbus == "ethercat"
        settings = DriveSettings(
            drive.axis,
            "cia402",
            drive.bus,
            "",
            # positions are counted from 0 in machine files
            drive.node + line,
            node_axis=drive.node_axis,
            fieldbus=drive.fieldbus,
        )

        def at_desk() -> T:
            self._sdo = sdo
            return work(Desk(settings, sdo, self.check))

        self._stopping.clear()
        self._busy += 1
        try:
            return await loop.run_in_executor(self._pool, at_desk)
        finally:
            self._busy -= 1

    def check(self) -> None:
        """Raise `Stopped` once `stop` was called; between two transfers of a desk."""
        if self._stopping.is_set():
            raise Stopped

    def stop(self) -> None:
        """Have the desk that works do no further transfer."""
        self._stopping.set()

    def close(self) -> None:
        """End the thread behind the transfer under way."""
        self.stop()
        self._pool.shutdown(wait=False, cancel_futures=True)


def parameters_from(drive: DriveParameters) -> Sequence[Parameter]:
    """Return the parameters that a server has listed, as `mcserver.canopen.parameters.parameters_of`."""
    return [
        Parameter(
            each.index, each.subindex, each.name, cast(SdoType, each.type), each.access, each.low, each.high
        )
        for each in drive.parameters
    ]
