"""Looks at a fleet as `mcctl fleet` does, then listens to its states; prints what it took as JSON."""

from __future__ import annotations

import asyncio
import itertools
import json
import resource
import sys
import time
from pathlib import Path

import zenoh
from mcclient.fleet import FleetLink

from tests.bench.server import client_config

ROUNDS = 5
LISTEN_S = 5.0


def received() -> int:
    """Bytes that the loopback has carried."""
    for line in Path("/proc/net/dev").read_text("ascii").splitlines():
        name, _, fields = line.strip().partition(":")
        if name == "lo":
            return int(fields.split()[0])
    return 0


async def look(endpoint: str, machines: int) -> dict[str, float]:
    fleet = await FleetLink.open(endpoint, timeout_s=30.0)
    start = time.perf_counter()
    names: list[str] = []
    while len(names) < machines and time.perf_counter() - start < 60.0:
        names = await fleet.find(timeout_s=10.0)
    discovery = time.perf_counter() - start
    taken, answered = [], []
    before = received()
    for _ in range(ROUNDS):
        start = time.perf_counter()
        answered.append(len(await fleet.states(timeout_s=10.0)))
        taken.append(time.perf_counter() - start)
    carried = (received() - before) / ROUNDS
    await fleet.close()
    return {
        "found": len(names),
        "discovery_s": discovery,
        "answered": min(answered),
        "states_s": sorted(taken)[ROUNDS // 2],
        "states_bytes": carried,
    }


def listen(endpoint: str) -> dict[str, float]:
    arrived = itertools.count()
    with zenoh.open(client_config(endpoint)) as session:
        handler = zenoh.handlers.Callback(lambda _: next(arrived), indirect=False)
        session.declare_subscriber("mc/@v1/*/tele/state", handler)
        time.sleep(2.0)
        print("listening", flush=True)
        before, count = received(), next(arrived)
        used, start = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
        time.sleep(LISTEN_S)
        seconds = time.perf_counter() - start
        after = resource.getrusage(resource.RUSAGE_SELF)
        return {
            "states_a_second": (next(arrived) - count - 1) / seconds,
            "listen_bytes_a_second": (received() - before) / seconds,
            "viewer_cpu": 100.0 * (after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime) / seconds,
            "viewer_mib": after.ru_maxrss / 1024.0,
        }


if __name__ == "__main__":
    print(json.dumps(asyncio.run(look(sys.argv[1], int(sys.argv[2]))) | listen(sys.argv[1])), flush=True)
