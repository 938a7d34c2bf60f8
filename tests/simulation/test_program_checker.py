"""Checks and simulations in a process of their own."""

from __future__ import annotations

import asyncio
import pickle
from collections.abc import Iterator

import pytest

from mcserver.errors import (
    ConfigurationError,
    Diagnostic,
    McError,
    Refused,
    RejectedLines,
    RuntimeFault,
    ServiceError,
)
from mcserver.machine.machine_file import load_machine
from mcserver.simulation.assertions import Assertion
from mcserver.simulation.program_checker import CLIENT_REQUESTS, ProgramChecker
from tests.service.fakes import three_axes


@pytest.fixture(scope="module")
def worker() -> Iterator[ProgramChecker]:
    made = ProgramChecker(three_axes())
    yield made
    made.close()


@pytest.fixture(scope="module")
def hasty() -> Iterator[ProgramChecker]:
    """One in which a program has to make room for others soon, not after 20 s."""
    made = ProgramChecker(three_axes(), shared_limit_s=0.2)
    yield made
    made.close()


async def test_a_text_is_checked_and_simulated_beside_the_loop(worker: ProgramChecker) -> None:
    (fault,) = await worker.check("hmi", "G01 X10", None)
    assert (fault.line, fault.severity) == (1, "error")
    report = (await worker.simulate("hmi", "G1010\nG01 X10 F600\n"))[0]
    assert report["ok"] is True
    assert report["axes"]["0"]["position"] == pytest.approx(10.0)


async def test_more_than_a_few_of_one_client_are_refused_and_others_are_not(worker: ProgramChecker) -> None:
    tasks = [asyncio.ensure_future(worker.check("greedy", "G90", None)) for _ in range(CLIENT_REQUESTS)]
    await asyncio.wait({tasks[0]}, timeout=0.0)
    with pytest.raises(ServiceError, match="MC508: "):
        await worker.check("greedy", "G90", None)
    assert await worker.check("modest", "G90", None) == []
    assert await asyncio.gather(*tasks) == [[]] * len(tasks)


async def test_long_simulations_of_one_client_do_not_keep_another_one_waiting(hasty: ProgramChecker) -> None:
    forever = "G1010\n" + "G04 P100000\n" * 50
    greedy = [asyncio.ensure_future(hasty.simulate("greedy", forever)) for _ in range(CLIENT_REQUESTS)]
    await asyncio.wait({greedy[0]}, timeout=0.0)
    async with asyncio.timeout(60.0):
        assert await hasty.check("modest", "G90", None) == []
    for task in greedy:
        task.cancel()
    await asyncio.gather(*greedy, return_exceptions=True)


async def test_what_computes_long_is_ended_when_another_client_waits(hasty: ProgramChecker) -> None:
    forever = "G1010\n" + "G04 P100000\n" * 50
    long = [asyncio.ensure_future(hasty.simulate(client, forever)) for client in ("a", "b")]
    await asyncio.wait({long[0]}, timeout=0.0)
    async with asyncio.timeout(60.0):
        assert await hasty.check("modest", "G90", None) == []
        done, _ = await asyncio.wait(long, return_when=asyncio.FIRST_COMPLETED)
    with pytest.raises(ServiceError, match="while other clients waited") as refused:
        done.pop().result()
    assert refused.value.code == "MC523"
    for task in long:
        task.cancel()
    await asyncio.gather(*long, return_exceptions=True)


async def test_a_simulation_solves_the_tools_of_the_machine() -> None:
    arm = ProgramChecker(load_machine("arm6"))
    try:
        report = (await arm.simulate("hmi", "G1010\nG93 F60\nG01 T1 Z650\n"))[0]
    finally:
        arm.close()
    assert report["diagnostics"] == []
    assert report["lines"][0]["planning_s"] > 0.0


def test_every_error_comes_whole_out_of_a_worker() -> None:
    fault = Diagnostic("MC104", "the chord is longer", line=3)
    errors: list[McError] = [
        Refused("MC508", "many wait", "later", limit=4),
        RuntimeFault("MC401", "it lags", line=7, axis=2),
        RejectedLines([fault], first=3),
        ConfigurationError("MC301", "no such frame"),
    ]
    for error in errors:
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), vars(again), str(again)) == (type(error), vars(error), str(error))


async def test_a_refusal_of_the_worker_reaches_its_client(worker: ProgramChecker) -> None:
    with pytest.raises(Refused, match="MC331"):
        await worker.simulate("hmi", "G1010", assertions=[Assertion("end", "40", most=1.0)])
