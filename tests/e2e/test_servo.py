"""Servo mode on a real server, by the SDK and by the wire: followed, refused, left."""

from __future__ import annotations

import asyncio
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mcclient import Machine, RequestRefused, Servo
from mcclient.sync import Machine as BlockingMachine

from tests.e2e.servers import ROOT, ServerProcess, environment
from tests.net.client import WireClient

PERIOD_S = 0.02


async def stream(servo: Servo, target: list[float], seconds: float) -> None:
    """Send a target over and over."""
    for _ in range(round(seconds / PERIOD_S)):
        await servo.send(target)
        await asyncio.sleep(PERIOD_S)


async def position(machine: Machine, axis: int) -> float:
    axes = (await machine.status()).axes
    return axes.setpoint[axes.index.index(axis)]


async def test_axes_follow_and_end_on_the_last_target(machine: Machine) -> None:
    async with machine.servo([0, 1], counts_s=1.0) as servo:
        assert servo.axes == (0, 1)
        await stream(servo, [5.0, -3.0], 0.3)
        status = (await servo.status()).servo
    assert status is not None
    assert status.taken > 0
    assert [await position(machine, axis) for axis in (0, 1)] == pytest.approx([5.0, -3.0])


async def test_targets_lead_no_axis_beyond_its_bounds(machine: Machine) -> None:
    start = await position(machine, 2)
    async with machine.servo([2], within={2: (start, start + 4.0)}, counts_s=1.0) as servo:
        await stream(servo, [start + 9.0], 1.5)
    assert await position(machine, 2) == pytest.approx(start + 4.0, abs=1e-3)
    with pytest.raises(RequestRefused, match="MC327"):
        await machine.servo([1, 2], within={2: (start, start + 4.0)})


async def test_a_block_that_raises_stops_at_once(machine: Machine) -> None:
    servo = await machine.servo([0], counts_s=5.0)
    await stream(servo, [100.0], 0.1)
    await servo.__aexit__(ZeroDivisionError)
    (found,) = await machine.programs(program=servo.id)
    assert found.state == "aborted"


async def test_targets_of_another_client_move_nothing(machine: Machine, wire: WireClient) -> None:
    start = await position(machine, 0)
    async with machine.servo([0]) as servo:
        for seq in range(1, 20):
            wire.put(f"in/{wire.client}/{servo.id}", [seq, seq * 0.01, 1.0, [[50.0]], None, None])
        await asyncio.sleep(0.2)
        status = (await servo.status()).servo
    assert status is not None
    assert status.taken == 0
    assert await position(machine, 0) == start


async def test_garbage_is_counted_or_ignored_and_the_stream_goes_on(machine: Machine) -> None:
    async with machine.servo([0, 1], counts_s=1.0) as servo:
        await servo.send([float("nan"), 0.0])
        await servo.send([1.0])
        for payload in (b"", b"\xc1", b"\x93\x01\x02\x03", b"\xff" * 100):
            await machine._link.put(servo._key, payload)
        await stream(servo, [1.0, 1.0], 0.2)
        status = (await servo.status()).servo
    assert status is not None
    # one of the last four is a message without rows
    assert status.refused == 3
    assert [await position(machine, axis) for axis in (0, 1)] == pytest.approx([1.0, 1.0])


def test_callers_that_wait_stream_too(server: ServerProcess) -> None:
    with (
        BlockingMachine.connect(server.name, server.endpoint) as machine,
        machine.servo([2], counts_s=1.0) as servo,
    ):
        servo.send([0.5], [0.0])
    assert servo.axes == (2,)


def test_the_example_follows_its_sine(server: ServerProcess) -> None:
    command = [sys.executable, str(ROOT / "examples" / "servo_sine.py"), "--machine", server.name]
    command += ["--connect", server.endpoint, "--axis", "3", "--seconds", "1.5", "--hz", "50"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), timeout=60, check=True)
    at, target = (float(word.strip(",")) for word in done.stdout.splitlines()[-1].split() if "." in word)
    assert at == pytest.approx(target, abs=0.01)


def test_the_example_replays_a_recording(server: ServerProcess, tmp_path: Path) -> None:
    times = np.arange(0.0, 1.0, 0.001)
    wave = 5.0 * np.sin(np.pi * times) ** 2
    file = tmp_path / "path.npz"
    np.savez(file, time_s=times, axes=[3, 5], setpoint=np.column_stack([wave, 2.0 + wave]))
    command = [sys.executable, str(ROOT / "examples" / "servo_replay.py"), str(file), "--speed", "0.8"]
    command += ["--machine", server.name, "--connect", server.endpoint]
    done = subprocess.run(command, capture_output=True, text=True, env=environment(), timeout=60, check=True)
    for line in done.stdout.splitlines()[-2:]:
        at, target = (float(word.strip(",")) for word in line.split() if "." in word)
        assert at == pytest.approx(target, abs=0.01)
