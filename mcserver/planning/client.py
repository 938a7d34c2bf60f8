"""The service's client of the planner, which runs in a process of its own.

Planning is much Python, and would keep the other threads of its process waiting, the service's loop among
them. The planner writes to the executor through shared memory; commands and events go through a socket that
the loop reads and writes. When the process ends unexpectedly, its programs are stopped on their paths, and
another process is started.
"""

from __future__ import annotations

import asyncio
import contextlib
import enum
import logging
import select
import socket
import subprocess
import time
from collections import deque
from collections.abc import Callable, Sequence

import msgspec

from mcserver.errors import RuntimeFault
from mcserver.executor.client import ExecutorProcess
from mcserver.machine.machine_file import Machine
from mcserver.motion.compiling import DISABLE_JIT, kernels_kept, needs_compiler, start_compiling
from mcserver.planning.message_pipe import MessagePipe, WatchedPipe
from mcserver.planning.planner_messages import (
    Begin,
    Dropped,
    OnPlannerEvents,
    PlannerCommand,
    PlannerEvent,
    PlannerFailed,
    PlannerStart,
)
from mcserver.planning.start_state import StartState, StateBefore
from mcserver.processes import start_child

log = logging.getLogger(__name__)

# Longest start: without a writable cache each start compiles the kernels.
START_TIMEOUT_S = 300.0
# Silence allowed to a planner without machine code, beyond that of any other: on a busy computer one plan may
# take longer than the latter. Motion that it is late for stops on its path meanwhile.
PLAIN_SILENCE_S = 25.0
# Period of checking whether kernels have been compiled and no program is open.
COMPILED_LOOK_S = 1.0
STOP_TIMEOUT_S = 3.0
# Most restarts within a minute: after that another start would not help.
MOST_STARTS = 3
STARTS_WITHIN_S = 60.0


class PlannerChild:
    """The process and the pipe to it.

    Attributes:
        plain: it plans without machine code, which a process in the background compiles.
    """

    def __init__(self, machine: Machine, executor: ExecutorProcess) -> None:
        self.plain = needs_compiler()
        if self.plain:
            start_compiling()
        ours, theirs = socket.socketpair()
        self.pipe = MessagePipe(ours)
        with theirs:
            start = PlannerStart(machine, executor.memory, theirs.fileno())
            self.process: subprocess.Popen[bytes] = start_child(
                "mcserver.planning.process",
                start,
                [executor.memory, theirs.fileno()],
                DISABLE_JIT if self.plain else {},
            )

    def wait(self) -> None:
        """Wait until it is ready.

        Raises:
            RuntimeFault: MC436 it ended, or did not come up in time.
        """
        poller = select.poll()
        poller.register(self.pipe, select.POLLIN)
        if not poller.poll(1000.0 * START_TIMEOUT_S):
            self.kill()
            self.pipe.close()
            raise RuntimeFault(
                "MC436",
                f"the planner's process was not ready within {START_TIMEOUT_S:g} s, and the server ended it",
                "see what it wrote to standard error; on a computer that is busy, start the server again",
            )
        try:
            self.pipe.receive()
        except EOFError:
            self.pipe.close()
            raise RuntimeFault(
                "MC436", f"the planner's process {self.ending()}", "see what it wrote to standard error"
            ) from None

    def ending(self) -> str:
        """Wait for its end, and return in words how it ended."""
        try:
            code = self.process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill()
            return "closed its connection"
        return f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"

    def stop(self) -> None:
        """Close the pipe, at which the process ends; kill it if it does not."""
        self.pipe.close()
        try:
            self.process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill()

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


class ConnectionPhase(enum.Enum):
    """Phase of the connection to a planner's process."""

    CONNECTED = "connected"
    REPLACING = "replacing"  # it has ended, or was ended, and another one is being started; commands wait
    ENDED = "ended"  # stopped, or given up: commands go nowhere


