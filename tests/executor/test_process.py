"""The executor as a process of its own: it runs, loses its server, is killed."""

from __future__ import annotations

import itertools
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from mcserver.executor.client import ExecutorProcess
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.executor import Executor
from mcserver.executor.process import ExitCode, run_loop
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.executor.rig import Program, machine

PATIENCE_S = 20.0


class Beating:
    """A server that beats until it is stopped."""

    def __init__(self, process: ExecutorProcess) -> None:
        self._process = process
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(0.005):
            self._process.beat()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


@pytest.fixture
def process() -> Iterator[ExecutorProcess]:
    running = ExecutorProcess(machine(travel=None))
    running.start()
    try:
        yield running
    finally:
        running.kill()


def eventually(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline, "it did not come in time"
        threading.Event().wait(0.005)


def test_a_program_runs_in_the_process_and_it_ends_when_asked(process: ExecutorProcess) -> None:
    beating = Beating(process)
    program = Program(process.open_slot(0), 2)
    program.capture()
    program.start_line(1)
    program.move({0: 0.1}, 300)
    program.wait(1)
    program.end_line()
    program.finish()
    events: list[ExecutorEvent] = []

    def finished() -> bool:
        events.extend(process.parts.events.take())
        return any(event.kind is EventKind.FINISHED for event in events)

    eventually(finished)
    assert process.alive
    (start,) = [event.time for event in events if event.kind is EventKind.LINE_START]
    (end,) = [event.time for event in events if event.kind is EventKind.LINE_END]
    late = process.feedback.late_cycles
    # rows may come some cycles after the line's start
    assert 0.3 - 1e-9 <= end - start <= 0.3 + (late + 5) * 1e-3
    assert process.feedback.setpoint[0] == pytest.approx(0.1)
    assert process.parts.events.lost == 0
    before = process.history.written
    first, rows = process.history.since(0)
    assert before <= first + len(rows) <= process.history.written
    assert process.stop() == ExitCode.ASKED
    beating.stop()
    assert not process.alive


def test_a_lost_server_brings_motion_to_rest_and_ends_the_process(process: ExecutorProcess) -> None:
    beating = Beating(process)
    program = Program(process.open_slot(0), 2)
    program.start_line(1)
    program.speed({0: 0.5})
    eventually(lambda: process.feedback.velocity[0] > 0.49)
    beating.stop()
    eventually(lambda: process.exit_code is not None)
    assert process.exit_code == ExitCode.SERVER_LOST
    assert 413 in [event.code for event in process.parts.events.take() if event.kind is EventKind.FAULT]
    last = process.feedback
    assert last.velocity[0] == 0.0
    _, rows = process.history.since(0)
    speeds = process.history.block(rows, "velocity")[:, 0]
    # controlled: never more than max_acceleration from one cycle to the next
    assert abs(speeds[1:] - speeds[:-1]).max() <= 10.0 * 1e-3 * 1.01


def test_a_killed_executor_is_seen_by_the_server(process: ExecutorProcess) -> None:
    process.beat()
    assert process.pid is not None
    os.kill(process.pid, signal.SIGKILL)
    eventually(lambda: not process.alive)
    assert process.exit_code == -signal.SIGKILL


def test_a_stopped_executor_is_seen_by_its_missing_beat(process: ExecutorProcess) -> None:
    assert process.alive
    assert process.pid is not None
    os.kill(process.pid, signal.SIGSTOP)
    eventually(lambda: not process.alive)
    assert process.exit_code is None


def test_an_executor_that_was_stopped_at_speed_stays_where_it_was(process: ExecutorProcess) -> None:
    beating = Beating(process)
    program = Program(process.open_slot(0), 2)
    program.capture()
    program.start_line(1)
    program.move({0: 0.9}, 3000)
    program.end_line()
    program.finish()
    eventually(lambda: process.feedback.velocity[0] > 0.3)
    assert process.pid is not None
    os.kill(process.pid, signal.SIGSTOP)
    threading.Event().wait(1.0)
    before = process.feedback.setpoint[0]
    # it may have been stopped within a cycle, which it brings to its end
    under_way = process.feedback.velocity[0] * machine().cycle_s
    os.kill(process.pid, signal.SIGCONT)
    events: list[ExecutorEvent] = []

    def stopped() -> bool:
        events.extend(process.parts.events.take())
        return any(event.kind is EventKind.STOPPED for event in events)

    eventually(stopped)
    beating.stop()
    assert [event.code for event in events if event.kind is EventKind.FAULT] == [459, 459]
    assert 0.0 <= process.feedback.setpoint[0] - before <= 1.1 * under_way
    assert process.feedback.velocity[0] == 0.0


class ScriptedClock:
    """A clock whose sleeps overrun as scripted [ns]."""

    def __init__(self, overruns: dict[int, int]) -> None:
        self._now = 0
        self._sleeps = 0
        self._overruns = overruns

    def now(self) -> int:
        return self._now

    def sleep_until(self, deadline: int) -> None:
        self._now = max(self._now, deadline) + self._overruns.get(self._sleeps, 0)
        self._sleeps += 1


def run_scripted(overruns: dict[int, int], cycles: int) -> tuple[VirtualExecutor, list[float]]:
    virtual = VirtualExecutor(machine())
    executor: Executor = virtual.executor
    times: list[float] = []
    original = executor.cycle

    def counted(at: float) -> None:
        times.append(at)
        original(at)

    executor.cycle = counted  # type: ignore[method-assign]
    program = Program(virtual.open_slot(0), 2)
    program.capture()
    program.move({0: 0.01}, 100)
    result = run_loop(
        executor, virtual.mailbox, ScriptedClock(overruns), os.getppid(), lambda: len(times) >= cycles
    )
    assert result is ExitCode.ASKED
    return virtual, times


def test_late_cycles_are_counted_and_skipped_and_motion_never_jumps() -> None:
    virtual, times = run_scripted({20: 3_400_000, 50: 1_000_000}, 90)
    steps = [round((after - before) / 1e-3) for before, after in itertools.pairwise(times)]
    assert sorted(set(steps)) == [1, 2, 4]
    assert virtual.executor.late_cycles == 4
    _, rows = virtual.history.since(0)
    setpoint = virtual.history.block(rows, "setpoint")[:, 0]
    velocity = setpoint[1:] - setpoint[:-1]
    assert abs(velocity[1:89] - velocity[:88]).max() <= 10.0 * 1e-6 * 1.05


def test_a_cycle_that_is_late_by_less_than_a_cycle_is_not_skipped() -> None:
    virtual, times = run_scripted({20: 700_000}, 60)
    assert virtual.executor.late_cycles == 0
    assert len({round((b - a) * 1e6) for a, b in itertools.pairwise(times)}) == 1
