"""A long text is handed over by parts, checked by its hash, and simulated while programs run it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from mcserver.errors import Diagnostic
from mcserver.planning.line_marks import LineMarks
from mcserver.planning.start_state import StartState
from mcserver.service.arming import hash_of
from mcserver.simulation.foresight import Foreseen, Listener, check_file
from mcserver.simulation.program_checker import ProgramChecker
from tests.net.client import ErrorAnswer, WireClient

TEXT = "G1010\n" + "G01 X1 F600\nX0\n" * 50
SHA = hash_of(TEXT)
LINES = 101


class Foreseeing:
    """What was asked of the checker, in place of its processes."""

    def __init__(self) -> None:
        self.begun: list[tuple[Path, Listener, bool]] = []


@pytest.fixture
def foreseeing(monkeypatch: pytest.MonkeyPatch) -> Foreseeing:
    made = Foreseeing()

    def foresee(
        _: object, _sha256: str, path: Path, listener: Listener, *_rest: object, checked: bool
    ) -> None:
        made.begun.append((path, listener, checked))

    async def check(
        checker: ProgramChecker,
        _client: str,
        text: Path,
        start: StartState,
    ) -> list[Diagnostic]:
        return check_file(str(text), checker._machine, start)

    monkeypatch.setattr(ProgramChecker, "foresee", foresee)
    monkeypatch.setattr(ProgramChecker, "check", check)
    return made


async def hand_over(client: WireClient, text: str = TEXT) -> dict[str, Any]:
    raw, reply = text.encode(), {"received": 0}
    while reply["received"] < len(raw):
        at = reply["received"]
        reply = await client.call(
            "put_text", sha256=hash_of(text), size=len(raw), offset=at, part=raw[at : at + 500]
        )
    return reply


async def test_a_text_is_checked_by_its_hash(client: WireClient, foreseeing: Foreseeing) -> None:
    with pytest.raises(ErrorAnswer, match="MC590: "):
        await client.call("check", sha256=SHA)
    assert await hand_over(client) == {"received": len(TEXT), "lines": LINES, "complete": True}
    assert (await client.call("check", sha256=SHA))["ok"]
    faulty = TEXT + "G01 Q1\n"
    await hand_over(client, faulty)
    found = await client.call("check", sha256=hash_of(faulty))
    assert [each["line"] for each in found["diagnostics"]] == [LINES + 1]
    with pytest.raises(ErrorAnswer, match="MC511: "):
        await client.call("check", sha256=SHA, text=TEXT)
    # no program runs it: nobody asks how long it takes
    assert foreseeing.begun == []


@pytest.mark.parametrize("opened_first", [True, False])
async def test_a_program_of_the_text_learns_its_time_from_the_simulation(
    client: WireClient, foreseeing: Foreseeing, opened_first: bool
) -> None:
    if not opened_first:
        await hand_over(client)
        await client.call("check", sha256=SHA)
    program = (await client.call("open", sha256=SHA))["program"]
    if opened_first:
        await hand_over(client)
    ((path, listener, checked),) = foreseeing.begun
    assert path.read_text() == TEXT
    assert checked is not opened_first
    half = LineMarks([0, 50], [0.0, 10.0], 10.0, 50, complete=False)
    assert listener(Foreseen(marks=half))
    status = (await client.call("programs", program=program))["programs"][0]
    assert status["duration_s"] == pytest.approx(10.0 * LINES / 50)
    assert status["simulated"] == pytest.approx(50 / LINES)
    assert listener(Foreseen(marks=LineMarks([0, LINES], [0.0, 21.0], 21.0, LINES)))
    status = (await client.call("programs", program=program))["programs"][0]
    assert (status["duration_s"], status.get("simulated", 1.0)) == (21.0, 1.0)


async def test_a_fault_that_is_found_ahead_is_told_while_the_program_runs(
    client: WireClient, foreseeing: Foreseeing
) -> None:
    program = (await client.call("open", sha256=SHA))["program"]
    await hand_over(client)
    ((_, listener, _),) = foreseeing.begun
    assert listener(Foreseen(fault=Diagnostic(code="MC104", message="the chord is too long", line=90)))
    status = (await client.call("programs", program=program))["programs"][0]
    assert status["notice"] == "line 90 will be refused: the chord is too long"
    await client.call("abort", program=program)
    async with asyncio.timeout(60.0):
        while (await client.call("programs", program=program))["programs"][0].get("ended_at") is None:
            await asyncio.sleep(0.01)
    assert not listener(Foreseen(marks=LineMarks([0, 1], [0.0, 1.0], 1.0, 1, complete=False)))
