"""A caller that stops reading its replies holds up nobody else's calls, as long as it may last."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import AsyncIterator
from pathlib import Path

import msgspec
import pytest
import zenoh

from mcserver.net import configuration
from mcserver.net.configuration import SETTINGS
from tests.net.client import WireClient
from tests.net.conftest import Rig, running_rig
from tests.zenoh_sessions import locator_of, opened

# Stops its own network threads at once, so that no reply is ever read, then asks as long as anything fits.
GREEDY = """
import json, os, signal, sys, threading, time
import zenoh
config = zenoh.Config()
for key, value in {"mode": "client", "connect/endpoints": [sys.argv[1]], "scouting/multicast/enabled": False,
                   "transport/link/tx/lease": 120000}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
stuck = threading.Event()
# a callback that does not return: the thread that reads this link reads no more
handler = zenoh.handlers.Callback(lambda reply: stuck.wait(), indirect=False)
for number in range(int(sys.argv[3])):
    session.get(f"mc/@v1/bench/@rpc/greedy/{sys.argv[2]}", handler, timeout=120.0, express=True,
                congestion_control=zenoh.CongestionControl.BLOCK, priority=zenoh.Priority.INTERACTIVE_HIGH)
print("asked", flush=True)
sys.stdin.read()
os.kill(os.getpid(), signal.SIGKILL)
"""
# far more than any call takes: without a free core all is late, and only what is stuck stays away
LIMIT_S = 100.0
CALLS = 200

pytestmark = pytest.mark.timeout(3 * LIMIT_S)


@pytest.fixture
async def patient_rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Rig]:
    """A server that never closes the link of who takes no replies: what is stuck stays stuck."""
    key = "transport/link/tx/queue/congestion_control/block/wait_before_close"
    monkeypatch.setitem(configuration.SETTINGS, key, 120_000_000)
    async with running_rig(tmp_path) as rig:
        yield rig


@pytest.mark.parametrize(("method", "count"), [("events", 300), ("status", 20_000)], ids=["large", "small"])
@pytest.mark.parametrize("behind_a_router", [False, True], ids=["direct", "router"])
async def test_who_stops_reading_costs_nobody_else_a_call(
    patient_rig: Rig, method: str, count: int, behind_a_router: bool
) -> None:
    rig = patient_rig
    for number in range(1000):
        rig.service.events.publish("warning", message=f"{number} " + 200 * "x")
    router = await asyncio.to_thread(opened_router, rig.endpoint) if behind_a_router else None
    endpoint = rig.endpoint if router is None else locator_of(router)
    greedy = await asyncio.to_thread(
        subprocess.Popen,
        [sys.executable, "-c", GREEDY, endpoint, method, str(count)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    honest = WireClient(endpoint, "bench", "honest")
    try:
        assert greedy.stdout is not None
        # calls while it asks, and once all is stuck that can be
        asked = asyncio.ensure_future(asyncio.to_thread(greedy.stdout.readline))
        calls = lost = 0
        async with asyncio.timeout(LIMIT_S):
            while calls < CALLS or not asked.done():
                # far below the patience of links
                if await answered(honest):
                    calls += asked.done()
                else:
                    lost += 1
        # behind a router small replies share a queue with the flood's, where one may find no room
        assert lost <= (2 if router is not None and method == "status" else 0)
    finally:
        await honest.close()
        greedy.send_signal(signal.SIGKILL)
        await asyncio.to_thread(greedy.communicate)
        if router is not None:
            await asyncio.to_thread(router.close)


async def answered(client: WireClient) -> bool:
    """Whether a status call is answered within the client's limit."""
    try:
        return bool((await client.call("status"))["state"] == "ready")
    except (msgspec.DecodeError, TimeoutError):
        # Zenoh's own word for no answer
        return False


def opened_router(server: str) -> zenoh.Session:
    """A router with a site's quality of service for replies, as patient as the server."""
    shared = ("qos/", "transport/link/tx/queue")
    taken = {key: value for key, value in SETTINGS.items() if key.startswith(shared)}
    ends = {"listen/endpoints": ["tcp/127.0.0.1:0"], "connect/endpoints": [server]}
    return opened({**taken, **ends, "mode": "router", "adminspace/enabled": True})
