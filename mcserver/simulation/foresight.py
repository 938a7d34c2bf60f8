"""Simulations of long programs while they run, each in a process of its own at the lowest priority.

They tell how long the rest takes, part by part as they get ahead, and a fault before the machine comes to it.
"""

from __future__ import annotations

import asyncio
import contextlib
import multiprocessing
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec
from mckinematics.pose import Kinematics

from mcserver.errors import Diagnostic
from mcserver.gcode.switches import Switches
from mcserver.machine.machine_file import Machine
from mcserver.planning.line_marks import LineMarks
from mcserver.planning.start_state import StartState
from mcserver.simulation.worker_process import end_with_parent

# Simulations at the same time, and those that wait for one of these.
AT_ONCE = 2
WAITING = 16
# Between two parts [s].
PART_S = 1.0
LEAST_NICE = 19
BLOCK_BYTES = 1 << 20


class Foreseen(msgspec.Struct, frozen=True):
    """What is known so far.

    Attributes:
        marks: times of lines. fault: the first that the check has found; then there are no times.
    """

    marks: LineMarks | None = None
    fault: Diagnostic | None = None


# Takes what is known; False: nobody wants to know any more.
Listener = Callable[[Foreseen], bool]


@dataclass(frozen=True, slots=True)
class _Job:
    sha256: str
    path: Path
    machine: Machine
    start: StartState
    listener: Listener
    checked: bool

    @property
    def key(self) -> tuple[str, Switches]:
        return self.sha256, self.start.switches


class Foresight:
    """The simulations of one machine's programs; belongs to the loop."""

    def __init__(self) -> None:
        self._waiting: dict[tuple[str, Switches], _Job] = {}
        self._running: dict[tuple[str, Switches], multiprocessing.process.BaseProcess] = {}
        self._closed = False

    def begin(
        self,
        sha256: str,
        path: Path,
        machine: Machine,
        start: StartState,
        listener: Listener,
        *,
        checked: bool = False,
    ) -> None:
        """Simulate the text of a file; one that is under way or waits already goes on.

        Args:
            start: what the program starts from. checked: the text has no faults.
        """
        job = _Job(sha256, path, machine, start, listener, checked)
        if self._closed or job.key in self._running or job.key in self._waiting:
            return
        if len(self._waiting) < WAITING:
            self._waiting[job.key] = job
            self._start_next()

    def close(self) -> None:
        """End all of them."""
        self._closed = True
        self._waiting.clear()
        for process in self._running.values():
            if process.pid is not None:
                process.terminate()

    def _start_next(self) -> None:
        while self._waiting and len(self._running) < AT_ONCE:
            job = self._waiting.pop(next(iter(self._waiting)))
            context = multiprocessing.get_context("spawn")
            receiving, sending = context.Pipe(duplex=False)
            process = context.Process(
                target=foresee,
                args=(sending, str(job.path), job.machine, job.start, job.checked),
                daemon=True,
                name="foresight",
            )
            self._running[job.key] = process
            # starting a process takes longer than the loop may wait
            threading.Thread(
                target=self._follow,
                args=(asyncio.get_running_loop(), process, receiving, sending, job),
                daemon=True,
            ).start()

    def _follow(
        self,
        loop: asyncio.AbstractEventLoop,
        process: multiprocessing.process.BaseProcess,
        receiving: Connection,
        sending: Connection,
        job: _Job,
    ) -> None:
        """Start a simulation, and hand what it tells to the loop until it ends; in a thread of its own."""

        def hand_over(part: Foreseen) -> None:
            if self._closed or not job.listener(part):
                process.terminate()

        try:
            process.start()
            sending.close()
            while not self._closed:
                loop.call_soon_threadsafe(hand_over, receiving.recv())
            process.terminate()
        except (EOFError, OSError):
            # it has sent all, was ended, or could not be started
            pass
        except RuntimeError:
            # the loop is closed: the server has stopped
            process.terminate()
        finally:
            receiving.close()
        if process.pid is not None:
            process.join()
        with contextlib.suppress(RuntimeError):
            loop.call_soon_threadsafe(self._ended, job.key)

    def _ended(self, key: tuple[str, Switches]) -> None:
        self._running.pop(key, None)
        if not self._closed:
            self._start_next()


def foresee(sending: Connection, path: str, machine: Machine, start: StartState, checked: bool) -> None:
    """Check and simulate a file, and send what is known of it about every `PART_S`; a process's main."""
    # the least share beside others; SCHED_IDLE would give none at all beside any other job in the background
    if sys.platform != "win32":
        os.nice(LEAST_NICE)
    end_with_parent()
    foresee_file(path, machine, sending.send, start=start, checked=checked)


def foresee_file(
    path: str,
    machine: Machine,
    tell: Callable[[Foreseen], None],
    clock: Callable[[], float] = time.monotonic,
    part_s: float = PART_S,
    *,
    start: StartState | None = None,
    checked: bool = False,
) -> None:
    """Check and simulate a file, and tell what is known about every ``part_s`` [s] and at the end.

    Args:
        start: what it starts from; None: a machine that nobody has used. checked: it has no faults.
    """
    from mcserver.machine.machine_kinematics import build_kinematics
    from mcserver.simulation.line_times import LineTimes
    from mcserver.simulation.simulation import simulate_lines

    kinematics = build_kinematics(machine)
    start = start or StartState.of(machine)
    found = [] if checked else check_file(path, machine, start, kinematics)
    faults = [each for each in found if each.severity == "error"]
    if faults:
        tell(Foreseen(fault=faults[0]))
        return
    times = LineTimes(keep=False)
    due = clock() + part_s

    def progress(_time_s: float, _line: int) -> None:
        nonlocal due
        if clock() >= due:
            marks = times.marks()
            if marks.through:
                tell(Foreseen(marks=marks))
            due = clock() + part_s

    run = simulate_lines(
        lambda: lines_in(path),
        machine,
        start=start,
        kinematics=kinematics,
        progress=progress,
        times=times,
        checked=True,
    )
    # of one that a fault has stopped the times go as far as it came
    marks = run.marks() if run.exit_code == 0 else times.marks()
    if marks.complete or marks.through:
        tell(Foreseen(marks=marks))


def lines_in(path: str) -> Iterator[str]:
    """Read the lines of a file.

    Raises:
        ProgramRejected: MC100 a line that is no text. OSError: it cannot be read.
    """
    from mcserver.gcode.text.source import lines_of

    with open(path, "rb") as file:
        yield from lines_of(iter(lambda: file.read(BLOCK_BYTES), b""))


def check_file(
    path: str, machine: Machine, start: StartState, kinematics: Kinematics | None = None
) -> list[Diagnostic]:
    """Find the faults of a file, as `check_text`; runs in the worker."""
    return _check(lines_in(path), machine, start, kinematics)


def check_text(text: str, machine: Machine, start: StartState) -> list[Diagnostic]:
    """`mcserver.gcode.program_check.check_lines` with the machine's kinematics; runs in the worker."""
    from mcserver.gcode.text.source import split_lines

    return _check(split_lines(text), machine, start)


def _check(
    lines: Iterable[str], machine: Machine, start: StartState, kinematics: Kinematics | None = None
) -> list[Diagnostic]:
    from mcserver.gcode.program_check import check_lines
    from mcserver.machine.machine_kinematics import build_kinematics

    return check_lines(
        lines,
        machine,
        kinematics or build_kinematics(machine),
        positions=start.positions,
        frame=start.frame,
        switches=start.switches,
    )
