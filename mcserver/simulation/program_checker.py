"""Checks and simulations of whole programs, in a process of their own.

They compute for seconds and would hold the interpreter's lock all that time; the service beside them has
to go on.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import sys
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, TypeVar

from mcserver.errors import Diagnostic, Refused
from mcserver.machine.clearance_section import agent_role
from mcserver.machine.machine_file import Machine
from mcserver.planning.line_marks import LineMarks
from mcserver.planning.start_state import StartState
from mcserver.simulation.assertions import Assertion
from mcserver.simulation.foresight import Foresight, Listener, check_file, check_text
from mcserver.simulation.preview import Preview, preview
from mcserver.simulation.worker_process import end_with_parent

T = TypeVar("T")

# Programs that are computed at the same time: one client's long one does not keep the others' waiting.
WORKERS = 2
# Requests that wait or are under way: of one client, and of all.
CLIENT_REQUESTS = 4
REQUESTS = 32
# The longest that a program may compute, and after which it has to make room for others that wait [s].
LIMIT_S = 300.0
SHARED_LIMIT_S = 20.0
NICE = 10


class _Worker:
    """One worker process, started when it is first needed.

    Attributes:
        client: whose request it computes; None: it is free. since: when that began [s of the loop].
        evicted: done when others need the worker.
    """

    def __init__(self) -> None:
        self.client: str | None = None
        self.since = 0.0
        self.evicted: asyncio.Future[None] | None = None
        self._pool: ProcessPoolExecutor | None = None

    def submit(self, function: Callable[..., T], *arguments: object) -> asyncio.Future[T]:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                1, mp_context=multiprocessing.get_context("spawn"), initializer=prepare_worker
            )
        return asyncio.get_running_loop().run_in_executor(self._pool, function, *arguments)

    def kill(self) -> None:
        """End the process, whatever it is at; the next request starts another one."""
        pool, self._pool = self._pool, None
        if pool is not None:
            # its processes are private to the pool, and it has no public way to end one that computes
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.terminate()
            pool.shutdown(wait=False, cancel_futures=True)


class ProgramChecker:
    """Checks and simulations for clients, in a fair order.

    Clients take turns, whatever each has asked for; one computes at a time while others wait. A request that
    has computed for `SHARED_LIMIT_S` is ended when another client's finds no free worker.

    Args:
        machine: what programs are checked against.
        shared_limit_s: as `SHARED_LIMIT_S`.
    """

    def __init__(self, machine: Machine, *, shared_limit_s: float = SHARED_LIMIT_S) -> None:
        self._machine = machine
        self._shared_limit_s = shared_limit_s
        self._workers = [_Worker() for _ in range(WORKERS)]
        # requests that wait, by client; the client whose turn it is comes first
        self._waiting: dict[str, deque[asyncio.Future[_Worker]]] = {}
        self._requests: Counter[str] = Counter()
        self._eviction: asyncio.TimerHandle | None = None
        self._foresight = Foresight()

    async def check(
        self,
        client: str,
        text: str | Path,
        start: StartState | None = None,
    ) -> list[Diagnostic]:
        """Find every fault of a text, or of a file's.

        Args:
            start: what it starts from; None: a machine that nobody has used.

        Raises:
            ServiceError: MC508 too many wait; MC523 it took too long, or the worker died.
        """
        start = start or StartState.of(self._machine)
        if isinstance(text, Path):
            return await self._run(client, check_file, str(text), self._machine, start)
        return await self._run(client, check_text, text, self._machine, start)

    async def simulate(
        self,
        client: str,
        text: str,
        start: StartState | None = None,
        path_points: int = 0,
        lines: bool = True,
        assertions: Sequence[Assertion] = (),
        against: str | None = None,
        role: str | None = None,
    ) -> tuple[dict[str, Any], LineMarks | None]:
        """Make the object of ``mcserver simulate --json``, and marks of its times; the others as in `check`.

        Args:
            path_points: with the ``path`` of the tips in so many points at most; 0: without.
            lines: with the times of every line. assertions: are judged. against: another text, from whose
                motion this one's ``difference`` is computed. role: whose zones bind it; None: all do.

        Returns:
            The object; the marks, None where the program has faults. Raises as `check`.
        """
        start = start or StartState.of(self._machine)
        wanted = (path_points, lines, tuple(assertions), against, role)
        return await self._run(client, simulate_text, text, self._machine, start, *wanted)

    async def preview(
        self,
        client: str,
        text: str,
        start: StartState,
        axes: Sequence[int],
    ) -> Preview:
        """As `simulate`, with all that an approval of the run shows and rests on."""
        role = agent_role(client)
        return await self._run(client, preview, text, self._machine, start, tuple(axes), role)

    def foresee(
        self,
        sha256: str,
        path: Path,
        listener: Listener,
        start: StartState,
        *,
        checked: bool = False,
    ) -> None:
        """Simulate a long text while it runs (`mcserver.simulation.foresight.Foresight.begin`)."""
        self._foresight.begin(sha256, path, self._machine, start, listener, checked=checked)

    def close(self) -> None:
        """End the workers, whatever they are at."""
        self._foresight.close()
        if self._eviction is not None:
            self._eviction.cancel()
        for worker in self._workers:
            worker.kill()

    async def _run(self, client: str, function: Callable[..., T], *arguments: object) -> T:
        limit = CLIENT_REQUESTS if self._requests[client] >= CLIENT_REQUESTS else REQUESTS
        if self._requests[client] >= CLIENT_REQUESTS or self._requests.total() >= REQUESTS:
            raise Refused("MC508", f"{limit} checks and simulations wait", "send it again later", limit=limit)
        self._requests[client] += 1
        try:
            worker = await self._turn(client)
            try:
                return await self._compute(worker, function, *arguments)
            finally:
                worker.client = worker.evicted = None
                self._assign()
        finally:
            self._requests[client] -= 1
            if not self._requests[client]:
                del self._requests[client]

    async def _turn(self, client: str) -> _Worker:
        """Wait for a worker."""
        turn: asyncio.Future[_Worker] = asyncio.get_running_loop().create_future()
        self._waiting.setdefault(client, deque()).append(turn)
        self._assign()
        try:
            return await turn
        except asyncio.CancelledError:
            if turn.done() and not turn.cancelled():
                turn.result().client = None
                self._assign()
            raise

    def _assign(self) -> None:
        """Give free workers to those whose turn it is."""
        loop = asyncio.get_running_loop()
        for client in list(self._waiting):
            free = next((worker for worker in self._workers if worker.client is None), None)
            turns = self._waiting[client]
            while turns and turns[0].done():
                turns.popleft()
            if not turns:
                del self._waiting[client]
                continue
            # two at a time only where nobody else waits
            alone = len(self._waiting) == 1
            if free is None or (not alone and any(each.client == client for each in self._workers)):
                continue
            free.client, free.since, free.evicted = client, loop.time(), loop.create_future()
            turns.popleft().set_result(free)
            # the others come first from now on
            del self._waiting[client]
            if turns:
                self._waiting[client] = turns
        self._plan_eviction()

    def _plan_eviction(self) -> None:
        """See to it that a worker gets free for a client that has none while another one's computes on."""
        if self._eviction is not None:
            self._eviction.cancel()
            self._eviction = None
        served = {worker.client for worker in self._workers}
        if None in served or not self._waiting.keys() - served:
            return
        oldest = min(self._workers, key=lambda worker: worker.since)
        loop = asyncio.get_running_loop()
        self._eviction = loop.call_at(oldest.since + self._shared_limit_s, _evict, oldest, oldest.since)

    async def _compute(self, worker: _Worker, function: Callable[..., T], *arguments: object) -> T:
        assert worker.evicted is not None
        try:
            computing = worker.submit(function, *arguments)
            # of a worker that is killed nobody asks any more
            computing.add_done_callback(lambda done: done.cancelled() or done.exception())
            either: set[asyncio.Future[Any]] = {computing, worker.evicted}
            await asyncio.wait(either, timeout=LIMIT_S, return_when=asyncio.FIRST_COMPLETED)
            if computing.done():
                return computing.result()
        except BrokenProcessPool as error:
            worker.kill()
            raise _given_up("the worker process died") from error
        except asyncio.CancelledError:
            worker.kill()
            raise
        worker.kill()
        if worker.evicted.done():
            raise _given_up(f"the program took over {self._shared_limit_s:g} s while other clients waited")
        raise _given_up(f"the program took longer than {LIMIT_S:g} s")


