"""Lines from a source that may block, such as a file or standard input, without blocking the loop."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from collections.abc import AsyncGenerator, Iterable

BUFFER_LINES = 4096


class _Reader:
    """Reads in a thread of its own, at most `BUFFER_LINES` ahead; each line is handed on as soon as it is
    there.
    """

    def __init__(self, lines: Iterable[str], loop: asyncio.AbstractEventLoop) -> None:
        self.arrived = asyncio.Event()
        self.ended = False
        self.failure: BaseException | None = None
        self._lines = lines
        self._loop = loop
        self._buffer: deque[str] = deque()
        self._room = threading.Condition()
        self._stopped = False

    def take(self) -> deque[str]:
        """Return what has been read since the last time."""
        with self._room:
            taken, self._buffer = self._buffer, deque()
            self._room.notify()
        return taken

    def stop(self) -> None:
        """Reads no further than to the next line."""
        with self._room:
            self._stopped = True
            self._room.notify()

    def read(self) -> None:
        """Runs in the thread."""
        try:
            for line in self._lines:
                with self._room:
                    while len(self._buffer) >= BUFFER_LINES and not self._stopped:
                        self._room.wait()
                    if self._stopped:
                        return
                    self._buffer.append(line)
                    first = len(self._buffer) == 1
                if first:
                    self._wake()
        except BaseException as error:
            # raised where the lines are read, in the loop
            self.failure = error
        finally:
            self.ended = True
            self._wake()

    def _wake(self) -> None:
        try:
            self._loop.call_soon_threadsafe(self.arrived.set)
        except RuntimeError:
            # the loop is closed: nobody waits any more
            self._stopped = True


async def from_thread(lines: Iterable[str]) -> AsyncGenerator[str, None]:
    """Return the same lines, read in another thread; what reading raises is raised here."""
    reader = _Reader(lines, asyncio.get_running_loop())
    # a daemon: a read of the terminal cannot be interrupted, and must not keep the program from ending
    threading.Thread(target=reader.read, name="mcclient-lines", daemon=True).start()
    try:
        while True:
            reader.arrived.clear()
            ended = reader.ended
            for line in reader.take():
                yield line
            if ended:
                break
            await reader.arrived.wait()
        if reader.failure is not None:
            raise reader.failure
    finally:
        reader.stop()
