"""Programs over real Zenoh."""

from __future__ import annotations

import asyncio
import contextlib

import pytest
from fake_server import FakeServer
from mcclient import (
    Continuation,
    Machine,
    MotionError,
    ProgramAborted,
    ProgramClosed,
    ProgramFaulted,
    ProgramRejected,
    RequestRefused,
)


async def test_lines_are_executed_in_order_and_the_block_waits_for_their_end(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine, machine.program("job") as program:
        line = await program.send("G01 X10")
        assert line.number == 1
        last = await program.send_lines(f"G01 X{n}" for n in range(2000))
        assert last == 2001
    assert [number for _, number, _ in server.executed] == list(range(1, 2002))
    assert server.programs["p1"].state == "finished"


async def test_done_waits_for_the_lines_end_and_not_only_for_acceptance(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:
        await program.send_lines(["G01 X1", "G01 X2"])
        waiting = asyncio.create_task(program.done())
        await program.status()
        assert not waiting.done()
        server.run_lines(program.id)
        await waiting
        assert program.done_through == 2


async def test_no_line_is_given_in_ignorance_of_a_rejection(server: FakeServer) -> None:
    server.runs_by_itself = False
    server.credit_limit = 10
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        # more than the client keeps: it waits for room
        sending = asyncio.create_task(program.send_lines(["G01 X1"] * 20_000))
        await asyncio.to_thread(server.wait_until, lambda: server.programs[program.id].accepted == 10)
        watching = asyncio.create_task(program.done())
        await program.status()
        server.reject(program.id, 5)
        for task in (watching, sending):
            with pytest.raises(ProgramRejected):
                await task
        assert program.given_through == 4
        assert await program.send_lines(["G01 X5"]) == 5
        assert server.programs[program.id].texts[5] == "G01 X5"
        await program.abort()


async def test_a_program_that_finished_without_a_rejected_line_says_so(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        await program.send_lines(["G01 X1", "G01 X2", "G01 X3"])
        server.lose["ack"] = 1
        server.reject(program.id, 2)
        finishing = asyncio.create_task(program.finish())
        await asyncio.to_thread(server.wait_until, lambda: server.programs[program.id].closed)
        server.run_lines(program.id)
        with pytest.raises(ProgramRejected) as caught:
            await finishing
        assert caught.value.line == 2


async def test_finish_tells_a_rejection_only_after_the_lines_before_it_have_run(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        await program.send_lines(["G01 X1", "G01 X2"])
        finishing = asyncio.create_task(program.finish())
        server.reject(program.id, 2)
        await program.status()
        assert not finishing.done()
        server.run_lines(program.id)
        with pytest.raises(ProgramRejected):
            await finishing
        assert program.done_through == 1


async def test_a_fault_ends_the_program_and_names_axis_and_line(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        await program.send("G01 X1")
        with pytest.raises(ProgramFaulted) as caught:
            await program.send_lines(["FAULT"])
    assert (caught.value.code, caught.value.line, caught.value.fault.axis) == ("MC401", 2, 2)
    assert caught.value.done == 1


async def test_an_exception_in_the_block_aborts_the_program(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        with contextlib.suppress(KeyError):
            async with machine.program() as program:
                await program.send("G01 X1")
                raise KeyError
    assert server.programs["p1"].state == "aborted"
    assert server.executed == []


async def test_an_operators_abort_is_raised_with_what_was_done(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        await program.send_lines(["G01 X1", "G01 X2"])
        server.run_lines(program.id, 1)
        assert await machine.abort() == (program.id,)
        with pytest.raises(ProgramAborted) as caught:
            await program.finish()
        assert (caught.value.accepted, caught.value.done) == (2, 1)
        with pytest.raises(ProgramAborted):
            await program.send("G01 X3")


async def test_a_line_sent_while_the_program_is_being_aborted_is_refused_with_the_reason(
    server: FakeServer,
) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        server.programs[program.id].state = "ending"
        sending = asyncio.create_task(program.send("G01 X1"))
        await asyncio.to_thread(server.wait_until, lambda: server.calls["programs"] == 1)
        server.end(program.id, "aborted")
        with pytest.raises(ProgramAborted):
            await sending


async def test_lines_after_the_end_of_the_program_are_not_waited_for(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        await program.send_lines(["G01 X1", "M02", "(never read)"])
        await program.done()
        assert (await program.finish()).state == "finished"
        with pytest.raises(ProgramClosed):
            await program.send("G01 X1")


async def test_single_lines_wait_for_credit_too(server: FakeServer) -> None:
    server.runs_by_itself = False
    server.credit_limit = 1
    async with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:
        await program.send("G01 X1")
        second = asyncio.create_task(program.send("G01 X2"))
        await asyncio.to_thread(server.wait_until, lambda: server.asked["submit"] >= 2)
        server.run_lines(program.id)
        assert (await second).number == 2
        server.run_lines(program.id)


async def test_reports_tell_the_start_and_end_of_lines_and_end_with_the_program(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:
        reports = program.reports
        await program.send("G01 X1")
        await program.send("G01 X2")
        await program.finish()
        seen = [(report.kind, report.line) async for report in reports]
    assert seen == [("started", 1), ("ended", 1), ("started", 2), ("ended", 2), ("program", 2)]


async def test_a_line_with_a_line_end_is_refused_before_it_is_sent(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:
        with pytest.raises(RequestRefused, match="MC538"):
            await program.send("G01 X1\nG01 X2")
        with pytest.raises(RequestRefused, match="MC538"):
            await program.send("(" + "x" * 9000 + ")")
        await program.send("G01 X1\r\n")
    assert [text for _, _, text in server.executed] == ["G01 X1"]


async def test_a_program_goes_on_with_the_numbers_of_the_file(server: FakeServer) -> None:
    shown: list[Continuation] = []
    async with (
        Machine.connect(connect=server.endpoint) as machine,
        machine.continue_program("p0", line=7, show=shown.append) as program,
    ):
        assert (shown[0].line, shown[0].done) == (7, 6)
        assert (program.done_through, program.given_through) == (6, 6)
        assert (await program.send("G01 X7")).number == 7
    assert server.programs["p1"].resume_of == "p0"


async def test_nothing_goes_on_where_what_is_shown_is_not_wanted(server: FakeServer) -> None:
    def refuse(shown: Continuation) -> None:
        raise RuntimeError(f"not from line {shown.line}")

    async with Machine.connect(connect=server.endpoint) as machine:
        with pytest.raises(RuntimeError, match="not from line 7"):
            await machine.continue_program("p0", line=7, show=refuse)
    assert not server.programs


async def test_lines_may_come_from_an_asynchronous_source(server: FakeServer) -> None:
    async def lines() -> object:
        for number in range(3):
            yield f"G01 X{number}"

    async with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:
        assert await program.send_lines(lines()) == 3  # type: ignore[arg-type]
    assert len(server.executed) == 3


async def test_a_program_in_single_line_mode_goes_on_with_step(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine, machine.program(step=True) as program:
        await program.send_lines(["G01 X1", "G01 X2"])
        assert server.executed == []
        await program.step()
        await program.wait_done(1)
        assert len(server.executed) == 1
        await program.step()


async def test_a_stream_that_is_cancelled_feeds_nothing_more(server: FakeServer) -> None:
    server.runs_by_itself = False
    server.credit_limit = 10
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        streaming = asyncio.create_task(program.send_lines(f"G01 X{n}" for n in range(1000)))
        await asyncio.to_thread(server.wait_until, lambda: server.programs[program.id].accepted == 10)
        streaming.cancel()
        with pytest.raises(asyncio.CancelledError):
            await streaming
        assert program.given_through == 10
        server.run_lines(program.id)
        # the next line has the number behind those that had gone out
        assert (await program.send("G01 X7")).number == 11
        server.run_lines(program.id)
        await program.finish()
    assert [number for _, number, _ in server.executed] == list(range(1, 12))
    assert server.executed[-1][2] == "G01 X7"


async def test_lines_go_out_while_their_source_waits_for_their_motion(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:

        async def lines() -> object:
            for number in range(1, 4):
                yield f"G01 X{number}"
                await program.wait_done(number)

        assert await program.send_lines(lines()) == 3


async def test_whoever_waits_or_asks_when_the_client_is_closed_hears_so_at_once(server: FakeServer) -> None:
    server.runs_by_itself = False
    machine = await Machine.connect(connect=server.endpoint)
    program = await machine.program()
    line = await program.send("G01 X1")
    waiting = asyncio.create_task(line.done())
    await asyncio.sleep(0)
    await machine.close()
    with pytest.raises(MotionError, match="MC539"):
        await waiting
    with pytest.raises(MotionError, match="MC539"):
        await machine.status()


async def test_a_client_that_is_closed_says_that_it_goes(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program(on_disconnect="finish", grace_s=60.0)
        await program.send("G01 X1")
    assert server.asked["leave"] == 1
    assert ("open", 60.0) in [(name, fields.get("grace_s")) for name, fields in server.requests]
