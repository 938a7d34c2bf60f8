"""The queue of programs of the page, on a machine that answers at once."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from mcclient import MotionError, RequestRefused
from mcclient.types import Continuation, SimulateReply

from mcserver.web.jobs import AS_WRITTEN, JobQueue, JobState, Middle, Switches
from mcserver.web.last_runs import LastRuns
from mcserver.web.link import MachineLink
from mcserver.web.store import ProgramStore
from tests.wire_values import wire_value


class Opened:
    """A program that takes every line and ends."""

    id = "p-1"
    given_through = 0

    async def __aenter__(self) -> Opened:
        return self

    async def __aexit__(self, *_: object) -> None:
        pass

    async def send_lines(self, _lines: list[str]) -> None:
        pass


class Bench:
    """A machine: which programs were opened, and a check that waits where it is asked to."""

    def __init__(self) -> None:
        self.opened: list[str] = []
        self.checking = asyncio.Event()
        self.may_answer = asyncio.Event()
        self.may_answer.set()

    async def status(self) -> Any:
        return SimpleNamespace(axes=SimpleNamespace(index=(0,), setpoint=(0.0,)))

    async def simulate(self, *_: object, **__: object) -> SimulateReply:
        return wire_value(SimulateReply)

    async def check(self, *_: object, **__: object) -> Any:
        self.checking.set()
        await self.may_answer.wait()
        return SimpleNamespace(ok=True)

    async def program(self, name: str, **_: object) -> Opened:
        self.opened.append(name)
        return Opened()


def queue_of(bench: Bench, folder: Path) -> JobQueue:
    store = ProgramStore(folder)
    for name in ("a.gcode", "b.gcode"):
        store.write(name, b"G01 X1 F600\n")
    link = SimpleNamespace(
        connected=lambda: bench, last_runs=LastRuns(folder / ".runs.json"), acts=[], machine=None
    )
    return JobQueue(cast("MachineLink", link), store)


async def ended(queue: JobQueue, count: int) -> None:
    async with asyncio.timeout(20.0):
        while len(queue.ended) < count:
            await asyncio.sleep(0)


async def test_a_program_started_after_an_emergency_stop_that_emptied_the_queue_runs(tmp_path: Path) -> None:
    bench = Bench()
    queue = queue_of(bench, tmp_path)
    queue.stop()
    queue.add("a.gcode", "ann")
    await ended(queue, 1)
    assert bench.opened == ["a.gcode"]
    await queue.close()


async def test_an_emergency_stop_during_the_check_keeps_the_program_from_starting(tmp_path: Path) -> None:
    bench = Bench()
    queue = queue_of(bench, tmp_path)
    bench.may_answer.clear()
    job = queue.add("a.gcode", "ann")
    await bench.checking.wait()
    queue.stop()
    late = queue.add("b.gcode", "ann")
    bench.may_answer.set()
    await ended(queue, 1)
    assert (job.state, bench.opened) == (JobState.FAILED, [])
    # one that was started before the first had ended waits for an operator
    assert (late.state, queue.stopped) == (JobState.WAITING, True)
    queue.start_again()
    await ended(queue, 2)
    assert bench.opened == ["b.gcode"]
    await queue.close()


@pytest.mark.parametrize("at", ["check", "program"])
async def test_a_hold_or_an_abort_before_a_program_runs_keeps_it_from_starting(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    bench = Bench()
    queue = queue_of(bench, tmp_path)
    sent: list[str] = []
    asked = getattr(bench, at)

    async def stopped(*arguments: Any, **options: Any) -> Any:
        queue.stop_checking()
        return await asked(*arguments, **options)

    async def send_lines(_: Opened, lines: list[str]) -> None:
        sent.extend(lines)

    monkeypatch.setattr(bench, at, stopped)
    monkeypatch.setattr(Opened, "send_lines", send_lines)
    job = queue.add("a.gcode", "ann")
    await ended(queue, 1)
    assert (job.state, job.message, sent) == (
        JobState.FAILED,
        "a.gcode was being checked as the queue was stopped",
        [],
    )
    monkeypatch.undo()
    queue.add("b.gcode", "ann")
    await ended(queue, 2)
    assert queue.ended[0].state is JobState.FINISHED
    await queue.close()


async def test_what_waits_behind_a_failure_does_not_start_because_of_one_more(tmp_path: Path) -> None:
    bench = Bench()
    queue = queue_of(bench, tmp_path)
    refused = MotionError("MC104", "no such arc", "")
    answers = [refused]

    async def check(*_: object, **__: object) -> Any:
        if answers:
            raise answers.pop()
        return SimpleNamespace(ok=True)

    bench.check = check  # type: ignore[method-assign]
    queue.add("a.gcode", "ann")
    queue.add("b.gcode", "ann")
    await ended(queue, 1)
    queue.add("a.gcode", "ann")
    await asyncio.sleep(0)
    assert (queue.stopped, len(queue.waiting), bench.opened) == (True, 2, [])
    await queue.close()


async def test_how_a_program_went_is_kept_with_its_name(tmp_path: Path) -> None:
    queue = queue_of(Bench(), tmp_path)
    queue.add("a.gcode", "ada")
    await ended(queue, 1)
    (run,) = LastRuns(tmp_path / ".runs.json").runs.values()
    assert (run.state, run.user) == ("finished", "ada")


async def test_a_step_starts_one_line_with_the_blank_ones_behind_it_and_waits_for_its_end(
    tmp_path: Path,
) -> None:
    bench, stepped, ends = Bench(), list[str](), asyncio.Event()

    class Stepped(Opened):
        async def __aexit__(self, *_: object) -> None:
            await ends.wait()

    async def program(name: str, *, step: bool, **_: object) -> Opened:
        bench.opened.append(f"{name} {step}")
        return Stepped()

    async def step(program: str) -> None:
        stepped.append(program)
        if len(stepped) in (4, 6):
            raise RequestRefused("MC509", "the machine is not ready", "")

    bench.program, bench.step = program, step  # type: ignore[assignment, attr-defined]
    queue = queue_of(bench, tmp_path)
    queue.single_step = True
    job = queue.add_text("step.gcode", "G01 X1 F600\n\n\nG01 X2\n", "ada")
    with pytest.raises(MotionError, match="MC062: no program runs in single step"):
        await queue.step(0)
    async with asyncio.timeout(20.0):
        while job.state is not JobState.RUNNING:
            await asyncio.sleep(0)
    assert (bench.opened, stepped) == (["step.gcode True"], [])
    await queue.step(0)
    assert (len(stepped), job.stepped) == (3, 3)
    with pytest.raises(MotionError, match="MC062: line 3 is not done"):
        await queue.step(2)
    # a line that the server refuses was not started, one before it was
    for at in (3, 4):
        with pytest.raises(RequestRefused, match="MC509"):
            await queue.step(3)
        assert job.stepped == at
    await queue.step(4)
    assert (len(stepped), job.stepped) == (7, 5)
    ends.set()
    await ended(queue, 1)
    queue.single_step = False
    queue.add("a.gcode", "ada")
    await ended(queue, 2)
    assert bench.opened[1:] == ["a.gcode False"]
    await queue.close()


async def test_estimates_come_one_at_a_time_and_no_check_waits_for_them(tmp_path: Path) -> None:
    bench, asked = Bench(), list[str]()
    never = asyncio.Event()

    async def simulate(*_: object, **__: object) -> SimulateReply:
        asked.append("simulate")
        await never.wait()
        return wire_value(SimulateReply)

    async def check(*_: object, **__: object) -> Any:
        asked.append("check")
        return SimpleNamespace(ok=True)

    class Running(Opened):
        async def __aexit__(self, *_: object) -> None:
            # as long as an estimate of its own would need to be asked for
            for _ in range(5):
                await asyncio.sleep(0)

    async def program(*_: object, **__: object) -> Opened:
        return Running()

    bench.simulate, bench.check, bench.program = simulate, check, program  # type: ignore[method-assign]
    queue = queue_of(bench, tmp_path)
    for name in ("a.gcode", "b.gcode", "a.gcode"):
        queue.add(name, "ann")
    await ended(queue, 3)
    assert sorted(asked) == ["check", "check", "check", "simulate"]
    assert asked[0] == "check"
    await queue.close()


async def test_a_text_that_has_come_in_the_place_of_the_one_that_was_looked_at_does_not_run(
    tmp_path: Path,
) -> None:
    queue = queue_of(Bench(), tmp_path)
    with pytest.raises(MotionError, match=r"MC062: a\.gcode has another text"):
        queue.add("a.gcode", "ann", seen="G01 X2 F600\n")
    queue.add("a.gcode", "ann", seen="G01 X1 F600\n")
    await ended(queue, 1)
    await queue.close()


async def test_a_job_is_checked_and_opened_with_the_switches_of_when_it_was_queued(tmp_path: Path) -> None:
    bench, asked = Bench(), list[Any]()

    async def noted(*_: object, block_delete: bool, optional_stop: bool, **__: object) -> Any:
        asked.append((block_delete, optional_stop))
        return SimpleNamespace(ok=True, path=None, duration_s=1.0)

    async def program(*_: object, **given: Any) -> Opened:
        await noted(**given)
        return Opened()

    bench.check, bench.simulate, bench.program = noted, noted, program  # type: ignore[method-assign, assignment]
    queue = queue_of(bench, tmp_path)
    queue.switches = Switches(block_delete=True)
    queue.add("a.gcode", "ann")
    queue.switches = Switches(optional_stop=False)
    queue.add("b.gcode", "ann")
    # what a person has looked at counts, whatever is switched by then
    queue.add("b.gcode", "ann", switches=AS_WRITTEN)
    await ended(queue, 3)
    assert set(asked) == {(True, True), (False, False), (False, True)}
    assert len(asked) >= 6
    await queue.close()


async def test_single_step_is_refused_to_what_goes_on_behind_a_break(tmp_path: Path) -> None:
    queue = queue_of(Bench(), tmp_path)
    queue.single_step = True
    shown = wire_value(Continuation, name="a.gcode", line=1, whole=True, state=None, sha256=None)
    job = queue.go_on(shown, "ada", Middle("p-0"))
    await ended(queue, 1)
    assert (job.state, job.message) == (
        JobState.FAILED,
        "what goes on behind a break has no single step",
    )
    await queue.close()
