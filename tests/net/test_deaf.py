"""A session that a stranger's malformed declaration has made deaf is opened anew, and motion is held."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

import msgspec
import pytest
import zenoh

from tests.net.client import WireClient
from tests.net.conftest import Rig
from tests.net.deafening import deafen

LIMIT_S = 60.0


async def answered(rig: Rig, method: str, **fields: object) -> Any:
    """An answer to a client that comes now, again and again until there is one."""
    async with asyncio.timeout(LIMIT_S):
        while True:
            try:
                client = WireClient(rig.endpoint, "bench")
            except zenoh.ZError:
                # the port is between two sessions
                await asyncio.sleep(0.05)
                continue
            try:
                # no answer, or that the time is over in words of Zenoh
                with contextlib.suppress(AssertionError, TimeoutError, msgspec.DecodeError):
                    return await client.call(method, **fields)
            finally:
                await client.close()


@pytest.mark.timeout(3 * LIMIT_S)
async def test_a_deaf_server_holds_its_programs_and_answers_again(rig: Rig) -> None:
    program = await rig.service.open("tester", axes=[0], on_disconnect="finish")
    rig.service.lines.stream(program.program, 1, ["G01 X1 F100"])
    await asyncio.to_thread(deafen, rig.endpoint, "bench")
    (warning,) = [
        event
        for event in (await answered(rig, "events", since=0))["events"]
        if event["kind"] == "warning" and event["reason"] == "MC525"
    ]
    assert program.program in warning["message"]
    (told,) = (await answered(rig, "programs", program=program.program))["programs"]
    assert told["state"] == "held"
    await answered(rig, "resume", program=program.program)
    assert program.state == "running"
