"""Commands to the planner and its events pass between processes; a process that fails is reported."""

from __future__ import annotations

import math
import os
import signal
from collections.abc import Iterator

import msgspec
import pytest

from mcserver.errors import Diagnostic, ProgramRejected, RuntimeFault
from mcserver.executor.client import ExecutorProcess
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.modal import ModalState
from mcserver.planning import client
from mcserver.planning.client import PlannerChild, ProcessPlanning
from mcserver.planning.planner_messages import (
    Begin,
    CloseProgram,
    Consumed,
    Dropped,
    DropProgram,
    ExecutorEvents,
    HaltProgram,
    LineRejected,
    Lines,
    PipelineRequest,
    Planned,
    PlannerCommand,
    PlannerEvent,
    PlannerFailed,
    Report,
    ReportKind,
    StepLine,
    Validated,
)
from mcserver.planning.start_state import StartState
from tests.service.fakes import three_axes

# every field is another than its default, so that none is lost on the way
USED = StartState(
    positions={0: 0.1, 63: -1e-9},
    energized=frozenset({0}),
    unsettled=frozenset({63}),
    homed=frozenset({63}),
    frame=Frame(systems={1: {0: 0.3}}),
    inputs=(1.0, 0.0),
    outputs=(0.5,),
)
FAULT = Diagnostic("MC104", "too far", line=3, column=5, end_column=9, tool=3, residual_mm=0.5, axis=2)


@pytest.mark.parametrize(
    "command",
    [
        Begin(PipelineRequest("a-1", frozenset({0, 63}), USED), 7, True, 12.5),
        Begin(
            PipelineRequest(
                "a-1", frozenset(), StartState({}, modal=ModalState(inch=True, tool=3, feed=None))
            ),
            0,
            False,
            0.0,
        ),
        Lines("a-1", 2, 100_000, ["G01 X1", "(ä) G04 P0", ""]),
        CloseProgram("a-1"),
        StepLine("a-1"),
        HaltProgram("a-1"),
        DropProgram("a-1"),
    ],
)
def test_a_command_arrives_as_it_was_sent(command: PlannerCommand) -> None:
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(command), type=PlannerCommand) == command


def test_events_arrive_as_they_were_sent_and_in_order() -> None:
    sent: list[PlannerEvent] = [
        Consumed("a-1", 4096),
        LineRejected("a-1", 1, 3, (FAULT,), True),
        Planned(
            "a-1", [Report(ReportKind.PLANNED, 1, 0.1), Report(ReportKind.BOUND, 2, bound_by="axis 1 jerk")]
        ),
        Validated("a-1", 5, 1234.5),
        ExecutorEvents(
            [
                ExecutorEvent(EventKind.LINE_END, 0, 12, 0.1234567890123),
                ExecutorEvent(EventKind.FAULT, -1, 0, 2.0, 410, 3, values=(math.inf, -0.5)),
                ExecutorEvent(EventKind.SETTLED, 1, 0, 2.0, token=9, values=(1.0, 2.0, 3.0)),
            ]
        ),
        PlannerFailed("", "its process was ended by signal 9"),
        Dropped("a-1"),
    ]
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(sent), type=list[PlannerEvent]) == sent


@pytest.fixture
def executor() -> Iterator[ExecutorProcess]:
    made = ExecutorProcess(three_axes())
    made.launch()
    yield made
    made.kill()


def test_a_planner_that_ends_at_its_start_is_refused(executor: ExecutorProcess) -> None:
    child = PlannerChild(executor.machine, executor)
    child.process.kill()
    with pytest.raises(RuntimeFault) as refused:
        child.wait()
    assert refused.value.code == "MC436"
    assert "ended by signal 9" in refused.value.message


def test_a_planner_whose_server_has_given_up_its_start_ends_without_a_word(executor: ExecutorProcess) -> None:
    child = PlannerChild(executor.machine, executor)
    child.pipe.close()
    assert child.process.wait(60.0) == 0


def test_a_planner_that_the_server_ends_as_it_never_gets_ready_is_said_to_be_that(
    executor: ExecutorProcess, monkeypatch: pytest.MonkeyPatch
) -> None:
    child = PlannerChild(executor.machine, executor)
    # it cannot get ready
    os.kill(child.process.pid, signal.SIGSTOP)
    monkeypatch.setattr(client, "START_TIMEOUT_S", 0.0)
    with pytest.raises(RuntimeFault, match="not ready within 0 s, and the server ended it") as refused:
        child.wait()
    assert refused.value.code == "MC436"
    assert child.process.poll() == -signal.SIGKILL


def test_modal_state_before_a_line_is_read_without_the_process(executor: ExecutorProcess) -> None:
    executor.wait()
    planning = ProcessPlanning(executor.machine, executor)
    try:
        start, axes = StartState.of(executor.machine), frozenset({0})
        found = planning.state_before(["G20 G91", "G94 F60"], start, axes).modal
        assert (found.inch, found.incremental) == (True, True)
        with pytest.raises(ProgramRejected):
            planning.state_before(["G01 XO"], start, axes)
    finally:
        planning.close()
    assert planning.closed


def test_memory_is_for_those_who_come_before_the_end(executor: ExecutorProcess) -> None:
    executor.wait()
    assert executor.memory >= 0
    executor.kill()
    with pytest.raises(RuntimeError):
        _ = executor.memory
