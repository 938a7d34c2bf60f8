"""One machine as the page sees it: connected while somebody looks, its newest state, events and jobs."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path

from mcclient import Event, Machine, MachineStatus, MotionError

from mcserver.web.control import Control
from mcserver.web.formatting import axis_name
from mcserver.web.jobs import JobQueue
from mcserver.web.last_runs import LastRuns
from mcserver.web.recorded_files import RecordedFiles
from mcserver.web.run_requests import RunRequests
from mcserver.web.shared_answers import SharedAnswers
from mcserver.web.store import ProgramStore
from mcserver.web.translation import language, mark

log = logging.getLogger(__name__)

EVENTS_KEPT = 400
ACTS_KEPT = 50
CLIENTS_PERIOD_S = 3.0
RETRY_S = 2.0
# cycles kept for charts, at the rate of the state messages
HISTORY_S = 120
HISTORY_STATES = 20 * HISTORY_S


class MachineLink:
    """Connects to one machine again and again until `close`.

    Args:
        name: the machine's.
        connect: Zenoh endpoints. config_file: a Zenoh configuration for TLS.
        store: its programs.

    Attributes:
        machine: connected, or None. status: its newest state. failure: why it is not connected.
        events: the newest ones, the newest last. history: states for charts.
    """

    def __init__(
        self, name: str, connect: tuple[str, ...], config_file: Path | None, store: ProgramStore
    ) -> None:
        self.name = name
        self.machine: Machine | None = None
        self.status: MachineStatus | None = None
        self.failure = ""
        self.events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self.event_count = 0
        self.history: deque[MachineStatus] = deque(maxlen=HISTORY_STATES)
        # whether its programs have work coordinate systems
        self.has_work_offsets = False
        # what axes are called beside their names, by axis number
        self.joints: dict[int, str] = {}
        # who else is connected, and who looks at this page: how many browsers by name
        self.clients: tuple[str, ...] = ()
        self.visitors: Counter[str] = Counter()
        # when somebody last came or left [s, never stepping]
        self.used_at = time.monotonic()
        self.closed = False
        # what was done at this page: Unix time, who, what
        self.acts: deque[tuple[float, str, str]] = deque(maxlen=ACTS_KEPT)
        self.control = Control(time.monotonic)
        self.store = store
        self.last_runs = LastRuns(store.folder / ".runs.json")
        self.jobs = JobQueue(self, store)
        self.run_requests = RunRequests()
        self.recorded = RecordedFiles(store.folder / ".recordings")
        self.answers = SharedAnswers(time.monotonic)
        # set, and replaced, when a state comes
        self._came = asyncio.Event()
        self._made: dict[tuple[str, str], tuple[MachineStatus, str]] = {}
        self._connect = connect
        self._config_file = config_file
        self._task = asyncio.ensure_future(self._run())

    @property
    def online(self) -> bool:
        """Whether its server is there now, and `status` is not what an earlier start of it has said."""
        machine, status = self.machine, self.status
        return (
            machine is not None and machine.online and (status is None or status.instance == machine.instance)
        )

    @property
    def in_use(self) -> bool:
        """Whether somebody looks at it, or programs of this page run or wait on it."""
        return bool(self.visitors) or self.jobs.running is not None or bool(self.jobs.waiting)

    def enter(self, visitor: str) -> None:
        """A browser looks at the machine."""
        self.visitors[visitor] += 1

    def leave(self, visitor: str) -> None:
        """A browser looks no more."""
        self.used_at = time.monotonic()
        self.visitors[visitor] -= 1
        if self.visitors[visitor] <= 0:
            del self.visitors[visitor]

    def once(self, key: str, make: Callable[[MachineStatus], str]) -> str:
        """Return what ``make`` gives for the newest state; made once for each language, whoever looks.

        Args:
            key: of what is made: the same for all viewers to whom the same is shown.
        """
        status = self.status
        if status is None:
            return ""
        place = (key, language())
        known = self._made.get(place)
        if known is None or known[0] is not status:
            known = self._made[place] = (status, make(status))
        return known[1]

    async def next_status(self) -> None:
        """Wait for the next state."""
        await self._came.wait()

    def connected(self) -> Machine:
        """The machine; raises MotionError (MC530) while it is not connected."""
        if self.machine is None:
            raise MotionError(
                "MC530",
                mark("{name} is not connected: {failure}", name=self.name, failure=self.failure),
                mark("is its server running?"),
            )
        return self.machine

    async def close(self) -> None:
        """End the jobs and the connection."""
        self.closed = True
        await self.jobs.close()
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def _run(self) -> None:
        while True:
            try:
                async with Machine.connect(
                    self.name, self._connect or None, client="web", config_file=self._config_file
                ) as machine:
                    self.failure = ""
                    self.machine = machine
                    self.has_work_offsets = await knows_work_offsets(machine)
                    self.joints = await joints_of(machine)
                    async with asyncio.TaskGroup() as group:
                        group.create_task(self._follow_states(machine))
                        group.create_task(self._follow_events(machine))
                        group.create_task(self.run_requests.follow(machine))
                        group.create_task(self._look_for_clients(machine))
            except (MotionError, ExceptionGroup) as error:
                first = error.exceptions[0] if isinstance(error, ExceptionGroup) else error
                self.failure = first.message if isinstance(first, MotionError) else str(first)
                log.info("%s: %s", self.name, self.failure)
            finally:
                self.machine = None
            await asyncio.sleep(RETRY_S)

    async def _follow_states(self, machine: Machine) -> None:
        async for status in machine.telemetry():
            self.status = status
            self.history.append(status)
            came, self._came = self._came, asyncio.Event()
            came.set()

    async def _look_for_clients(self, machine: Machine) -> None:
        while True:
            self.clients = tuple(await machine.clients())
            await asyncio.sleep(CLIENTS_PERIOD_S)

    async def _follow_events(self, machine: Machine) -> None:
        async for event in machine.events(history=True):
            if event.kind not in ("lines.started", "lines.ended"):
                self.events.append(event)
                self.event_count += 1


async def knows_work_offsets(machine: Machine) -> bool:
    """Return whether the machine's dialect has work coordinate systems: the reference's has none."""
    try:
        for axis in machine.info.axes:
            found = await machine.check(f"G21 G90 G10 L20 P0 {axis_name(axis.index)}0")
            # the second drive of a gantry pair has none of its own
            if found.ok or "MC110" in {each.code for each in found.diagnostics}:
                return found.ok
    except MotionError as error:
        log.info("%s: %s", machine.name, error.message)
    return False


async def joints_of(machine: Machine) -> dict[int, str]:
    """Return what axes are called beside their names: by programs, such as E, or as joints of the URDF."""
    letters = {axis.index: axis.letter for axis in machine.info.axes if axis.letter}
    if not machine.info.tools:
        return letters
    try:
        return letters | {int(axis): name for axis, name in (await machine.model()).joints.items()}
    except MotionError as error:
        log.info("%s: %s", machine.name, error.message)
        return letters
