"""A caller that asks for large replies and stops reading holds up nobody else's calls."""

from __future__ import annotations

import asyncio
import signal
import subprocess
import sys

from tests.net.client import WireClient
from tests.net.conftest import Rig

# Asks, says so, and reads no more: the process stops itself as a whole, its network threads too.
GREEDY = """
import json, os, signal, sys
import zenoh
config = zenoh.Config()
for key, value in {"mode": "client", "connect/endpoints": [sys.argv[1]],
                   "scouting/multicast/enabled": False}.items():
    config.insert_json5(key, json.dumps(value))
session = zenoh.open(config)
handler = zenoh.handlers.Callback(lambda reply: None, indirect=False)
for _ in range(400):
    session.get("mc/@v1/bench/@rpc/greedy/events", handler, congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.INTERACTIVE_HIGH, express=True, timeout=60.0)
print("asked", flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
"""
LIMIT_S = 20.0


async def test_who_stops_reading_large_replies_costs_nobody_else_a_call(rig: Rig, client: WireClient) -> None:
    for number in range(1000):
        rig.service.events.publish("warning", message=f"{number} " + 200 * "x")
    greedy = await asyncio.to_thread(
        subprocess.Popen,
        [sys.executable, "-c", GREEDY, rig.endpoint],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert greedy.stdout is not None
        assert await asyncio.wait_for(asyncio.to_thread(greedy.stdout.readline), LIMIT_S) == "asked\n"
        async with asyncio.timeout(LIMIT_S):
            for _ in range(200):
                assert (await client.call("status"))["state"] == "ready"
    finally:
        greedy.send_signal(signal.SIGCONT)
        greedy.kill()
        await asyncio.to_thread(greedy.wait, LIMIT_S)
        if greedy.stdout is not None:
            greedy.stdout.close()
