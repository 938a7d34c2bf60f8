"""The recorder as the server sees it: a process beside it that may stall or die without any effect here."""

from __future__ import annotations

import asyncio
import itertools
import logging
import socket
import subprocess
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path

import msgspec

from mcserver.errors import ServiceError
from mcserver.executor.client import ExecutorProcess
from mcserver.machine.machine_file import Machine
from mcserver.planning.message_pipe import MessagePipe, WatchedPipe
from mcserver.processes import start_child
from mcserver.recorder import messages as wire
from mcserver.recorder.folder import RecordingFolder
from mcserver.service.event_log import EventLog
from mcserver.service.reports import Event

log = logging.getLogger(__name__)

# Events go out together so often [s].
EVENTS_PERIOD_S = 0.05
# Bytes that may wait for a recorder that does not read; events beyond are counted, not kept.
MAX_WAITING = 4 << 20
MAX_EVENTS = 5_000
STOP_TIMEOUT_S = 5.0
# A large black box on a slow disk takes its time [s].
ANSWER_LIMIT_S = 60.0
MOST_STARTS, STARTS_WITHIN_S = 3, 60.0

Waiter = asyncio.Future[wire.Answer]


class RecorderChild:
    """One start of the process, and the pipe to it."""

    def __init__(self, machine: Machine, executor: ExecutorProcess, start: wire.RecorderStart) -> None:
        ours, theirs = socket.socketpair()
        self.pipe = MessagePipe(ours)
        with theirs:
            complete = msgspec.structs.replace(
                start, machine=machine, memory=executor.memory, pipe=theirs.fileno()
            )
            self.process: subprocess.Popen[bytes] = start_child(
                "mcserver.recorder.process", complete, [executor.memory, theirs.fileno()]
            )

    def end(self) -> None:
        """Wait for its end within a limit, or make it end."""
        self.pipe.close()
        try:
            self.process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


