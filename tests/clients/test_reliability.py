"""Lost messages, lost links and restarts: no line is lost, none runs twice, and what cannot go on says so."""

from __future__ import annotations

import asyncio

import pytest
from fake_methods import Refusal
from fake_server import FakeServer
from mcclient import (
    Machine,
    NoAnswerInTime,
    NobodyAnswers,
    ProgramInterrupted,
    RequestRefused,
)
from mcclient.types import OverrideReply


def numbers(server: FakeServer) -> list[int]:
    return [number for _, number, _ in server.executed]


@pytest.mark.parametrize("lost", ["reply:open", "query:open", "reply:submit", "query:submit", "reply:close"])
async def test_a_lost_request_or_reply_is_repeated_and_nothing_is_done_twice(
    server: FakeServer, lost: str
) -> None:
    server.lose[lost] = 3
    async with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:
        await program.send("G01 X1")
        await program.send("G01 X2")
    method = lost.partition(":")[2]
    assert numbers(server) == [1, 2]
    assert server.asked[method] > server.calls[method]
    assert server.calls["open"] == server.calls["close"] == 1


@pytest.mark.parametrize("lost", ["put", "ack"])
async def test_lost_lines_and_lost_acknowledgements_are_made_good(server: FakeServer, lost: str) -> None:
    async with Machine.connect(connect=server.endpoint) as machine, machine.program() as program:
        server.lose[lost] = 3
        await program.send_lines([f"G01 X{n}" for n in range(4000)])
    assert numbers(server) == list(range(1, 4001))


async def test_a_lost_link_is_survived_without_losing_or_repeating_a_line(server: FakeServer) -> None:
    async def lines() -> object:
        for number in range(6000):
            if number == 3000:
                await asyncio.to_thread(server.lose_link)
            yield f"G01 X{number}"

    async with Machine.connect(connect=server.endpoint) as machine:
        async with machine.program() as program:
            await program.send_lines(lines())  # type: ignore[arg-type]
        assert machine.online
    assert numbers(server) == list(range(1, 6001))


async def test_a_restarted_server_interrupts_the_program_and_says_how_to_resume(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        await program.send_lines(["G01 X1", "G01 X2", "G01 X3"])
        server.run_lines(program.id, 1)
        await program.wait_done(1)
        await asyncio.to_thread(server.go_away)
        await asyncio.to_thread(server.come_back)
        with pytest.raises(ProgramInterrupted) as caught:
            await program.done()
        error = caught.value
        assert (error.program, error.accepted, error.done) == (program.id, 3, 1)
        assert f"continue_program('{program.id}')" in error.hint
        server.runs_by_itself = True
        async with machine.continue_program(error.program, line=error.done + 1) as resumed:
            assert await resumed.send_lines(["G01 X2", "G01 X3"]) == 3
    assert numbers(server) == [1, 2, 3]


async def test_a_server_that_comes_back_as_another_machine_is_asked_what_it_is(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        assert len(machine.info.axes) == server.axis_count
        await asyncio.to_thread(server.go_away)
        server.axis_count = 2
        await asyncio.to_thread(server.come_back)
        async with asyncio.timeout(60.0):
            while len(machine.info.axes) != 2:
                await asyncio.sleep(0.01)
        assert machine.info.instance == server.instance


async def test_a_line_under_way_when_the_server_restarts_is_reported_as_interrupted(
    server: FakeServer,
) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        program = await machine.program()
        await program.send("G01 X1")
        await asyncio.to_thread(server.go_away)
        sending = asyncio.create_task(program.send("G01 X2"))
        await asyncio.to_thread(server.come_back)
        with pytest.raises(ProgramInterrupted):
            await sending
        with pytest.raises(ProgramInterrupted):
            await program.send("G01 X3")
    assert numbers(server) == [1]


async def test_a_server_that_stays_away_is_reported_with_what_was_accepted(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint, patience_s=0.3) as machine:
        program = await machine.program()
        await program.send_lines(["G01 X1"])
        await asyncio.to_thread(server.go_away)
        with pytest.raises(NobodyAnswers, match="lines through 1 were accepted") as caught:
            await program.done()
        assert caught.value.exit_code == 5
        assert not machine.online


async def test_a_request_made_while_the_server_is_away_is_carried_out_once_when_it_is_back(
    server: FakeServer,
) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        await asyncio.to_thread(server.go_away)
        overriding = asyncio.create_task(machine.override(40.0))
        await asyncio.to_thread(server.come_back)
        assert await overriding == OverrideReply(40.0, ())
        assert server.calls["override"] == 1


async def test_a_server_that_answers_nothing_is_reported_as_a_missing_answer(server: FakeServer) -> None:
    server.lose["query:status"] = 10**6
    async with Machine.connect(connect=server.endpoint) as machine:
        with pytest.raises(NoAnswerInTime, match="has not answered status"):
            await machine.status(deadline_s=0.2)


async def test_a_server_that_is_stopping_is_asked_again(
    server: FakeServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    refusals = 0

    def stopping(_: object) -> dict[str, object]:
        nonlocal refusals
        refusals += 1
        server._answers.clear()
        monkeypatch.undo()
        raise Refusal("MC515", "the server is stopping")

    async with Machine.connect(connect=server.endpoint) as machine:
        monkeypatch.setattr(server, "_do_override", stopping, raising=False)
        replies = asyncio.create_task(machine.override(50.0))
        await asyncio.to_thread(server.wait_until, lambda: refusals == 1)
        with server._lock:
            server._answers.clear()
        assert await replies == OverrideReply(50.0, ())


async def test_errors_of_the_server_carry_code_hint_and_details(server: FakeServer) -> None:
    async with Machine.connect(connect=server.endpoint) as machine:
        with pytest.raises(RequestRefused) as caught:
            await machine.program(axes=[9])
        assert (caught.value.code, caught.value.details) == ("MC507", {"axis": 9})
        assert caught.value.is_wrong_value


async def test_the_client_is_seen_to_go(server: FakeServer) -> None:
    server.runs_by_itself = False
    async with Machine.connect(connect=server.endpoint) as machine:
        assert server.clients == set()
        program = await machine.program(on_disconnect="finish")
        await program.send("G01 X1")
        await asyncio.to_thread(server.wait_until, lambda: server.clients == {machine.client})
    await asyncio.to_thread(server.wait_until, lambda: server.clients == set())
    assert server.programs[program.id].state == "finished"
