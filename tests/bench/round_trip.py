"""From submitting a line to its acknowledgement, beside a Zenoh get that does nothing."""

from __future__ import annotations

import queue
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import zenoh

from tests.bench.figures import Figure, percentile
from tests.bench.server import Server, client_config, free_port, server

CALLS = 1000
# of calls that are not made back to back: what the one before has started is over by then
PAUSE_S = 0.005
PAUSED_CALLS = 400
RAW_KEY = "bench/raw"


def measure() -> list[Figure]:
    """Raw gets, status calls and submitted lines, each in the same way from the same kind of session.

    One call behind the other measures what the machine carries out for each of them too, on the other core;
    calls with a pause between them measure how soon it answers.
    """
    return [*_measured(CALLS, 0.0, ""), *_measured(PAUSED_CALLS, PAUSE_S, ", 5 ms between calls")]


def _measured(calls: int, pause_s: float, how: str) -> list[Figure]:
    with raw_session() as session:
        raw = latencies(session, RAW_KEY, [b""] * calls, pause_s)
    with server() as reached:
        key = f"mc/@v1/{reached.machine}/@rpc/bench/status"
        status = latencies(reached.session, key, [b""] * calls, pause_s)
        acknowledged = submitted(reached, calls, pause_s, judge=False)
        judged = submitted(reached, calls, pause_s, judge=True)
    figures = []
    for share in (0.5, 0.99):
        name, floor = f"p{100 * share:g}", percentile(raw, share)
        figures += [
            Figure(f"status {name}{how}", percentile(status, share), "µs", floor, "a raw get"),
            Figure(
                f"submit → acknowledgement {name}{how}",
                percentile(acknowledged, share),
                "µs",
                floor,
                "a raw get; the journal's disk is in it",
                "≤ 1.5" if share == 0.5 else "",
            ),
            Figure(
                f"submit → verdict {name}{how}",
                percentile(judged, share),
                "µs",
                floor,
                "a raw get; the journal and the planner's process are in it",
            ),
        ]
    return figures


def submitted(reached: Server, calls: int, pause_s: float, *, judge: bool) -> list[float]:
    """One line a call, each with a number of its own, into a program that ends with it."""
    client = "judged" if judge else "acknowledged"
    opened = reached.ask(f"@rpc/{client}/open", request=1)
    requests = [
        msgspec.msgpack.encode(
            {
                "request": 1 + n,
                "program": opened["program"],
                "first": n,
                "lines": ["G04 P0"],
                "judge": judge,
            }
        )
        for n in range(1, calls + 1)
    ]
    key = f"mc/@v1/{reached.machine}/@rpc/{client}/submit"
    taken = latencies(reached.session, key, requests, pause_s)
    reached.ask(f"@rpc/{client}/abort", request=calls + 2, program=opened["program"])
    return taken


@contextmanager
def raw_session() -> Iterator[zenoh.Session]:
    """A session to a process that does nothing but answer `RAW_KEY`."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.bench.raw_queryable", endpoint],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stdout is not None
        process.stdout.readline()
        with zenoh.open(client_config(endpoint)) as session:
            yield session
    finally:
        process.communicate(timeout=20)


def latencies(session: zenoh.Session, key: str, payloads: list[bytes], pause_s: float = 0.0) -> list[float]:
    """Time of each call, one after another [µs], without the first ones.

    Args:
        pause_s: before each of them.
    """
    answers: queue.SimpleQueue[zenoh.Reply] = queue.SimpleQueue()
    handler = zenoh.handlers.Callback(answers.put, indirect=False)
    taken = []
    for payload in payloads:
        if pause_s:
            time.sleep(pause_s)
        start = time.perf_counter()
        session.get(
            key,
            handler,
            payload=payload,
            timeout=5.0,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
            consolidation=zenoh.ConsolidationMode.NONE,
        )
        answers.get(timeout=6.0)
        taken.append(1e6 * (time.perf_counter() - start))
    return taken[50:]