class RecorderClient:
    """Starts the recorder, sends it events and commands; belongs to the loop."""

    def __init__(
        self, launch: Callable[[], RecorderChild], folder: RecordingFolder, events: Callable[[], EventLog]
    ) -> None:
        self.folder = folder
        self._launch = launch
        self._events = events
        self._loop = asyncio.get_running_loop()
        self._encode = msgspec.msgpack.Encoder().encode
        self._decode: Callable[[bytes], wire.Report] = msgspec.msgpack.Decoder(wire.Report).decode
        self._child: RecorderChild | None = None
        self._watched: WatchedPipe | None = None
        self._pending: list[Event] = []
        self._lost = 0
        self._flushing: asyncio.TimerHandle | None = None
        self._tickets = itertools.count(1)
        self._answers: dict[int, Waiter] = {}
        self._starts: deque[float] = deque(maxlen=MOST_STARTS)
        self._stopping = False

    def start(self) -> None:
        """Start the process; nothing waits for it."""
        self._starts.append(time.monotonic())
        try:
            child = self._launch()
        except (OSError, RuntimeError) as error:
            self._events().warn("MC580", f"the recorder cannot be started: {error}; there is no black box")
            return
        self._child = child
        self._watched = WatchedPipe(self._loop, child.pipe, self._receive)

    @property
    def running(self) -> bool:
        return self._child is not None

    def on_event(self, event: Event) -> None:
        """Pass an event on, together with its neighbours; never waits."""
        if self._stopping:
            return
        if len(self._pending) >= MAX_EVENTS:
            self._lost += 1
            return
        self._pending.append(event)
        if self._flushing is None:
            self._flushing = self._loop.call_later(EVENTS_PERIOD_S, self._flush_events)

    async def record(self, name: str, max_s: float | None) -> str:
        """Begin a recording; its name. Raises ServiceError MC580, MC584, MC586."""
        return (await self._ask(lambda ticket: wire.StartRecording(ticket, name, max_s))).name

    async def stop_recording(self, name: str) -> str:
        """End a recording, the only one without a name; its name once it is whole.

        Raises:
            ServiceError: MC580, MC582, MC585.
        """
        return (await self._ask(lambda ticket: wire.StopRecording(ticket, name))).name

    async def save(self, reason: str) -> str:
        """Write the black box out; its name once it is whole. Raises ServiceError MC580, MC582."""
        return (await self._ask(lambda ticket: wire.SaveBlackBox(ticket, reason))).name

    async def status(self) -> wire.RecorderStatus | None:
        """Return what it holds; None while there is no recorder."""
        try:
            return (await self._ask(wire.AskStatus)).status
        except ServiceError:
            return None

    async def close(self) -> None:
        """End the process in order: it finishes its files."""
        self._flush_events()
        self._stopping = True
        child = self._child
        if child is None:
            return
        self._send(self._encode(wire.Quit()))
        self._disconnect("the server is stopping")
        await asyncio.to_thread(child.end)

    # ------------------------------------------------------------ inside

    async def _ask(self, command: Callable[[int], wire.Command]) -> wire.Answer:
        if self._child is None or self._stopping:
            raise ServiceError(
                "MC580", "there is no recorder", "[recorder] enabled; the server's log says why"
            )
        ticket = next(self._tickets)
        # what has happened before belongs to what is asked for
        self._flush_events()
        waiter: Waiter = self._loop.create_future()
        self._answers[ticket] = waiter
        self._send(self._encode(command(ticket)))
        try:
            async with asyncio.timeout(ANSWER_LIMIT_S):
                answer = await waiter
        except TimeoutError:
            raise ServiceError(
                "MC580", f"the recorder has not answered for {ANSWER_LIMIT_S:g} s", "is its disk stuck?"
            ) from None
        finally:
            self._answers.pop(ticket, None)
        if answer.code:
            raise ServiceError(answer.code, answer.message, answer.hint)
        return answer

    def _flush_events(self) -> None:
        if self._flushing is not None:
            self._flushing.cancel()
            self._flushing = None
        if not self._pending and not self._lost:
            return
        events, self._pending = self._pending, []
        if self._child is None:
            return
        if self._child.pipe.waiting > MAX_WAITING:
            self._lost += len(events)
            return
        lost, self._lost = self._lost, 0
        self._send(self._encode(wire.ServiceEvents(events, lost)))

    def _send(self, payload: bytes) -> None:
        if self._watched is not None:
            self._watched.send(payload)

    def _receive(self) -> None:
        child = self._child
        if child is None:
            return
        try:
            messages = child.pipe.receive()
        except EOFError:
            self._disconnect("the recorder has ended")
            if not self._stopping:
                self._loop.run_in_executor(None, child.end).add_done_callback(lambda _: self._replace(child))
            return
        for message in messages:
            self._take(self._decode(message))

    def _take(self, report: wire.Report) -> None:
        if isinstance(report, wire.Answer):
            waiter = self._answers.get(report.ticket)
            if waiter is not None and not waiter.done():
                waiter.set_result(report)
        elif isinstance(report, wire.Saved):
            log.info("recording %s written, %d bytes: %s", report.name, report.size, report.reason)
            self._events().publish("recording", reason=report.reason, message=report.name)
        else:
            self._events().warn(report.code, report.message)

    def _disconnect(self, message: str) -> None:
        child, self._child = self._child, None
        if child is None:
            return
        if self._watched is not None:
            self._watched.release()
            self._watched = None
        for waiter in self._answers.values():
            if not waiter.done():
                waiter.set_exception(ServiceError("MC580", message, "ask again"))

    def _replace(self, child: RecorderChild) -> None:
        if self._stopping:
            return
        code = child.process.returncode
        ending = (
            f"was ended by signal {-code}" if code is not None and code < 0 else f"ended with code {code}"
        )
        if len(self._starts) == MOST_STARTS and time.monotonic() - self._starts[0] < STARTS_WITHIN_S:
            self._events().warn(
                "MC580", f"the recorder {ending}, once too often: there is no black box until a restart"
            )
            return
        self._events().warn(
            "MC580", f"the recorder {ending}; what it held is lost, and another one is started"
        )
        self.start()


def recorder_for(
    machine: Machine,
    executor: ExecutorProcess,
    instance: str,
    journal: Path,
    events: Callable[[], EventLog],
) -> RecorderClient | None:
    """Return the recorder of a running executor; None where the machine file switches it off. In a loop."""
    if not machine.recorder.enabled:
        return None
    asked = machine.recorder.folder
    folder = (
        (journal.parent / Path(asked).expanduser()) if asked else journal.parent / "recordings" / machine.name
    )
    start = wire.RecorderStart(machine, -1, -1, executor.epoch, instance, str(folder), str(journal))
    return RecorderClient(lambda: RecorderChild(machine, executor, start), RecordingFolder(folder), events)
