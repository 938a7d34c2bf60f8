"""The server, its executor or its planner killed in the middle of a program."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcclient import Machine, MotionError, Program, ProgramInterrupted, RequestRefused, Servo

from tests.e2e.conftest import connected
from tests.e2e.observing import (
    LIMIT_S,
    event,
    known,
    line_started,
    listening,
    listening_events,
    recorded,
    run,
)
from tests.e2e.servers import ServerProcess, command_line, wait_for_end

# increments in inches with an F of their own: modal state that a restart must not lose
MODAL = [
    *["G1010", "G20 G91", "G94 F300"],
    *["G01 X1", "G01 X1", "G01 X1", "G01 X1 F60", "G01 X1 F300", "G01 X1"],
]
SLOW = 7
SLOW_MM = 3 * 25.4
END_MM = 6 * 25.4
# the executor stops when the server's beat stays out, and then goes
EXECUTOR_LIMIT_S = 15.0


@pytest.fixture(scope="module")
def process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerProcess]:
    made = ServerProcess(tmp_path_factory.mktemp("own"), "cartesian", "own")
    yield made
    made.close()


@pytest.fixture
def own_server(process: ServerProcess) -> Iterator[ServerProcess]:
    """A server that a test may end and start as it likes; started where the test before has ended it."""
    if not process.running:
        process.start()
    yield process
    sys.stderr.write("".join(process.said))


async def killed_in_the_slow_line(
    machine: Machine, server: ServerProcess
) -> tuple[Program, ProgramInterrupted]:
    """A program whose server was killed and started again in its middle, and what its client is answered."""
    program = await machine.program("part", [0])
    await program.send_lines(MODAL)
    await program.wait_done(SLOW - 1)
    # the journal has what has ended within 20 ms, which the slow line goes a tenth of this way in
    async with asyncio.timeout(LIMIT_S):
        while (await machine.status()).axes.setpoint[0] < SLOW_MM + 5.0:
            await asyncio.sleep(0.01)
    server.end(signal.SIGKILL)
    server.start()
    with pytest.raises(ProgramInterrupted) as interrupted:
        async with asyncio.timeout(LIMIT_S):
            await program.finish()
    return program, interrupted.value


async def test_a_killed_server_shows_the_program_interrupted_and_moves_nothing(
    own_server: ServerProcess,
) -> None:
    async with connected(own_server) as machine:
        program, error = await killed_in_the_slow_line(machine, own_server)
        assert (error.program, error.accepted, error.done) == (program.id, len(MODAL), SLOW - 1)
        assert f"continue_program({program.id!r})" in error.hint
        assert f"line {SLOW} of {len(MODAL)} may have begun" in error.message
        with pytest.raises(ProgramInterrupted, match="MC534: "):
            await program.abort()
        with pytest.raises(RequestRefused, match="MC503: "):
            await machine.hold(program.id)

        found = await known(machine, program.id)
        assert (found.state, found.accepted, found.done) == ("interrupted", len(MODAL), SLOW - 1)
        events = (await machine.past_events(0)).events
        (end,) = [each for each in events if each.kind == "program.ended"]
        assert (end.program, end.state, end.line) == (program.id, "interrupted", SLOW - 1)
        async with recorded(machine) as recording:
            status = await machine.status()
            assert status.programs == ()
            assert set(status.axes.state) == {"off"}
        assert abs(recording.velocity).max() == 0.0


async def test_a_program_goes_on_by_one_call_with_its_modal_state_and_ends_where_it_ends(
    own_server: ServerProcess,
) -> None:
    async with connected(own_server) as machine:
        program, _ = await killed_in_the_slow_line(machine, own_server)
        shown = await machine.continuation(program.id)
        assert (shown.line, shown.done, shown.whole, shown.energize) == (SLOW, SLOW - 1, False, (0,))
        assert "G20" in shown.modal
        assert "G91" in shown.modal
        # the drives are simulated and began at 0 again
        (x,) = shown.axes
        assert (x.now, x.there) == (pytest.approx(0.0, abs=0.01), pytest.approx(SLOW_MM))
        assert [need.confirm for need in shown.needs] == ["way"]
        with pytest.raises(RequestRefused, match="MC592: "):
            await machine.continue_program(program.id)
        assert (await machine.status()).axes.state == ("off",) * len(machine.info.axes)
        async with asyncio.timeout(LIMIT_S):
            goes_on = await machine.continue_program(program.id, way=True)
            assert (goes_on.given_through, goes_on.done_through) == (len(MODAL), SLOW - 1)
            reports = await listening(machine, goes_on)
            await goes_on.finish()
            timings = [each.timing async for each in reports if each.timing is not None]
        assert [each.line for each in timings] == [7, 8, 9]
        # an inch at 60 and at 300 inches a minute
        assert [each.requested_s for each in timings] == pytest.approx([1.0, 0.2, 0.2])
        assert (await machine.status()).axes.setpoint[0] == pytest.approx(END_MM, abs=0.01)
        assert (await known(machine, goes_on.id)).resume_of == program.id
        with pytest.raises(RequestRefused, match="MC517: "):
            await machine.continue_program(program.id, way=True)


async def until_refused(servo: Servo) -> None:
    """Send targets until that raises."""
    async with asyncio.timeout(LIMIT_S):
        while True:
            await servo.send([3.0])
            await asyncio.sleep(0.01)


async def test_targets_for_a_server_that_was_started_again_are_refused_by_the_sdk(
    own_server: ServerProcess,
) -> None:
    async with connected(own_server) as machine:
        # the longest: how long the server takes to start again is not what is asked here
        servo = await machine.servo([0], counts_s=10.0)
        own_server.end(signal.SIGKILL)
        own_server.start()
        await machine.refresh_info(deadline_s=LIMIT_S)
        with pytest.raises(ProgramInterrupted) as interrupted:
            await until_refused(servo)
        assert (interrupted.value.code, servo.state) == ("MC534", "interrupted")
        assert "servo mode anew" in interrupted.value.hint
        with pytest.raises(RequestRefused, match="MC517: "):
            await machine.continue_program(servo.id)


async def test_f_of_an_earlier_line_is_in_force_where_a_program_goes_on(own_server: ServerProcess) -> None:
    async with connected(own_server) as machine:
        # increments go on from where the program began, wherever the drives begin again
        begun = (await machine.status()).axes.setpoint[0]
        program = await machine.program("part", [0])
        await program.send_lines(["G1010", "G20 G91", "G94 F300", "G01 X1", "G04 P30", "G01 X1"])
        await program.wait_done(4)
        own_server.end(signal.SIGKILL)
        own_server.start()
        await machine.refresh_info(deadline_s=LIMIT_S)
        async with asyncio.timeout(LIMIT_S):
            goes_on = await machine.continue_program(program.id, line=6, way=True)
            reports = await listening(machine, goes_on)
            await goes_on.send("G01 X1")
            await goes_on.finish()
            timings = [each.timing async for each in reports if each.timing is not None]
        assert [each.requested_s for each in timings] == pytest.approx([0.2, 0.2])
        assert (await machine.status()).axes.setpoint[0] == pytest.approx(begun + 3 * 25.4, abs=0.01)


async def test_a_killed_executor_is_reported_and_ends_the_server(own_server: ServerProcess) -> None:
    async with connected(own_server) as machine:
        program = await machine.program("part", [0])
        events = await listening_events(machine)
        reports = await listening(machine, program)
        await program.send_lines(["G1010", "G94 F600", "G01 X500"])
        await line_started(reports, 3)
        (executor,) = own_server.executors()
        os.kill(executor, signal.SIGKILL)
        fault = await event(events, "fault")
        assert fault.fault is not None
        assert fault.fault.code == "MC518"
        assert own_server.wait() != 0
        assert "MC518" in "".join(own_server.said)
        own_server.start()
        found = await known(machine, program.id)
        assert found.state in ("faulted", "interrupted")
        with pytest.raises(MotionError) as error:
            async with asyncio.timeout(LIMIT_S):
                await program.finish()
        assert error.value.code in ("MC518", "MC534")
        assert set((await machine.status()).axes.state) == {"off"}


async def test_a_killed_planner_stops_its_programs_on_their_paths_and_another_goes_on(
    own_server: ServerProcess,
) -> None:
    async with connected(own_server) as machine:
        program = await machine.program("part", [0])
        waiting = await machine.program("next", [0])
        await waiting.send_lines(["G1010", "G93 F600 G01 X1"])
        reports = await listening(machine, program)
        await program.send_lines(["G1010", "G94 F6000", "G01 X500"])
        await line_started(reports, 3)
        async with recorded(machine) as recording:
            (planner,) = own_server.planners()
            os.kill(planner, signal.SIGKILL)
            for lost in (program, waiting):
                with pytest.raises(MotionError) as error:
                    async with asyncio.timeout(LIMIT_S):
                        await lost.finish()
                assert error.value.code == "MC516"
                assert "ended by signal 9" in error.value.message
            status = await machine.status()
        assert [each for each in status.axes.state if each != "off"] == ["standstill"]
        assert 0.0 < status.axes.setpoint[0] < 500.0
        # it was brought to rest within its limits, from 100 mm/s at 10 000 mm/s²
        speed = np.diff(recording.setpoint[:, 0]) / 0.001
        assert abs(np.diff(speed)).max() <= 10_000.0 * 0.001 * 1.02 + 0.1
        (again,) = own_server.planners()
        assert again != planner
        await run(machine, ["G93 F600 G01 X1"])
        assert (await machine.status()).axes.setpoint[0] == pytest.approx(1.0)
    assert own_server.end(signal.SIGTERM) == 0
    assert command_line(again) == ""


async def test_sigterm_brings_motion_to_rest_and_leaves_nothing_open(own_server: ServerProcess) -> None:
    async with connected(own_server) as machine:
        program = await machine.program("part", [0])
        reports = await listening(machine, program)
        await program.send_lines(["G1010", "G94 F600", "G01 X500"])
        await line_started(reports, 3)
        (executor,), (planner,) = own_server.executors(), own_server.planners()
        assert own_server.end(signal.SIGTERM) == 0
        narration = "".join(own_server.said)
        assert "stopped" in narration
        assert "Traceback" not in narration
        assert [command_line(each) for each in (executor, planner)] == ["", ""]
        own_server.start()
        found = await known(machine, program.id)
        assert (found.state, found.done) == ("aborted", 2)


async def test_a_planner_that_ends_again_and_again_ends_the_server(own_server: ServerProcess) -> None:
    seen: set[int] = set()
    async with asyncio.timeout(4 * LIMIT_S):
        while len(seen) < 4:
            for planner in set(own_server.planners()) - seen:
                seen.add(planner)
                with contextlib.suppress(ProcessLookupError):
                    os.kill(planner, signal.SIGKILL)
            await asyncio.sleep(0.02)
    assert await asyncio.to_thread(own_server.wait) != 0
    assert "MC518" in "".join(own_server.said)


async def test_a_killed_server_leaves_no_process_and_no_memory(own_server: ServerProcess) -> None:
    named = named_memory()
    async with connected(own_server) as machine:
        program = await machine.program("part", [0])
        reports = await listening(machine, program)
        await program.send_lines(["G1010", "G94 F6000", "G01 X500"])
        await line_started(reports, 3)
        (executor,) = own_server.executors()
        (planner,) = own_server.planners()
        own_server.end(signal.SIGKILL)
        for orphan in (executor, planner):
            assert await asyncio.to_thread(wait_for_end, orphan, EXECUTOR_LIMIT_S)
            assert command_line(orphan) == ""
        own_server.start()
        (again,) = own_server.executors()
        assert again != executor
        await run(machine, ["G1010", "G93 F600 G01 X1"])
    assert own_server.end(signal.SIGTERM) == 0
    assert command_line(again) == ""
    assert named_memory() <= named


def named_memory() -> set[str]:
    """Shared memory with a name that a process could leave behind."""
    names = {entry.name for entry in Path("/dev/shm").iterdir()} if Path("/dev/shm").is_dir() else set()
    return {name for name in names if "mcserver" in name or name.startswith(("psm_", "wnsm_"))}