def _evict(worker: _Worker, since: float) -> None:
    if worker.evicted is not None and worker.since == since and not worker.evicted.done():
        worker.evicted.set_result(None)


def _given_up(why: str) -> Refused:
    return Refused("MC523", why, "use `mcserver check` or `mcserver simulate` on the command line")


def prepare_worker() -> None:
    """Make this worker give way to the server, and end with it."""
    if sys.platform != "win32":
        os.nice(NICE)
    end_with_parent()


def simulate_text(
    text: str,
    machine: Machine,
    start: StartState | None = None,
    path_points: int = 0,
    lines: bool = True,
    assertions: Sequence[Assertion] = (),
    against: str | None = None,
    role: str | None = None,
) -> tuple[dict[str, Any], LineMarks | None]:
    """`mcserver.simulation.simulation.simulate`, its report and marks; runs in the worker."""
    from mcserver.machine.machine_kinematics import build_kinematics
    from mcserver.simulation.simulation import simulate

    found = simulate(
        text,
        machine,
        start=start,
        kinematics=build_kinematics(machine),
        path_points=path_points,
        assertions=assertions,
        against=against,
        role=role,
    )
    if not lines:
        found.report["lines"] = []
    # an assertion that does not hold takes nothing from the times
    return found.report, found.marks() if found.end is not None and not found.failed else None
