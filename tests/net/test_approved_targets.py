"""Attacks on an approval of streamed targets: whatever is sent stays inside of what was looked at."""

from __future__ import annotations

import asyncio
import math
from pathlib import Path

import numpy as np
import pytest

from mcserver.errors import ServiceError
from mcserver.machine.machine_file import load_machine
from mcserver.net import arming_messages as wire
from mcserver.net.servo_messages import ServoRequest
from mcserver.service.program import Program
from mcserver.service.servo import put_targets
from mcserver.service.target_stream import TargetMessage
from tests.net.approval_site import ANNA, BOT, TEXT, Site

PERIOD_S = 0.01


async def approved(site: Site, text: str = TEXT, override: float = 100.0, *, servo: bool = True) -> str:
    """Let a person look at a run and approve what stays inside of it, for targets too."""
    run = await site.ask(text)
    asked = wire.ArmRequest(sha256=run.sha256, override=override, standing_s=600.0, servo=servo)
    site.arming.arm(ANNA, asked)
    return run.sha256


async def opened(site: Site, client: str = BOT, **request: object) -> Program:
    reply = await site.arming.servo_armed(client, ServoRequest(**request))  # type: ignore[arg-type]
    return site.cell.service.program(reply.program)


async def stream(
    site: Site, program: Program, seconds: float, *rows: list[float], by_velocity: bool = False
) -> None:
    """Send one row after the other, over and over, every 10 ms."""
    service = site.cell.service
    begun, seq = service.port.snapshot().time, 0
    while (now := service.port.snapshot().time) < begun + seconds and not program.over:
        if seq != 1 + int(now / PERIOD_S):
            seq = 1 + int(now / PERIOD_S)
            row = np.array([rows[seq % len(rows)]])
            given = (None, row) if by_velocity else (row, None)
            put_targets(service, program, TargetMessage(seq, now, 1.0, *given, None))
        await asyncio.sleep(0)


async def refused(site: Site, client: str = BOT, **request: object) -> str:
    with pytest.raises(ServiceError) as refusal:
        await opened(site, client, **request)
    return refusal.value.code


async def test_targets_lead_no_axis_further_faster_or_longer_than_the_run_that_was_looked_at(
    site: Site,
) -> None:
    await approved(site)
    program = await opened(site)
    site.cell.service.set_override(2.0, program.program)
    assert program.override == 1.0
    await stream(site, program, 0.7, [0.3])
    await stream(site, program, 0.7, [-9.0], by_velocity=True)
    await stream(site, program, 9.0, [0.2], [0.2], [-0.2], [-0.2])
    await site.cell.ended(program)
    assert program.fault is not None
    assert program.fault.code == "MC463"
    assert site.extent() == pytest.approx((0.0, 50.0), abs=1e-6)
    speed = np.abs(np.diff(np.array(site.rows)[:, 0])).max() / site.machine.cycle_s
    assert speed == pytest.approx(0.1, rel=0.11)


async def test_without_an_approval_of_targets_for_this_client_and_these_axes_nothing_is_energized(
    site: Site,
) -> None:
    assert await refused(site) == "MC608"
    named = await approved(site, servo=False)
    assert await refused(site) == "MC608"
    site.arming.withdraw(BOT, wire.WithdrawRequest(sha256=named))
    named = await approved(site)
    assert await refused(site, "bot.agent-2") == "MC608"
    assert await refused(site, axes=[0, 1]) == "MC608"
    assert await refused(site, axes=[]) == "MC507"
    assert await refused(site, low={"0": 60.0}, high={"0": 90.0}) == "MC327"
    site.arming.reject(ANNA, wire.RejectRequest(sha256=named))
    assert await refused(site) == "MC608"
    await approved(site)
    site.cell.service.latch.emergency_stop(ANNA, "")
    assert await refused(site) == "MC608"
    assert not [each for each in site.cell.service.current() if not each.ended]


async def test_an_axis_that_stands_outside_is_not_led(site: Site) -> None:
    await approved(site)
    await site.by_hand("G0 X200")
    program = await opened(site)
    await stream(site, program, 0.5, [0.02])
    await site.cell.ended(program)
    assert program.fault is not None
    assert (program.fault.code, site.cell.position(0)) == ("MC460", pytest.approx(0.2))


async def test_a_tip_that_leaves_its_box_stops_the_stream(tmp_path: Path) -> None:
    arm = Site(load_machine("arm6"), tmp_path)
    # one joint after the other: the tip is in no place where both are far
    await approved(arm, "G1010\nG91\nG94 F6000\nG01 [1]10\nG01 [1]-10\nG01 [2]10\nG01 [2]-10")
    program = await opened(arm)
    far = [math.radians(10.0) + arm.machine.axes[axis].initial_position for axis in (1, 2)]
    await stream(arm, program, 6.0, far)
    await arm.cell.ended(program)
    assert program.fault is not None
    assert program.fault.code == "MC462"
    await arm.cell.stop()


async def test_lines_behind_those_that_were_armed_are_not_taken(site: Site) -> None:
    await site.arm()
    starting = asyncio.ensure_future(site.start())
    while not (programs := site.cell.service.current()):
        await asyncio.sleep(0)
    site.cell.service.lines.stream(programs[0].program, len(TEXT.split("\n")) + 1, ["G1 X40 F6000"])
    program = await site.cell.ended(await starting)
    assert program.queue.accepted == len(TEXT.split("\n"))
