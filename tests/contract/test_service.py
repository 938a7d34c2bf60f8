"""The service answers the contract's messages as the contract says: the script keeps no books of its own."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from mcserver.errors import Refused
from mcserver.service.program_options import ProgramOptions
from tests.contract.vectors import read
from tests.service.conftest import Bench, bench

__all__ = ["bench"]

CLIENT = "contract-1"
# what needs neither a planner's verdict nor less credit than the service gives
PLAIN = ["numbering", "chunks", "message-lost", "lost-in-part", "gap", "start-line", "old-acknowledgement"]


async def submit(bench: Bench, program: str, message: dict[str, Any]) -> dict[str, Any]:
    """The numbers of the reply, or the code and the numbers of the refusal."""
    try:
        taken = bench.service.lines.submit(CLIENT, program, message["first"], message["lines"], judge=False)
    except Refused as refused:
        return {
            "code": refused.code,
            "accepted": refused.details["accepted"],
            "expected": refused.details["expected"],
        }
    async with asyncio.timeout(10.0):
        return {"accepted": (await taken).journaled}


@pytest.mark.parametrize("name", PLAIN)
async def test_the_service_answers_as_the_sequence_says(bench: Bench, name: str) -> None:
    steps = read(f"sequences/{name}.json")["steps"]
    start = steps[0]["open"]["value"]["expected"]
    program = await bench.service.open(
        CLIENT, ProgramOptions(start_line=start, before=["G90"] * (start - 1) if start > 1 else ())
    )
    assert program.queue.expected == start
    under_way: list[dict[str, Any]] = []
    for step in steps:
        ((what, value),) = step.items()
        if what == "sends":
            under_way.append(value)
        elif what == "lost":
            under_way.pop()
        elif what == "answer":
            answer = await submit(bench, program.program, under_way.pop(0))
            if "refused" in value:
                wanted = value["refused"]["value"]
                numbers = {key: wanted["details"][key] for key in ("accepted", "expected")}
                assert answer == {"code": wanted["code"], **numbers}
            else:
                assert answer == {"accepted": value["reply"]["value"]["accepted"]}
    assert program.journaled == next(s["knows"] for s in reversed(steps) if "knows" in s)["accepted"]
