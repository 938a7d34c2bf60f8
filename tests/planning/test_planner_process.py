"""Orders to the planner and outcomes of it pass between processes; one that does not come up is told of."""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec
import pytest

from mcserver.errors import Diagnostic, ProgramRejected, RuntimeFault
from mcserver.executor.client import ExecutorProcess
from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.gcode.semantics.modal import ModalState
from mcserver.planning.client import PlannerChild, ProcessPlanning
from mcserver.planning.pipeline_reports import Report, ReportKind
from mcserver.planning.planner_messages import (
    Begin,
    Broken,
    Consumed,
    Happened,
    Judged,
    Lines,
    Order,
    Orders,
    Outcome,
    PipelineRequest,
    Planned,
    Rejected,
)
from tests.service.fakes import three_axes

FAULT = Diagnostic("MC104", "too far", line=3, column=5, end_column=9, tool=3, residual_mm=0.5, axis=2)


@pytest.mark.parametrize(
    "order",
    [
        Begin(PipelineRequest("a-1", frozenset({0, 63})), 7, True),
        Begin(PipelineRequest("a-1", frozenset(), ModalState(inch=True, tool=3, feed=None)), 0, False),
        Lines("a-1", 2, 100_000, ["G01 X1", "(ä) G04 P0", ""], True),
        Order("a-1", "halt"),
    ],
)
def test_an_order_arrives_as_it_was_sent(order: Orders) -> None:
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(order), type=Orders) == order


def test_outcomes_arrive_as_they_were_sent_and_in_order() -> None:
    sent: list[Outcome] = [
        Consumed("a-1", 4096),
        Rejected("a-1", 1, 3, (FAULT,), True),
        Planned(
            "a-1", [Report(ReportKind.PLANNED, 1, 0.1), Report(ReportKind.BOUND, 2, bound_by="axis 1 jerk")]
        ),
        Judged("a-1", 5, 1234.5),
        Happened(
            [
                ExecutorEvent(EventKind.LINE_END, 0, 12, 0.1234567890123),
                ExecutorEvent(EventKind.FAULT, -1, 0, 2.0, 410, 3, values=(math.inf, -0.5)),
                ExecutorEvent(EventKind.SETTLED, 1, 0, 2.0, token=9, values=(1.0, 2.0, 3.0)),
            ]
        ),
        Broken("", "its process was ended by signal 9"),
    ]
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(sent), type=list[Outcome]) == sent


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
        child.wait(lambda: None)
    assert refused.value.code == "MC436"
    assert "ended by signal 9" in refused.value.message


def test_modal_state_before_a_line_is_read_without_the_process(executor: ExecutorProcess) -> None:
    executor.wait()
    planning = ProcessPlanning(executor.machine, executor)
    try:
        found = planning.modal_before(["G20 G91", "G94 F60"])
        assert (found.inch, found.incremental) == (True, True)
        with pytest.raises(ProgramRejected):
            planning.modal_before(["G01 XO"])
    finally:
        planning.close()
    assert planning.closed


def test_memory_is_for_those_who_come_before_the_end(executor: ExecutorProcess) -> None:
    executor.wait()
    assert executor.memory >= 0
    executor.kill()
    with pytest.raises(RuntimeError):
        _ = executor.memory
