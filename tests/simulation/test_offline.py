"""Checks and simulations in a process of their own."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import pytest

from mcserver.errors import ServiceError
from mcserver.machine.machine_file import load_machine
from mcserver.simulation.program_checker import WAITING, ProgramChecker
from tests.service.fakes import three_axes


@pytest.fixture
async def worker() -> AsyncIterator[ProgramChecker]:
    made = ProgramChecker(three_axes())
    yield made
    made.close()


async def test_a_text_is_checked_and_simulated_beside_the_loop(worker: ProgramChecker) -> None:
    (fault,) = await worker.check("G01 X10", None)
    assert (fault.line, fault.severity) == (1, "error")
    report = await worker.simulate("G1010\nG01 X10 F600\n")
    assert report["ok"] is True
    assert report["axes"]["0"]["position"] == pytest.approx(10.0)


async def test_more_than_a_few_that_wait_are_refused(worker: ProgramChecker) -> None:
    tasks = [asyncio.ensure_future(worker.check("G90", None)) for _ in range(WAITING + 1)]
    await asyncio.wait({tasks[0]}, timeout=0.0)
    with pytest.raises(ServiceError) as refused:
        await worker.check("G90", None)
    assert refused.value.code == "MC508"
    assert await asyncio.gather(*tasks) == [[]] * len(tasks)


async def test_a_simulation_solves_the_tools_of_the_machine() -> None:
    arm = ProgramChecker(load_machine("arm6"))
    try:
        report = await arm.simulate("G1010\nG93 F60\nG01 T1 Z650\n")
    finally:
        arm.close()
    assert report["diagnostics"] == []
    assert report["lines"][0]["planning_s"] > 0.0