class PlannerProcess:
    """The service's end of the pipe to a planner's process; belongs to the loop.

    Args:
        child: a ready process. start_again: starts another one after an unexpected end; called in a thread.
        on_events: called with the planner's events, in order.

    Attributes:
        last_seen: time of its last sign of life [s of `time.monotonic`]; the present time while the process
            is replaced: its programs have been stopped, and a start takes longer than the allowed silence.
    """

    def __init__(
        self, child: PlannerChild, start_again: Callable[[], PlannerChild], on_events: OnPlannerEvents
    ) -> None:
        self._start_again = start_again
        self._on_events = on_events
        self._loop = asyncio.get_running_loop()
        self._encode = msgspec.msgpack.Encoder().encode
        self._decode = msgspec.msgpack.Decoder(list[PlannerEvent]).decode
        self._child = child
        self._phase = ConnectionPhase.REPLACING
        # commands for which there is no process yet
        self._unsent: list[PlannerCommand] = []
        self._watched: WatchedPipe | None = None
        self._starts: deque[float] = deque(maxlen=MOST_STARTS)
        self._replacing: asyncio.Task[None] | None = None
        self._upgrading: asyncio.Task[None] | None = None
        # programs that it has begun and not dropped
        self._open: set[str] = set()
        self._stopping = False
        self._ended = asyncio.Event()
        self._heard_at = time.monotonic()
        # time until which a restarted process may be silent
        self._silent_until = 0.0

    @property
    def last_seen(self) -> float:
        now = time.monotonic()
        starting = self._phase is ConnectionPhase.CONNECTED and now < self._silent_until
        if self._phase is ConnectionPhase.REPLACING or starting:
            return now
        return min(self._heard_at + PLAIN_SILENCE_S, now) if self._child.plain else self._heard_at

    def start(self) -> None:
        self._heard_at = time.monotonic()
        self._connect(self._child)
        self._watch_compiler()

    def send(self, command: PlannerCommand) -> None:
        """Queue a command; all commands of one turn of the loop are sent together.

        The credit given to clients bounds the queue.
        """
        if isinstance(command, Begin):
            self._open.add(command.program)
        if self._phase is ConnectionPhase.CONNECTED:
            self._send(self._encode(command))
        elif self._phase is ConnectionPhase.REPLACING:
            self._unsent.append(command)

    async def stop(self) -> None:
        """End the process; its events are received until it closes its end."""
        self._stopping = True
        if self._upgrading is not None:
            self._upgrading.cancel()
        if self._phase is ConnectionPhase.CONNECTED:
            self._send(b"")
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._ended.wait(), STOP_TIMEOUT_S)
        if self._watched is not None:
            self._disconnect(ConnectionPhase.ENDED)
        if self._replacing is not None:
            await self._replacing
        await asyncio.to_thread(self._child.stop)

    def _connect(self, child: PlannerChild) -> None:
        self._child = child
        self._phase = ConnectionPhase.CONNECTED
        self._watched = WatchedPipe(self._loop, child.pipe, self._receive)
        unsent, self._unsent = self._unsent, []
        for command in unsent:
            self.send(command)

    def _disconnect(self, phase: ConnectionPhase) -> None:
        if self._watched is not None:
            self._watched.release()
            self._watched = None
        self._phase = phase

    def _send(self, message: bytes) -> None:
        # commands to a process that has ended are dropped: its programs end too
        if self._watched is not None:
            self._watched.send(message)

    def _receive(self) -> None:
        try:
            messages = self._child.pipe.receive()
        except EOFError:
            self._ended.set()
            ordered = self._phase is ConnectionPhase.REPLACING
            self._disconnect(ConnectionPhase.ENDED if self._stopping else ConnectionPhase.REPLACING)
            if not self._stopping:
                replace = self._start_another if ordered else self._replace
                self._replacing = self._loop.create_task(replace(self._child))
            return
        self._heard_at = time.monotonic()
        self._silent_until = 0.0
        for message in messages:
            events = self._decode(message)
            self._open -= {event.program for event in events if isinstance(event, Dropped)}
            if events:
                self._on_events(events)

    def _watch_compiler(self) -> None:
        if self._child.plain:
            self._upgrading = self._loop.create_task(self._upgrade())

    async def _upgrade(self) -> None:
        """Replace a process without machine code once the kernels are compiled and no program is open."""
        while True:
            await asyncio.sleep(COMPILED_LOOK_S)
            idle = self._phase is ConnectionPhase.CONNECTED and not self._open
            if not idle or not await asyncio.to_thread(kernels_kept) or self._open:
                continue
            # its last events are still received; commands wait for the new process
            self._send(b"")
            self._phase = ConnectionPhase.REPLACING
            return

    async def _start_another(self, child: PlannerChild) -> None:
        await asyncio.to_thread(child.stop)
        await self._start()

    async def _replace(self, child: PlannerChild) -> None:
        """Stop the programs of a process that has ended, and start another process."""
        ending = await asyncio.to_thread(child.ending)
        child.pipe.close()
        log.error("the planner's process %s", ending)
        # commands sent meanwhile are for programs that end now
        self._unsent.clear()
        self._open.clear()
        self._on_events([PlannerFailed("", f"its process {ending}")])
        now = time.monotonic()
        if len(self._starts) == MOST_STARTS and now - self._starts[0] < STARTS_WITHIN_S:
            log.error("the planner's process is not started again; the executor will stop the machine")
            self._phase = ConnectionPhase.ENDED
            return
        self._starts.append(now)
        await self._start()

    async def _start(self) -> None:
        """Start another process, and send it the commands that have waited."""
        try:
            self._child = await asyncio.to_thread(self._start_again)
        except (OSError, RuntimeError):
            log.exception("the planner's process cannot be started again")
            self._phase = ConnectionPhase.ENDED
            return
        if not self._stopping:
            self._silent_until = time.monotonic() + START_TIMEOUT_S
            self._connect(self._child)
            self._watch_compiler()


class ProcessPlanning:
    """Plan a machine's programs in a process, which is started at once.

    Args:
        executor: launched; its cycles need not run yet.
    """

    def __init__(self, machine: Machine, executor: ExecutorProcess) -> None:
        self._machine = machine
        self._executor = executor
        self._child = self._launch()

    def wait(self) -> None:
        """Wait until it is ready.

        Raises:
            RuntimeFault: MC436 it ended, or did not come up in time.
        """
        self._child.wait()

    def planner(self, on_events: OnPlannerEvents) -> PlannerProcess:
        """Make the planner's client, in the loop; call `wait` first."""
        return PlannerProcess(self._child, self._launch, on_events)

    def state_before(self, lines: Sequence[str], origin: StartState, axes: frozenset[int]) -> StateBefore:
        """Return the state after lines, without moving anything; callable from any thread.

        Args:
            origin: the machine as the program begins. axes: that it may name.

        Raises:
            ProgramRejected: one of them has a fault.
        """
        # imported here, so that the server's start need not wait for the interpreter and its solver
        from mcserver.machine.machine_kinematics import build_kinematics
        from mcserver.planning.state_before import state_before

        kinematics = build_kinematics(self._machine)
        return state_before(lines, len(lines) + 1, self._machine, origin, kinematics=kinematics, lease=axes)

    def close(self) -> None:
        """End the first process, if no planner has taken it over and ended it."""
        if not self.closed:
            self._child.stop()

    @property
    def closed(self) -> bool:
        """Whether that process has ended."""
        return self._child.process.poll() is not None

    def _launch(self) -> PlannerChild:
        return PlannerChild(self._machine, self._executor)
