"""The client without ``async``."""

from __future__ import annotations

import inspect
import subprocess
import sys
import threading
from collections.abc import Iterator

import mcclient
import pytest
from fake_server import FakeServer
from mcclient import NobodyAnswers, ProgramRejected
from mcclient.sync import Machine, Program


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
        assert machine.override(70.0).percent == 70.0
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


FORGETFUL = """
import atexit, sys
import mcclient.transport
from mcclient.sync import Machine

links = []
opened = mcclient.transport.Link.__init__
mcclient.transport.Link.__init__ = lambda self, *given: (opened(self, *given), links.append(self))[0]
# what is registered first comes last
atexit.register(lambda: print([link._session.is_closed() for link in links]))
machine = Machine.connect(connect=sys.argv[1])
samples = machine.samples()
raise SystemExit(3)
"""


def test_a_program_that_closes_nothing_ends_as_it_wants_to(server: FakeServer) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", FORGETFUL, server.endpoint], capture_output=True, text=True, timeout=60
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (3, "[True]\n", "")


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


@pytest.mark.parametrize(
    ("blocking", "asynchronous", "left_out"),
    [
        # what is made of several awaits, or of no use to a caller who waits
        (Machine, mcclient.Machine, {"online", "instance", "hash_of", "read_recording"}),
        (Program, mcclient.Program, {"ended", "credit", "failure", "wait_accepted", "wait_done", "leave"}),
    ],
)
def test_every_call_of_the_client_is_there_without_async(
    blocking: type, asynchronous: type, left_out: set[str]
) -> None:
    public = {name for name in dir(asynchronous) if not name.startswith("_")}
    assert public - left_out <= set(dir(blocking))


def test_a_call_without_async_has_the_description_and_the_arguments_of_the_asynchronous_one() -> None:
    assert Machine.jog.__doc__ == mcclient.Machine.jog.__doc__
    assert inspect.signature(Machine.jog) == inspect.signature(mcclient.Machine.jog)
