"""A client that is killed in the middle of its stream: the program stops on its path, or finishes."""

from __future__ import annotations

import asyncio
import contextlib
import signal
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest
from mcclient import Machine

from tests.e2e.observing import LIMIT_S, event, known, listening_events, recorded, run
from tests.e2e.servers import ROOT, ServerProcess, environment

LINES = 40
CLIENT = """
import asyncio, sys
from mcclient import Machine

async def lines():
    yield "G1010"
    yield "G94 F6000"
    for number in range(1, {lines} - 1):
        yield f"G01 X{{5 * number}} Y{{2 * number}}"
    print("sent", flush=True)
    await asyncio.Event().wait()

async def main():
    async with Machine.connect(sys.argv[1], sys.argv[2]) as machine:
        async with machine.program("doomed", [0, 1], on_disconnect=sys.argv[3], grace_s=0.2) as program:
            print(program.id, flush=True)
            await program.send_lines(lines())

asyncio.run(main())
"""


@contextlib.asynccontextmanager
async def client(
    server: ServerProcess, folder: Path, on_disconnect: str
) -> AsyncIterator[asyncio.subprocess.Process]:
    """A client process that streams lines and never comes to the end of them."""
    script = folder / "client.py"
    script.write_text(CLIENT.format(lines=LINES), "utf-8")
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        str(script),
        server.name,
        server.endpoint,
        on_disconnect,
        stdout=asyncio.subprocess.PIPE,
        env=environment(),
        cwd=ROOT,
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()


async def kill_in_mid_stream(machine: Machine, process: asyncio.subprocess.Process) -> str:
    """Kills the client once one of its moves is under way; gives its program's id."""
    assert process.stdout is not None
    events = await listening_events(machine)
    async with asyncio.timeout(LIMIT_S):
        program = (await process.stdout.readline()).decode().strip()
        assert (await process.stdout.readline()).strip() == b"sent"
        while (await event(events, "lines.started", program)).line < 6:
            pass
    process.send_signal(signal.SIGKILL)
    return program


async def test_stop_comes_to_rest_on_the_path_and_gives_the_axes_back(
    machine: Machine, server: ServerProcess, tmp_path: Path
) -> None:
    await run(machine, ["G1010", "G00 X0 Y0"])
    events = await listening_events(machine)
    async with client(server, tmp_path, "stop") as process, recorded(machine) as recording:
        program = await kill_in_mid_stream(machine, process)
        gone = await event(events, "client.gone")
        ended = await event(events, "program.ended", program)
    assert gone.client is not None
    assert ended.state == "aborted"
    path = recording.setpoint[:, :2]
    assert path[:, 1] == pytest.approx(0.4 * path[:, 0], abs=0.001)
    end = path[-1, 0]
    assert 5.0 < end < 5.0 * (LINES - 2), "in mid-program"
    assert np.abs(path[-1] - path[-2]).max() < 1e-4, "at rest"
    status = await known(machine, program)
    assert (status.state, status.accepted) == ("aborted", LINES)
    assert status.done < LINES
    # the axes can be had again, and count from where they came to rest
    again = await run(machine, ["G1010", "G91 G93 F600 G01 X1 Y1"], [0, 1])
    assert again.line(2).requested_s == pytest.approx(0.1)
    assert (await machine.status()).axes.setpoint[0] == pytest.approx(end + 1.0, abs=0.02)


async def test_finish_runs_to_the_end_of_what_was_accepted(
    machine: Machine, server: ServerProcess, tmp_path: Path
) -> None:
    await run(machine, ["G1010", "G00 X0 Y0"])
    events = await listening_events(machine)
    async with client(server, tmp_path, "finish") as process:
        program = await kill_in_mid_stream(machine, process)
        ended = await event(events, "program.ended", program)
    assert ended.state == "finished"
    status = await known(machine, program)
    assert (status.state, status.accepted, status.done) == ("finished", LINES, LINES)
    end = 5.0 * (LINES - 2), 2.0 * (LINES - 2)
    assert (await machine.status()).axes.setpoint[:2] == pytest.approx(end, abs=0.01)
