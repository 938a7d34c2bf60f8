"""A caller that stops reading its replies holds up nobody else's calls, as long as it may last."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from mcserver.net import configuration
from mcserver.net.replies import ReplySender
from tests.net.client import WireClient
from tests.net.conftest import Rig, running_rig

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


def in_a_lane(replies: ReplySender) -> object:
    """The reply to the greedy caller that a sender's thread is stuck with; None: none."""
    lane = replies._lanes.get("greedy")
    return lane.replies[0] if lane is not None and lane.replies else None


async def stuck(find: Callable[[], object]) -> object:
    """What stays stuck over a hundred looks."""
    before, same = find(), 0
    async with asyncio.timeout(LIMIT_S):
        while before is None or same < 100:
            await asyncio.sleep(0.01)
            now = find()
            same = same + 1 if now is before else 0
            before = now
    return before


@pytest.mark.parametrize(
    ("method", "count"),
    [("events", 200), ("status", 60_000)],
    ids=["large replies", "small replies"],
)
async def test_who_stops_reading_costs_nobody_else_a_call(patient_rig: Rig, method: str, count: int) -> None:
    rig = patient_rig
    for number in range(1000):
        rig.service.events.publish("warning", message=f"{number} " + 200 * "x")
    greedy = await asyncio.to_thread(
        subprocess.Popen,
        [sys.executable, "-c", GREEDY, rig.endpoint, method, str(count)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    honest = WireClient(rig.endpoint, "bench", "honest")
    try:
        before = await stuck(lambda: in_a_lane(rig.replies))
        async with asyncio.timeout(LIMIT_S):
            for _ in range(CALLS):
                assert (await honest.call("status"))["state"] == "ready"
        # all of them were answered while the greedy one's reply was stuck, not after it
        assert in_a_lane(rig.replies) is before
    finally:
        await honest.close()
        greedy.send_signal(signal.SIGKILL)
        await asyncio.to_thread(greedy.communicate)
