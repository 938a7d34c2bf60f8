"""An operator's orders while axes move: hold, resume, override, emergency stop, reset."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable

import numpy as np
import pytest
from mcclient import (
    Feed,
    Machine,
    MachineStatus,
    Program,
    ProgramFaulted,
    ProgramRejected,
    Report,
    RequestRefused,
)
from mcclient.types import AxisState

from tests.e2e.observing import (
    LIMIT_S,
    Recording,
    event,
    line_started,
    listening,
    listening_events,
    recorded,
    reset,
    run,
)

# 100 mm/s along a line with Y = X / 2
SLOW = ["G1010", "G94 F6000", "G01 X400 Y200"]
START = ["G1010", "G00 X0 Y0"]


@contextlib.asynccontextmanager
async def moving(machine: Machine) -> AsyncIterator[tuple[Program, Feed[Report], Recording]]:
    """A program in the middle of a long line, recorded."""
    await run(machine, START)
    async with asyncio.timeout(LIMIT_S), recorded(machine) as recording:
        program = await machine.program(axes=[0, 1])
        reports = await listening(machine, program)
        await program.send_lines(SLOW)
        await line_started(reports, 3)
        await until(machine, lambda status: status.axes.setpoint[0] > 5.0)
        yield program, reports, recording


async def until(machine: Machine, condition: Callable[[MachineStatus], bool]) -> MachineStatus:
    """The first state that fits."""
    async with asyncio.timeout(LIMIT_S):
        async for status in machine.telemetry():
            if condition(status):
                return status
    raise AssertionError("the states ended")


def at_rest(status: MachineStatus) -> bool:
    return max(abs(velocity) for velocity in status.axes.velocity[:2]) < 0.01


async def test_hold_stands_still_on_the_path_and_resume_ends_where_programmed(machine: Machine) -> None:
    async with moving(machine) as (program, _, recording):
        await program.hold()
        held = await until(machine, at_rest)
        standing = await until(machine, lambda status: status.t > held.t + 0.3)
        assert (await program.status()).state == "held"
        assert set(standing.axes.state[:2]) == {AxisState.STANDSTILL}
        await program.resume()
        await until(machine, lambda status: status.axes.state[0] is AxisState.MOVING)
        await program.override(200)
        await program.finish()
    rest = recording.between(held.t, standing.t)[:, :2]
    assert np.ptp(rest, axis=0).max() < 1e-4
    assert 5.0 < rest[0, 0] < 390.0
    path = recording.setpoint[:, :2]
    assert path[:, 1] == pytest.approx(0.5 * path[:, 0], abs=0.001)
    assert np.diff(path[:, 0]).min() > -1e-4, "never backwards"
    assert path[-1] == pytest.approx((400.0, 200.0), abs=0.01)


async def test_emergency_stop_latches_and_faults_the_program_until_reset(machine: Machine) -> None:
    async with moving(machine) as (program, _, _recording):
        events = await listening_events(machine)
        await machine.estop("drill")
        confirmed = await event(events, "estop")
        assert confirmed.reason == "drill"
        ended = await event(events, "program.ended", program.id)
        assert ended.state == "faulted"
        with pytest.raises(ProgramFaulted):
            await program.finish()
        stopped = await until(machine, at_rest)
        assert stopped.state == "estop"
        with pytest.raises(RequestRefused, match="MC509: "):
            await machine.program()
        await reset(machine)
        assert (await machine.status()).state == "ready"
        # nothing starts by itself, and axes have to be captured anew
        assert at_rest(await machine.status())
        with pytest.raises((ProgramFaulted, ProgramRejected)):
            await run(machine, ["G93 F600 G01 X0 Y0"], [0, 1])
        await reset(machine)
        await run(machine, ["G1010", "G93 F60 G01 X0 Y0"], [0, 1])
