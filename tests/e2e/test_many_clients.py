"""Several clients on one machine: leases, and messages that come twice."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest
from mcclient import Machine, ProgramRejected

from tests.e2e.conftest import connected
from tests.e2e.observing import (
    LIMIT_S,
    ended_lines,
    known,
    listening,
    listening_events,
    run,
)
from tests.e2e.servers import ServerProcess
from tests.net.client import ErrorAnswer, WireClient


async def test_programs_on_disjoint_axes_run_side_by_side(machine: Machine, server: ServerProcess) -> None:
    async with connected(server) as other, asyncio.timeout(LIMIT_S):
        first = await machine.program(axes=[0, 1])
        second = await other.program(axes=[2, 3])
        first_reports, second_reports = await listening(machine, first), await listening(other, second)
        await first.send_lines(["G1010", "G00 X0 Y0", "G93 F60 G01 X100 Y50"])
        await second.send_lines(["G1010", "G00 Z0 A0", "G93 F60 G01 Z100 A90"])
        await asyncio.gather(first.finish(), second.finish())
        (one,) = [each for each in await ended_lines(first_reports) if each.line == 3]
        (two,) = [each for each in await ended_lines(second_reports) if each.line == 3]
        assert one.start_s < two.end_s
        assert two.start_s < one.end_s
        status = await machine.status()
        assert status.axes.position[:4] == pytest.approx((100.0, 50.0, 100.0, 90.0), abs=0.05)


async def test_a_program_on_leased_axes_waits_and_then_runs(machine: Machine, server: ServerProcess) -> None:
    async with connected(server) as other, asyncio.timeout(LIMIT_S):
        events = await listening_events(machine)
        first = await machine.program(axes=[0, 1])
        second = await other.program(axes=[1, 2])
        assert second.state == "queued"
        await second.send_lines(["G1010", "G93 F600 G01 Y10 Z10"])
        await first.send_lines(["G1010", "G93 F120 G01 X10 Y20"])
        assert (await known(machine, second.id)).state == "queued"
        await asyncio.gather(first.finish(), second.finish())
        # an end is said once it is in the journal, which the axes do not wait for: the lines themselves tell
        times: dict[str, list[tuple[float, float]]] = {first.id: [], second.id: []}
        ended: set[str] = set()
        while ended != {first.id, second.id}:
            said = await anext(events)
            if said.program in times and said.kind == "lines.ended":
                times[said.program] += [(report.start_s, report.end_s) for report in said.lines]
            elif said.program in times and said.kind == "program.ended":
                ended.add(said.program)
        assert max(end for _, end in times[first.id]) <= min(start for start, _ in times[second.id])
        status = await machine.status()
        assert status.axes.position[:3] == pytest.approx((10.0, 10.0, 10.0), abs=0.05)


async def test_a_line_outside_the_lease_is_refused_and_the_program_lives(machine: Machine) -> None:
    async with asyncio.timeout(LIMIT_S), machine.program(axes=[0, 1]) as program:
        await program.send("G1010")
        with pytest.raises(ProgramRejected) as refused:
            await program.send("G93 F600 G01 X5 Z7")
        assert refused.value.line == 2
        assert "Z" in refused.value.message or "2" in refused.value.message
        await program.send("G93 F600 G01 X5")
        await program.done()


async def test_every_request_twice_acts_once(wire: WireClient, machine: Machine) -> None:
    await run(machine, ["G1010", "G00 X0"])
    known_before = {each.program for each in await machine.programs(limit=1000)}
    events = wire.subscribe("event")
    numbers = iter(range(1000, 2000))

    async def twice(method: str, **fields: object) -> Any:
        number = next(numbers)
        first = await wire.call(method, request=number, **fields)
        assert await wire.call(method, request=number, **fields) == first
        return first

    program = (await twice("open", name="twice", axes=[0]))["program"]
    acks = wire.subscribe(f"ack/{program}")
    await twice("override", percent=150.0, program=program)
    await twice("hold", program=program)
    await twice("submit", program=program, first=1, lines=["G1010", "G91 G93 F600", "G01 X5", "G01 X5"])
    await twice("resume", program=program)
    await twice("close", program=program, last=4)
    await acks.first(lambda ack: ack["state"] == "finished")
    jog = (await twice("jog", axis=0, distance=3.0))["program"]
    await events.first(lambda each: each["kind"] == "program.ended" and each["program"] == jog)
    aborted = (await twice("open", axes=[0]))["program"]
    await twice("abort", program=aborted)
    await events.first(lambda each: each["kind"] == "program.ended" and each["program"] == aborted)
    stepped = (await twice("open", axes=[0], step=True))["program"]
    acks = wire.subscribe(f"ack/{stepped}")
    await twice("submit", program=stepped, first=1, lines=["G1010", "G91 G93 F600 G01 X2", "G01 X40"])
    await twice("step", program=stepped)
    await acks.first(lambda ack: ack["done"] == 1)
    await twice("step", program=stepped)
    await acks.first(lambda ack: ack["done"] == 2)
    await twice("abort", program=stepped)
    await events.first(lambda each: each["kind"] == "program.ended" and each["program"] == stepped)
    # 2 × 5 mm by lines, 3 mm by hand, 2 mm by steps, each once
    assert (await machine.status()).axes.setpoint[0] == pytest.approx(15.0, abs=0.01)
    opened = {each.program for each in await machine.programs(limit=1000)} - known_before
    assert opened == {program, jog, aborted, stepped}
    ended = [
        line["line"]
        for each in events.all
        if each.get("program") == program
        for line in each.get("lines", [])
    ]
    assert sorted(set(ended)) == sorted(ended)
    assert ended[-2:] == [3, 4]
    await twice("estop", reason="twice")
    await events.first(lambda each: each["kind"] == "estop")
    await reset_when_at_rest(wire, next(numbers))
    assert len({each["seq"] for each in events.all if each["kind"] == "estop"}) == 1
    assert (await machine.status()).state == "ready"


async def reset_when_at_rest(wire: WireClient, number: int) -> None:
    """Asked again, with another number, while motion comes to rest."""
    async with asyncio.timeout(LIMIT_S):
        while True:
            try:
                first = await wire.call("reset", request=number)
            except ErrorAnswer as error:
                if error.code != "MC509":
                    raise
                number += 1000
                continue
            assert await wire.call("reset", request=number) == first
            return


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
