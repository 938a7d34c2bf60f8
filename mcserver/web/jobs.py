"""The queue of programs that operators have started from the page: one runs at a time, the others wait."""

from __future__ import annotations

import asyncio
import enum
import itertools
import time
from collections import deque
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from mcclient import Diagnostic, Machine, MotionError, Program, ProgramStatus, RequestRefused
from mcclient.types import Continuation, SimulatedPath, SimulateReply

from mcserver.errors import McError
from mcserver.web.formatting import is_live
from mcserver.web.last_runs import LastRun
from mcserver.web.store import ProgramStore
from mcserver.web.thumbnails import find_thumbnail
from mcserver.web.translation import mark

if TYPE_CHECKING:
    from mcserver.web.link import MachineLink

MAX_WAITING = 100
ENDED_KEPT = 20
# Greater texts are judged line by line as they run.
SIMULATED_BYTES = 8 * 1024 * 1024
# Programs up to here are simulated when they start: the answer has each of their lines.
AHEAD_BYTES = 512 * 1024
# Points of a program's path that a browser draws.
PATH_POINTS = 4000


class JobState(enum.Enum):
    """Where a job stands."""

    WAITING = "waiting"
    CHECKING = "being checked"
    RUNNING = "running"
    FINISHED = "finished"
    FAILED = "failed"
    CANCELLED = "cancelled"


class Middle(NamedTuple):
    """How a job begins in the middle, as a person has agreed to it.

    Attributes:
        program: that it goes on with; empty: with none. whole: the server has all of its lines.
        way, outputs: as of the call ``continue_program``.
    """

    program: str = ""
    way: bool = False
    outputs: Literal["set", "leave"] | None = None
    whole: bool = False


WHOLE = Middle()


class Switches(NamedTuple):
    """An operator's switches as the calls take them."""

    block_delete: bool = False
    optional_stop: bool = True


AS_WRITTEN = Switches()


class Job:
    """One program to run, by whom, and how it went.

    Attributes:
        duration_s: simulated; None where it is not known. start: where the axes were [mm, deg], once it runs.
        path: where it goes from there, as the call ``simulate`` gives it; None where that is not known.
        program: the server's id, once it runs. single_step: its lines wait to be started.
        stepped: number of the last line that was started so. switches: of the operator who queued it.
        thumbnail: the picture that the slicer has put into its text. is_file: whether it is a stored program.
    """

    def __init__(
        self,
        number: int,
        name: str,
        text: str,
        user: str,
        from_line: int,
        middle: Middle,
        switches: Switches = AS_WRITTEN,
    ) -> None:
        self.number = number
        self.name = name
        self.lines = text.split("\n")
        self.thumbnail = find_thumbnail(text)
        self.is_file = False
        self.user = user
        self.from_line = from_line
        self.middle = middle
        self.switches = switches
        self.state = JobState.WAITING
        self.duration_s: float | None = None
        self.program: str | None = None
        self.single_step = False
        self.stepped = from_line - 1
        self.started_at: float | None = None
        self.start: dict[int, float] | None = None
        self.path: dict[str, Any] | None = None
        self.message = ""
        self.hint = ""
        self.diagnostics: tuple[Diagnostic, ...] = ()

    def take(self, report: SimulateReply) -> None:
        """Learn the duration and the path from a simulation that found no fault."""
        if self.from_line == 1:
            self.duration_s = float(report.duration_s)
        if report.path is not None:
            self.path = path_from_line(report.path, self.from_line)


def path_from_line(path: SimulatedPath, first: int) -> dict[str, Any]:
    """Return the part of a simulated path that belongs to the lines from ``first`` on, for the page."""
    kept = [row for row, line in enumerate(path.lines) if first <= 1 or line >= first]
    tips = [{"tool": tip.tool, "points": [tip.points[row] for row in kept]} for tip in path.tips]
    return {"lines": [path.lines[row] for row in kept], "tips": tips}


