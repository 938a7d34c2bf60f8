"""The planner in a process of its own, as the service sees it.

Planning is a lot of Python, and who computes in a process keeps its other threads waiting: beside it the
service's loop would answer late. So it has an interpreter for itself. It writes to the executor through the
memory that they share; orders and outcomes go through a connection. When the process ends by itself, its
programs are stopped on their paths, and another one is started.
"""

from __future__ import annotations

import contextlib
import logging
import multiprocessing
import queue
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence

import msgspec

from mcserver.errors import RuntimeFault
from mcserver.executor.client import ExecutorProcess
from mcserver.gcode.semantics.modal import ModalState
from mcserver.machine.machine_file import Machine
from mcserver.motion.compiling import PATIENCE_S
from mcserver.planning.planner_messages import Broken, Deliver, Orders, Outcome, PlannerStart
from mcserver.processes import start_child
from mcserver.service.executor_view import ExecutorView

log = logging.getLogger(__name__)

# The first start after an installation compiles the planner's loops.
START_TIMEOUT_S = 300.0
STOP_TIMEOUT_S = 3.0
# So often within a minute it is started again; then something is wrong that another start does not mend.
MOST_STARTS = 3
STARTS_WITHIN_S = 60.0


class PlannerChild:
    """The process and the connection to it."""

    def __init__(self, machine: Machine, executor: ExecutorProcess) -> None:
        self.connection, theirs = multiprocessing.Pipe()
        with theirs:
            start = PlannerStart(machine, executor.memory, executor.slots, theirs.fileno())
            self.process: subprocess.Popen[bytes] = start_child(
                "mcserver.planning.process", start, [executor.memory, theirs.fileno()]
            )

    def wait(self, on_patience: Callable[[], None]) -> None:
        """Until it is ready; ``on_patience`` is called once where that takes long.

        Raises:
            RuntimeFault: MC436 it ended, or did not come up in time.
        """
        deadline = time.monotonic() + START_TIMEOUT_S
        told = False
        while not self.connection.poll(PATIENCE_S):
            if time.monotonic() > deadline:
                self.kill()
                break
            if not told:
                told = True
                on_patience()
        try:
            self.connection.recv_bytes()
        except (EOFError, OSError):
            raise RuntimeFault(
                "MC436", f"the planner's process {self.ending()}", "see what it wrote to standard error"
            ) from None

    def ending(self) -> str:
        """How it ended; waits for that."""
        try:
            code = self.process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            return "closed its connection"
        return f"was ended by signal {-code}" if code < 0 else f"ended with code {code}"

    def stop(self) -> None:
        """Closes the connection, at which it ends, or is made to."""
        self.connection.close()
        try:
            self.process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill()

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


class PlannerProcess:
    """`mcserver.planning.planner_messages.Planner` in a process of its own.

    Args:
        child: is ready. start_again: starts another one, for when it has ended.
        deliver: takes what happened, in order; called in a thread.

    Attributes:
        seen: when it was last heard of [s of `time.monotonic`].
    """

    def __init__(
        self, child: PlannerChild, start_again: Callable[[], PlannerChild], deliver: Deliver
    ) -> None:
        self._child = child
        self._start_again = start_again
        self._deliver = deliver
        self._outbox: queue.SimpleQueue[Orders | None] = queue.SimpleQueue()
        # held while an order is sent, and while one process takes the place of another
        self._sending = threading.Lock()
        self._starts: deque[float] = deque(maxlen=MOST_STARTS)
        self._stopping = threading.Event()
        self.seen = time.monotonic()
        self._threads = [
            threading.Thread(target=self._send, name="planner orders", daemon=True),
            threading.Thread(target=self._receive, name="planner outcomes", daemon=True),
        ]

    def start(self) -> None:
        self.seen = time.monotonic()
        for thread in self._threads:
            thread.start()

    def order(self, order: Orders) -> None:
        """From any thread. What waits is bounded by the credit that the service gives to clients."""
        self._outbox.put(order)

    def stop(self) -> None:
        self._stopping.set()
        self._outbox.put(None)
        # the planner may be about to tell something: it is heard until it closes its end
        for thread in self._threads:
            if thread.is_alive():
                thread.join(STOP_TIMEOUT_S)
        self._child.stop()

    def _send(self) -> None:
        encode = msgspec.msgpack.Encoder().encode
        while (order := self._outbox.get()) is not None:
            # an order to one that has ended is lost with its programs, which are told so
            with self._sending, contextlib.suppress(OSError):
                self._child.connection.send_bytes(encode(order))
        with self._sending, contextlib.suppress(OSError):
            self._child.connection.send_bytes(b"")

    def _receive(self) -> None:
        decoder = msgspec.msgpack.Decoder(list[Outcome])
        while True:
            try:
                outcomes = decoder.decode(self._child.connection.recv_bytes())
            except (EOFError, OSError):
                if self._stopping.is_set() or not self._replace():
                    return
                continue
            self.seen = time.monotonic()
            if outcomes:
                self._deliver(outcomes)

    def _replace(self) -> bool:
        """Tells that the process has ended and starts another one; False where that is given up."""
        ending = self._child.ending()
        log.error("the planner's process %s", ending)
        self._deliver([Broken("", f"its process {ending}")])
        now = time.monotonic()
        if len(self._starts) == MOST_STARTS and now - self._starts[0] < STARTS_WITHIN_S:
            log.error("the planner's process is not started again; the executor will stop the machine")
            return False
        self._starts.append(now)
        try:
            child = self._start_again()
        except (OSError, RuntimeError):
            log.exception("the planner's process cannot be started again")
            return False
        with self._sending:
            self._child.connection.close()
            self._child = child
        return True


class ProcessPlanning:
    """`mcserver.planning.planner_messages.Planning` with a process; starts it at once.

    Args:
        machine: what is planned for. executor: launched; its cycles need not run yet.
    """

    def __init__(self, machine: Machine, executor: ExecutorProcess) -> None:
        self._machine = machine
        self._executor = executor
        self._view = ExecutorView(machine, lambda: executor.feedback)
        self._child = self._launch()

    def wait(self, on_patience: Callable[[], None]) -> None:
        """Until it is ready; ``on_patience`` is called once where that takes long.

        Raises:
            RuntimeFault: MC436 it ended, or did not come up in time.
        """
        self._child.wait(on_patience)

    def planner(self, deliver: Deliver) -> PlannerProcess:
        """The planner. Waited for before."""
        return PlannerProcess(self._child, self._launch, deliver)

    def modal_before(self, lines: Sequence[str]) -> ModalState:
        """Modal state after lines that are only read; from any thread.

        Raises:
            ProgramRejected: one of them has a fault.
        """
        # the interpreter and its solver are loaded where they are asked for: a start need not wait for them
        from mcserver.gcode.semantics.interpreter import modal_before
        from mcserver.machine.machine_kinematics import build_kinematics

        return modal_before(
            lines,
            len(lines) + 1,
            self._machine,
            kinematics=build_kinematics(self._machine),
            positions=self._view.positions(),
        ).modal

    def close(self) -> None:
        """Ends the process that was started first, where no planner has taken it over and ended it."""
        if not self.closed:
            self._child.stop()

    @property
    def closed(self) -> bool:
        """Whether that process has ended."""
        return self._child.process.poll() is not None

    def _launch(self) -> PlannerChild:
        return PlannerChild(self._machine, self._executor)
