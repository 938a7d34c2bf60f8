"""A program of many lines on a real server: acknowledged and reported once, in order."""

from __future__ import annotations

import asyncio

import pytest
from mcclient import Machine

from tests.e2e.observing import (
    ended_lines,
    listening,
    run,
)


async def test_three_thousand_lines_are_acknowledged_and_reported_once_in_order(machine: Machine) -> None:
    await run(machine, ["G1010", "G00 X0 Y0"])

    def lines() -> list[str]:
        zigzag = [f"G01 X{0.1 * n:.1f} Y{0.05 * (n % 40 - 20) * (-1) ** (n // 40):.3f}" for n in range(2998)]
        return ["G1010", "G64 G94 F24000", *zigzag]

    async with asyncio.timeout(60.0), machine.program(axes=[0, 1]) as program:
        reports = await listening(machine, program)
        assert await program.send_lines(lines()) == 3000
        assert program.accepted_through == 3000
        result = await program.finish()
        ended = [each.line for each in await ended_lines(reports)]
    assert (result.accepted, result.done) == (3000, 3000)
    assert reports.missed == 0
    assert ended == sorted(set(ended))
    assert ended[-2998:] == list(range(3, 3001))
    status = await machine.status()
    assert status.axes.setpoint[0] == pytest.approx(299.7, abs=0.01)
