"""Status calls beside a crowd: subscribers of every cycle and of events, and clients that stream programs."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from tests.bench.figures import Figure, percentile
from tests.bench.round_trip import RAW_KEY, latencies, raw_session
from tests.bench.server import Server, server

SUBSCRIBERS, STREAMS = 50, 10
CALLS = 1000


def measure() -> list[Figure]:
    """Time of `status` alone and in the crowd, beside raw gets at the same moment.

    The crowd computes on the same cores: a raw get has nothing of the server in it but that load.
    """
    with raw_session() as raw, server() as reached:
        key = f"mc/@v1/{reached.machine}/@rpc/bench/status"
        alone = latencies(reached.session, key, [b""] * CALLS)
        with crowd(reached, SUBSCRIBERS, STREAMS):
            status: list[float] = []
            floor: list[float] = []
            for _ in range(5):
                status += latencies(reached.session, key, [b""] * (CALLS // 5))
                floor += latencies(raw, RAW_KEY, [b""] * (CALLS // 5))
    what = f"status beside {SUBSCRIBERS} subscribers and {STREAMS} streams"
    return [
        Figure(f"{what} {name}", percentile(status, share), "µs", percentile(floor, share), "a raw get", goal)
        for name, share, goal in (("p50", 0.5, ""), ("p99", 0.99, "≤ 20 000 µs"))
    ] + [Figure("status alone p50", percentile(alone, 0.5), "µs")]


@contextmanager
def crowd(reached: Server, subscribers: int, streams: int) -> Iterator[None]:
    """Subscribers and streams in processes of their own, until the block ends."""
    commands = [
        ["tests.bench.listeners", reached.endpoint, reached.machine, str(subscribers), "--events"],
        ["tests.bench.streams", reached.endpoint, reached.machine, str(streams)],
    ]
    processes = [
        subprocess.Popen(
            [sys.executable, "-m", *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        for command in commands
    ]
    try:
        for process in processes:
            assert process.stdout is not None
            process.stdout.readline()
        yield
    finally:
        for process in processes:
            process.communicate(timeout=30)
