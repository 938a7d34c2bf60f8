"""Homing, M62, an interlock and probing on simulated drives, read back from the server's recording cycle by
cycle."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcclient import Event, Machine

from tests.e2e.conftest import connected, served
from tests.e2e.homed_axis import HOMED_AXIS
from tests.e2e.servers import ServerProcess
from tests.recorder.rig import column, decoded

LIMIT_S = 60.0
MACHINE = f"""
[machine]
name = "cell"
[[input]]
number = 0
name = "door"
hold_on = true
[[output]]
number = 0
name = "laser"
{HOMED_AXIS}
initial_position = 0.0
"""
PROGRAM = [
    "G1010",
    "G94 F6000",
    "M62 P0",
    "G01 X50",  # the laser is on from here
    "M63 P0",
    "G01 X60",  # and off from here
    "G01 X250",  # the door opens on this line
    "G01 X20",
    "G38.2 X0 F1200",
]
DOOR, LASER = 0, 0
MOST_ACCELERATION = 2000.0


@pytest.fixture
def cell(tmp_path: Path) -> Iterator[ServerProcess]:
    file = tmp_path / "cell.toml"
    file.write_text(MACHINE, "utf-8")
    yield from served(tmp_path, str(file), "cell", recorder=True)


@asynccontextmanager
async def events_of(machine: Machine) -> AsyncIterator[asyncio.Queue[Event]]:
    events: asyncio.Queue[Event] = asyncio.Queue()

    async def listen() -> None:
        async for event in machine.events():
            events.put_nowait(event)

    listening = asyncio.ensure_future(listen())
    try:
        yield events
    finally:
        listening.cancel()


async def until(events: asyncio.Queue[Event], kind: str) -> Event:
    async with asyncio.timeout(LIMIT_S):
        while (event := await events.get()).kind != kind:
            pass
        return event


async def record_a_run(cell: ServerProcess) -> Event:
    """Home, run the program, open the door on the way, resume; the event of the probe."""
    async with connected(cell) as machine, events_of(machine) as events:
        await machine.record_start("run")
        async with asyncio.timeout(LIMIT_S):
            while "run" not in {each.name for each in (await machine.recordings()).recordings}:
                await asyncio.sleep(0.05)
        await machine.home()
        await until(events, "axis.homed")
        async with asyncio.timeout(LIMIT_S):
            while any(each.ended_at is None for each in (await machine.status()).programs):
                await asyncio.sleep(0.05)
        async with machine.program("part") as program:
            await program.send_lines(PROGRAM)
            finishing = asyncio.ensure_future(program.finish())
            async with asyncio.timeout(LIMIT_S):
                while program.done_through < 6:
                    await asyncio.sleep(0.005)
            await machine.set_simulated_input("door", True)
            await until(events, "program.held")
            async with asyncio.timeout(LIMIT_S):
                while abs((await machine.status()).axes.velocity[0]) > 1e-3:
                    await asyncio.sleep(0.05)
            await machine.set_simulated_input("door", False)
            async with asyncio.timeout(LIMIT_S):
                while any(each.holds for each in (await machine.status()).inputs):
                    await asyncio.sleep(0.05)
            await machine.resume(program.id)
            await finishing
        probed = await until(events, "probe")
        await machine.record_stop()
        async with asyncio.timeout(LIMIT_S):
            while (await machine.recordings()).recordings[0].state != "done":
                await asyncio.sleep(0.05)
        return probed


def channel(messages: list[Any], name: str, number: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Values of one entry of a repeated field, a cycle each."""
    return np.array([getattr(message, name)[number] for _, _, message in messages])


async def test_homing_outputs_interlock_and_probe_are_recorded_in_step_with_the_motion(
    cell: ServerProcess, tmp_path: Path
) -> None:
    probed = await record_a_run(cell)
    path = tmp_path / "recordings" / "cell" / "run.mcap"
    cycles = decoded(path, "/cycles")
    number, line = column(cycles, "cycle"), column(cycles, "line")
    assert (np.diff(number) == 1).all()
    setpoint, position = (channel(cycles, name, 0) for name in ("setpoint", "position"))
    speed = np.diff(setpoint, prepend=setpoint[0]) / 1e-3

    # homing: the place is given to encoder and setpoint in one cycle, and the drive notices nothing
    (given,) = np.nonzero(np.abs(np.diff(setpoint)) > 1.0)[0]
    assert setpoint[given + 1] - setpoint[given] == pytest.approx(
        position[given + 1] - position[given], abs=0.02
    )
    lag = setpoint - position
    assert np.abs(np.diff(lag)).max() < 0.05
    # the switch lies at -10 mm of the encoder, and the axis reads -2 mm there
    assert setpoint[given + 1] - setpoint[given] == pytest.approx(8.0, abs=0.02)

    # M62 and M63: in the cycle in which the next motion begins
    laser = channel(cycles, "output", LASER)
    on, off = int(np.argmax(laser == 1.0)), int(np.argmax((laser == 0.0) & (line >= 6)))
    assert on == int(np.argmax(line == 4))
    assert off == int(np.argmax(line == 6))
    assert laser[on:off].all()
    assert not laser[off:].any()
    assert abs(setpoint[on] - 5.0) < 0.01 < setpoint[on + 30] - 5.0

    # the interlock: the cycle behind its reading brakes, within the axis's limits
    door = channel(cycles, "input", DOOR)
    opened = int(np.argmax(door == 1.0))
    assert line[opened] == 7
    before = speed[opened - 5 : opened + 1]
    assert before == pytest.approx(np.full(6, before[0]), abs=0.05)
    assert speed[opened + 2] < speed[opened] - 0.1
    rest = opened + int(np.argmax(np.abs(speed[opened:]) < 1e-2))
    assert (rest - opened) * 1e-3 < speed[opened] / MOST_ACCELERATION + 0.01
    assert [bool(message.interlock) for _, _, message in cycles[opened - 1 : opened + 2]] == [
        False,
        True,
        True,
    ]

    # probing: the latched place lies between the readings of the cycle of contact and of the one before it
    assert probed.probe is not None
    assert probed.probe.tripped
    place = probed.probe.positions["0"]
    touched = int(np.argmax((position <= 10.0) & (line == 9)))
    assert (
        min(position[touched - 1 : touched + 1]) - 1e-6
        <= place
        <= max(position[touched - 1 : touched + 1]) + 1e-6
    )
    slowing = speed[touched : touched + 4]
    assert slowing[-1] > slowing[0]
    # nothing of all this passes a limit of the axis
    for part in (speed[: given + 1], speed[given + 2 :]):
        assert np.abs(np.diff(part)).max() / 1e-3 < MOST_ACCELERATION * 1.02