class JobQueue:
    """Runs jobs on one machine, in order; after one that failed the queue stops until it is started again.

    Args:
        link: the machine. store: where the programs are.

    Attributes:
        running, waiting, ended: the jobs. latest: the one started last.
        stopped: whether a failure or an operator has stopped what runs and waits; once nothing of it is left,
            the next job starts.
        single_step: whether jobs that start from now on do so in single step.
        switches: of programs that are queued from now on; what goes on behind a break has those that it had.
    """

    def __init__(self, link: MachineLink, store: ProgramStore) -> None:
        self.running: Job | None = None
        self.latest: Job | None = None
        self.waiting: deque[Job] = deque()
        self.ended: deque[Job] = deque(maxlen=ENDED_KEPT)
        self.stopped = False
        self.single_step = False
        self.switches = AS_WRITTEN
        self._link = link
        self._store = store
        self._numbers = itertools.count(1)
        self._task: asyncio.Task[None] | None = None
        self._estimates: set[asyncio.Task[None]] = set()
        self._estimating = asyncio.Lock()

    def add(
        self,
        name: str,
        user: str,
        from_line: int = 1,
        *,
        seen: str | None = None,
        report: SimulateReply | None = None,
        middle: Middle = WHOLE,
        switches: Switches | None = None,
    ) -> Job:
        """Queue a stored program.

        Args:
            seen: the text that somebody has looked at; None: nobody has. report: of its simulation.
            middle: how it begins behind line 1. switches: that were looked at with it; None: those of now.

        Raises:
            ServiceError: MC061 it cannot be read.
            MotionError: MC062 the queue is full, the program does not have the line, or is another one than
                was looked at.
        """
        self._refuse_more()
        text, switches = self._store.read(name), switches or self.switches
        if seen not in (None, text):
            raise MotionError(
                "MC062",
                mark("{name} has another text than was looked at", name=name),
                mark("look at it once more"),
            )
        job = Job(next(self._numbers), name, text, user, from_line, middle, switches)
        job.is_file = True
        if not 1 <= from_line <= len(job.lines):
            raise MotionError(
                "MC062",
                mark("{name} has no line {line}", name=name, line=from_line),
                mark("it has {count} lines", count=len(job.lines)),
            )
        if report is not None:
            job.take(report)
        self._append(job)
        return job

    def add_text(self, name: str, text: str, user: str) -> Job:
        """Queue a text that is no file.

        Raises:
            MotionError: MC062 the queue is full.
        """
        self._refuse_more()
        job = Job(next(self._numbers), name, text, user, 1, WHOLE, self.switches)
        self._append(job)
        return job

    def _refuse_more(self) -> None:
        if len(self.waiting) >= MAX_WAITING:
            raise MotionError(
                "MC062",
                mark("{count} programs wait already", count=MAX_WAITING),
                mark("let some of them run first"),
            )

    def go_on(self, shown: Continuation, user: str, middle: Middle) -> Job:
        """Queue a program that goes on, from the server's journal and, behind that, from the stored file.

        Raises:
            MotionError: MC062 the server does not have all of its text, and no stored file has it either.
        """
        text = self._text_of(shown)
        if text is None and not shown.whole:
            raise MotionError(
                "MC062",
                mark(
                    "of {name} only lines through {line} are known",
                    name=shown.name or shown.program,
                    line=shown.accepted,
                ),
                mark("upload its file under the same name, then go on"),
            )
        switches = Switches(shown.block_delete, shown.optional_stop)
        middle = middle._replace(whole=shown.whole)
        job = Job(next(self._numbers), shown.name, text or "", user, shown.line, middle, switches)
        self._append(job)
        return job

    def _text_of(self, shown: Continuation) -> str | None:
        """Return the stored file that a program was run from; None: there is none with the same lines."""
        try:
            text = self._store.read(shown.name)
        except McError:
            return None
        if shown.sha256 is not None and shown.sha256 == Machine.hash_of(text):
            return text
        lines = text.split("\n")[shown.first - 1 :][: len(shown.lines)]
        return text if shown.lines and lines == list(shown.lines) else None

    def _append(self, job: Job) -> None:
        if self.running is None and not self.waiting:
            # nothing is left of what was stopped: this is a new start
            self.stopped = False
        self.waiting.append(job)
        self._link.acts.append((time.time(), job.user, mark("run {name}", name=job.name)))
        if self.running is not None:
            self._look_ahead(job)
        self._begin()

    def start_again(self) -> None:
        """Go on with what waits, after a failure."""
        self.stopped = False
        self._begin()

    def remove(self, number: int) -> None:
        """Take a job that waits out of the queue."""
        for job in list(self.waiting):
            if job.number == number:
                self.waiting.remove(job)
                job.state = JobState.CANCELLED

    def stop(self) -> None:
        """Start nothing more, and take every waiting job out, as an emergency stop does."""
        self.stopped = True
        while self.waiting:
            self.waiting.popleft().state = JobState.CANCELLED

    def stop_checking(self) -> None:
        """Keep what is still being checked from starting: somebody has stopped what runs."""
        if self.running is not None and self.running.state is JobState.CHECKING:
            self.stopped = True

    async def step(self, done: int) -> None:
        """Start the next line of the job that runs in single step, and the blank ones behind it.

        Args:
            done: number of the last line that is done.

        Raises:
            MotionError: MC062 no job waits for it; as the call ``step``.
        """
        job = self.running
        if job is None or job.program is None or not job.single_step:
            raise MotionError(
                "MC062", mark("no program runs in single step"), mark("switch single step on, then run it")
            )
        if done < job.stepped:
            # steps add up at the server: a second press would let two lines go
            raise MotionError(
                "MC062", mark("line {line} is not done", line=job.stepped), mark("wait for its end")
            )
        machine, first = self._link.connected(), max(job.stepped, done) + 1
        job.stepped = first
        while job.stepped < len(job.lines) and not job.lines[job.stepped].strip():
            job.stepped += 1
        for line in range(first, job.stepped + 1):
            try:
                await machine.step(job.program)
            except RequestRefused:
                job.stepped = line - 1
                raise

    @property
    def begun(self) -> list[Job]:
        """The jobs that have begun: what runs, then those that have ended, the newest first."""
        return [*([] if self.running is None else [self.running]), *self.ended]

    def failed(self, program: ProgramStatus | None) -> Job | None:
        """Return the job that has failed, unless a program runs or has run since.

        Args:
            program: the machine's current one.
        """
        if not self.ended or self.ended[0].state is not JobState.FAILED or is_live(program):
            return None
        job = self.ended[0]
        since = program is not None and program.program != job.program
        return None if since and program is not None and program.opened_at > (job.started_at or 0.0) else job

    def programs(self) -> set[str]:
        """Ids of the programs that were jobs of this queue."""
        return {job.program for job in self.begun if job.program is not None}

    def remaining_s(self) -> float | None:
        """Time of all that waits, as simulated [s]; None where one of them is not known."""
        total = 0.0
        for job in self.waiting:
            if job.duration_s is None:
                return None
            total += job.duration_s
        return total

    async def close(self) -> None:
        """End the runner; a program under way is aborted."""
        tasks = [*self._estimates, *([] if self._task is None else [self._task])]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    def _begin(self) -> None:
        if self._task is None or self._task.done():
            self._task = asyncio.ensure_future(self._run())

    async def _run(self) -> None:
        while self.waiting and not self.stopped:
            job = self.latest = self.running = self.waiting.popleft()
            job.state, job.started_at = JobState.CHECKING, time.time()
            try:
                await self._run_one(job)
                job.state = JobState.FINISHED
            except MotionError as error:
                job.state, job.message, job.hint = JobState.FAILED, error.message, error.hint
                job.diagnostics = error.diagnostics
                self.stopped = bool(self.waiting)
            finally:
                if job.state in (JobState.CHECKING, JobState.RUNNING):
                    job.state = JobState.CANCELLED
                self.running = None
                self.ended.appendleft(job)
                self._note(job)

    def _note(self, job: Job) -> None:
        """Keep how a program went that has begun."""
        if job.program is not None and job.started_at is not None:
            now = time.time()
            run = LastRun(job.state.value, now, now - job.started_at, job.user)
            self._link.last_runs.note(job.name, run)

    async def _run_one(self, job: Job) -> None:
        machine = self._link.connected()
        status = await machine.status()
        job.start = dict(zip(status.axes.index, status.axes.setpoint, strict=True))
        if job.from_line == 1 and not job.middle.program:
            await self._check(machine, job)
        self._refuse_stopped(job)
        # behind the check, which would wait for it
        self._look_ahead(job)
        program = await self._opened(machine, job)
        job.program, job.state = program.id, JobState.RUNNING
        async with program:
            # it may have been stopped while the server opened it
            self._refuse_stopped(job)
            if not job.middle.whole:
                await program.send_lines(job.lines[program.given_through :])

    def _refuse_stopped(self, job: Job) -> None:
        if self.stopped:
            raise MotionError(
                "MC062",
                mark("{name} was being checked as the queue was stopped", name=job.name),
                mark("run it again"),
            )

    async def _opened(self, machine: Machine, job: Job) -> Program:
        middle = job.middle
        if middle.program and self.single_step:
            raise MotionError(
                "MC062",
                mark("what goes on behind a break has no single step"),
                mark("switch single step off"),
            )
        job.single_step = self.single_step
        if middle.program:
            return await machine.continue_program(
                # without a line: however often it is asked for, no line runs again
                middle.program,
                way=middle.way,
                outputs=middle.outputs,
            )
        return await machine.program(
            job.name,
            start_line=job.from_line,
            before=job.lines[: job.from_line - 1],
            step=job.single_step,
            **job.switches._asdict(),
            text="\n".join(job.lines),
            way=middle.way,
            outputs=middle.outputs,
        )

    def _look_ahead(self, job: Job) -> None:
        self._estimates.add(task := asyncio.ensure_future(self._estimate(job)))
        task.add_done_callback(self._estimates.discard)

    async def _estimate(self, job: Job) -> None:
        """Simulate a job for its duration and its path; without them where the server does not give them."""
        text = "\n".join(job.lines)
        if len(text) > AHEAD_BYTES:
            return
        # one at a time: the server takes few of a client at once, and somebody waits for the others
        async with self._estimating:
            if job.state not in (JobState.WAITING, JobState.CHECKING, JobState.RUNNING):
                return
            points = 0 if job.start is None else PATH_POINTS
            try:
                report = await self._link.connected().simulate(
                    text, positions=job.start, path_points=points, role="operator", **job.switches._asdict()
                )
            except MotionError:
                return
        if report.ok:
            job.take(report)

    async def _check(self, machine: Machine, job: Job) -> None:
        """Refuse a text with faults before anything of it moves."""
        text = "\n".join(job.lines)
        if len(text) > SIMULATED_BYTES:
            return
        found = await machine.check(text, positions=job.start, **job.switches._asdict())
        if not found.ok:
            first = next(each for each in found.diagnostics if each.severity == "error")
            raise MotionError(
                first.code,
                mark("line {line}: {message}", line=first.line, message=mark(first.message)),
                first.hint,
                diagnostics=found.diagnostics,
            )
