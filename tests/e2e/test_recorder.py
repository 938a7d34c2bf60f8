"""The recorder beside a real server: faults, and the recorder's and the server's own death."""

from __future__ import annotations

import asyncio
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcclient import Event, Machine, MotionError

from tests.e2e.conftest import Mcctl, connected, served
from tests.e2e.servers import ServerProcess, children, command_line, wait_for_end
from tests.recorder.rig import column, decoded

RECORDER = "mcserver.recorder.process"
LIMIT_S = 60.0
# a drive that lags too far at full speed
MACHINE = """
[machine]
name = "boxed"
[recorder]
after_s = 0.3
[[axis]]
index = 0
type = "linear"
max_velocity = 1000.0
max_acceleration = 10000.0
max_following_error = 0.5
[axis.drive]
kind = "simulated"
bandwidth_hz = 3
"""


@pytest.fixture
def boxed(tmp_path: Path) -> Iterator[ServerProcess]:
    file = tmp_path / "boxed.toml"
    file.write_text(MACHINE)
    yield from served(tmp_path, str(file), "boxed", recorder=True)


def recorders(server: ServerProcess) -> list[int]:
    return [pid for pid in children(server.pid) if RECORDER in command_line(pid)]


async def until(events: asyncio.Queue[Event], kind: str, reason: str | None = None) -> Event:
    async with asyncio.timeout(LIMIT_S):
        while True:
            event = await events.get()
            if event.kind == kind and (reason is None or event.reason == reason):
                return event


async def listen(machine: Machine, events: asyncio.Queue[Event]) -> None:
    async for event in machine.events():
        events.put_nowait(event)


async def run_into_a_fault(machine: Machine) -> None:
    async with machine.program("fast") as program:
        await program.send_lines(["G1010 P0", "G01 X1 F60", "G01 X500 F60000"])
        await program.finish()


async def recorder_runs(machine: Machine) -> None:
    async with asyncio.timeout(LIMIT_S):
        while (await machine.recordings()).recorder is None:
            await asyncio.sleep(0.05)


async def test_a_fault_a_killed_recorder_and_a_killed_server(
    boxed: ServerProcess, tmp_path: Path, mcctl: Mcctl
) -> None:
    folder = tmp_path / "recordings" / "boxed"
    async with connected(boxed) as machine:
        events: asyncio.Queue[Event] = asyncio.Queue()
        listening = asyncio.ensure_future(listen(machine, events))
        await recorder_runs(machine)
        with pytest.raises(MotionError):
            await run_into_a_fault(machine)

        # the fault is written out by itself, with what was before it
        saved = await until(events, "recording")
        assert saved.reason == "MC407"
        path = folder / f"{saved.message}.mcap"
        messages = decoded(path)
        cycles = [each for each in messages if each[0] == "/cycles"]
        faulty = [message.cycle for _, _, message in cycles if message.condition[0] == 8]
        before = column(cycles, "cycle") < faulty[0]
        assert before.sum() > 1000
        assert column(cycles, "time")[-1] >= faulty[0] * 1e-3 + 0.3
        assert any(topic == "/events" and value["kind"] == "fault" for topic, _, value in messages)
        text = [value["lines"] for topic, _, value in messages if topic == "/program"]
        assert "G01 X500 F60000" in text[0]

        # a recorder that is killed costs the recording, and is replaced
        await machine.record_start("cut")
        async with asyncio.timeout(20.0):
            # with its head on the disk: there is nothing to repair without it
            while not any(
                each.name == "cut" and each.size for each in (await machine.recordings()).recordings
            ):
                await asyncio.sleep(0.05)
        (pid,) = recorders(boxed)
        os.kill(pid, signal.SIGKILL)
        assert (await until(events, "warning", "MC580")).message.startswith(
            "the recorder was ended by signal 9"
        )
        await recorder_runs(machine)
        states = {each.name: each.state for each in (await machine.recordings()).recordings}
        assert states["cut"] == "done", "repaired by the next one"
        assert (await machine.status()).t > 0.0
        listening.cancel()

    order = ("--connect", boxed.endpoint)
    for words in (("start", "kept", "--seconds", "600"), ("stop", "kept"), ("list",)):
        shown = await asyncio.to_thread(mcctl, "record", *words, *order)
        assert shown.returncode == 0, shown.stderr
    assert "kept" in shown.stdout
    shown = await asyncio.to_thread(mcctl, "record", "get", "cut", *order, "-o", str(tmp_path / "cut.mcap"))
    assert shown.returncode == 0, shown.stderr
    assert (tmp_path / "cut.mcap").read_bytes() == (folder / "cut.mcap").read_bytes()

    # a server that is killed leaves a box behind, written by the recorder that outlives it
    (pid,) = recorders(boxed)
    boxed.end(signal.SIGKILL)
    assert wait_for_end(pid, LIMIT_S)
    (left,) = folder.glob("blackbox-*-server-lost.mcap")
    assert len(decoded(left, "/cycles")) > 100
