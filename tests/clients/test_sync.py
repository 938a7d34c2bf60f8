"""The client without ``async``."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
from fake_server import FakeServer
from mcclient import NobodyAnswers, ProgramRejected
from mcclient.sync import Machine


def test_lines_are_sent_and_waited_for(server: FakeServer) -> None:
    with Machine.connect(connect=server.endpoint) as machine:
        with machine.program() as program:
            reports = program.reports
            program.send("G01 X1").done()
            assert program.send_lines(f"G01 X{n}" for n in range(2, 1500)) == 1499
            program.done()
            assert program.finish().done == 1499
            assert next(reports).kind == "started"
        assert machine.status().state == "ready"
        assert machine.override(70.0) == 70.0
    assert len(server.executed) == 1499


def test_an_exception_in_the_block_aborts_and_a_rejection_is_raised(server: FakeServer) -> None:
    with (
        Machine.connect(connect=server.endpoint) as machine,
        pytest.raises(ProgramRejected),
        machine.program() as program,
    ):
        program.send("BAD")
    assert server.programs["p1"].state == "aborted"


def test_nobody_there_leaves_no_thread_behind() -> None:
    with pytest.raises(NobodyAnswers):
        Machine.connect(connect="tcp/127.0.0.1:9", timeout_s=0.1)
    assert "mcclient" not in [thread.name for thread in threading.enumerate()]


def test_a_source_that_waits_for_the_end_of_its_lines_does_not_stand_still(server: FakeServer) -> None:
    def lines() -> Iterator[str]:
        yield "G01 X1"
        server.wait_until(lambda: len(server.executed) == 1)
        yield "G01 X2"

    with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:
        program.send_lines(lines())
    assert len(server.executed) == 2


def test_telemetry_and_events_are_plain_iterators(server: FakeServer) -> None:
    with Machine.connect(connect=server.endpoint) as machine:
        states, events = machine.telemetry(), machine.events()
        machine.status()
        server.publish_state()
        server.publish_event("warning", message="so")
        assert next(states).state == "ready"
        assert next(events).message == "so"
        states.close()
        assert list(states) == []
