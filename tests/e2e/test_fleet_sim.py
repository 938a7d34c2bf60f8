"""A fleet of light machines as a client meets it: found, looked at, and a program run on one of them."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from mcclient.fleet import FleetLink
from mcclient.machine import Machine

from tests.bench.server import companion, free_port

MACHINES = 30


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    where = f"tcp/127.0.0.1:{free_port()}"
    command = [sys.executable, "-m", "mcserver", "fleet-sim", "-n", str(MACHINES)]
    with (
        companion("tests.bench.plain_router", where),
        subprocess.Popen(
            [*command, "--connect", where, "--line-s", "0.01"], stderr=subprocess.PIPE, text=True
        ) as fleet,
    ):
        assert fleet.stderr is not None
        assert "30 light machines sim-00001" in fleet.stderr.readline()
        yield where
        fleet.send_signal(signal.SIGTERM)
        fleet.communicate(timeout=30)
        assert fleet.returncode == 0


async def test_every_machine_is_found_and_answers(endpoint: str) -> None:
    fleet = await FleetLink.open(endpoint)
    assert len(await fleet.find(timeout_s=5.0)) == MACHINES
    states = await fleet.states(timeout_s=5.0)
    assert {state.state for state in states.values()} == {"ready"}
    assert sorted(states) == [f"sim-{number:05d}" for number in range(1, MACHINES + 1)]
    await fleet.close()


async def test_a_program_runs_to_its_end_by_the_sdk(endpoint: str) -> None:
    async with Machine.connect("sim-00017", endpoint) as machine, machine.program(name="demo") as program:
        await program.send_lines(["G01 X1"] * 500)
        result = await program.finish()
    assert (result.state, result.accepted, result.done) == ("finished", 500, 500)
