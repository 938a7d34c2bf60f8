"""A light machine numbers, acknowledges and ends programs as a real one; its time is the test's."""

from __future__ import annotations

from typing import Any

import pytest

from mcserver.errors import McError
from mcserver.fleet_sim.light_machine import LightMachine
from mcserver.net.method_table import BY_NAME
from mcserver.service.reports import Ack, Event, MachineStatus


class Bench:
    """A machine whose lines take 0.1 s, and what it has published."""

    def __init__(self) -> None:
        self.time = 1000.0
        self.acks: list[Ack] = []
        self.events: list[Event] = []
        self.machine = LightMachine(
            "sim-1",
            "abc",
            axes=3,
            line_s=0.1,
            clock=lambda: self.time,
            on_ack=self.acks.append,
            on_event=self.events.append,
        )
        self._handlers = self.machine.handlers()

    def call(self, method: str, client: str = "anna", **fields: Any) -> Any:
        return self._handlers[method](client, BY_NAME[method].request(**fields))

    def opened(self, lines: int) -> str:
        program = str(self.call("open", name="demo").program)
        if lines:
            self.call("submit", program=program, first=1, lines=["G01 X1"] * lines)
        return program

    def after(self, seconds: float) -> MachineStatus:
        self.time += seconds
        return self.machine.status()


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_program_runs_in_time_and_ends_once_it_is_closed(bench: Bench) -> None:
    program = bench.opened(10)
    (running,) = bench.after(0.55).programs
    assert (running.accepted, running.done, running.line, running.state) == (10, 5, 6, "running")
    bench.call("close", program=program, last=10)
    (ended,) = bench.after(5.0).programs
    assert (ended.done, ended.state, ended.eta_s) == (10, "finished", None)
    assert (bench.acks[-1].state, bench.acks[-1].done) == ("finished", 10)
    assert [event.kind for event in bench.events] == ["server.started", "program.opened", "program.ended"]


def test_time_without_lines_is_not_made_up_for(bench: Bench) -> None:
    program = bench.opened(0)
    bench.after(100.0)
    bench.call("submit", program=program, first=1, lines=["G01 X1"] * 10)
    assert bench.after(0.25).programs[0].done == 2


def test_a_hold_stops_time_and_a_resume_lets_it_go_on(bench: Bench) -> None:
    bench.opened(10)
    bench.after(0.35)
    bench.call("hold")
    assert (bench.after(10.0).programs[0].done, bench.machine.status().programs[0].state) == (3, "held")
    bench.call("resume")
    assert bench.after(0.3).programs[0].done == 6


def test_lines_are_taken_once_and_in_order(bench: Bench) -> None:
    program = bench.opened(5)
    bench.machine.stream("anna", program, 4, ["G01 X1"] * 4)
    assert bench.acks[-1].accepted == 7
    bench.machine.stream("anna", program, 20, ["G01 X1"])
    assert (bench.acks[-1].accepted, bench.acks[-1].expected) == (7, 8)
    with pytest.raises(McError, match="MC505: "):
        bench.call("submit", program=program, first=20, lines=["G01 X1"])
    bench.machine.stream("stranger", program, 8, ["G01 X1"])
    assert bench.machine.status().programs[0].accepted == 7


@pytest.mark.parametrize(
    ("code", "method", "fields"),
    [
        ("MC503", "submit", {"program": "nobody", "first": 1, "lines": ["G90"]}),
        ("MC503", "hold", {"program": "nobody"}),
        ("MC503", "programs", {"program": "nobody"}),
        ("MC511", "open", {"start_line": 5}),
    ],
)
def test_what_it_cannot_do_is_refused_as_by_a_real_one(
    bench: Bench, code: str, method: str, fields: dict[str, Any]
) -> None:
    with pytest.raises(McError) as refused:
        bench.call(method, **fields)
    assert refused.value.code == code


def test_an_emergency_stop_ends_programs_and_is_latched_until_a_reset(bench: Bench) -> None:
    bench.opened(10)
    bench.after(0.25)
    bench.machine.emergency_stop("panel", "fire")
    state = bench.after(1.0)
    assert (state.state, state.programs[0].state, state.programs[0].done) == ("estop", "faulted", 2)
    with pytest.raises(McError, match="MC509: "):
        bench.call("open")
    bench.call("reset")
    assert bench.machine.status().state == "ready"


def test_programs_that_nobody_ends_do_not_gather(bench: Bench) -> None:
    for _ in range(50):
        program = bench.opened(1)
        bench.call("abort", program=program)
    assert len(bench.machine.status().programs) <= 5
    for _ in range(4):
        bench.opened(1)
    with pytest.raises(McError, match="MC508: "):
        bench.call("open")
