"""Status calls beside a crowd: subscribers of every cycle and of events, and clients that stream programs."""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Iterator
from contextlib import contextmanager

import msgspec
import zenoh

from tests.bench.figures import Figure, NotAvailable, percentile, percentiles
from tests.bench.round_trip import RAW_KEY, latencies, raw_session
from tests.bench.server import Server, companion, server
from tests.machine_text import axes_text

SUBSCRIBERS, STREAMS = 50, 20
CALLS = 1000
STOPS = 60


def measure() -> list[Figure]:
    """Time of `status` alone and in the crowd, beside raw gets at the same moment.

    The crowd computes on the same cores: a raw get has nothing of the server in it but that load.
    """
    # each stream has an axis of its own
    axes = axes_text(range(STREAMS), velocity=1000.0, acceleration=10_000.0, drive="simulated")
    machine = f'[machine]\nname = "bench"\n{axes}'
    with raw_session() as raw, server(machine) as reached:
        key = f"mc/@v1/{reached.machine}/@rpc/bench/status"
        alone = latencies(reached.session, key, [b""] * CALLS)
        with crowd(reached, SUBSCRIBERS, STREAMS):
            status: list[float] = []
            floor: list[float] = []
            for _ in range(5):
                status += latencies(reached.session, key, [b""] * (CALLS // 5))
                floor += latencies(raw, RAW_KEY, [b""] * (CALLS // 5))
            # the first ends the streams' programs; their clients stay
            stops = stop_latencies(reached)
    what = f"status beside {SUBSCRIBERS} subscribers and {STREAMS} streams"
    return [
        *percentiles(what, status, floor, "a raw get", {0.99: "≤ 5000 µs"}),
        Figure("emergency stop, put → event there p50", percentile(stops, 0.5), "µs"),
        Figure("emergency stop, put → event there, worst", max(stops), "µs", None, "", "p99 ≤ 5000 µs"),
        Figure("status alone p50", percentile(alone, 0.5), "µs"),
    ]


def stop_latencies(reached: Server) -> list[float]:
    """From putting an emergency stop to its event, one after another with a reset between [µs]."""
    events: queue.SimpleQueue[str] = queue.SimpleQueue()

    def on_event(sample: zenoh.Sample) -> None:
        events.put(msgspec.msgpack.decode(sample.payload.to_bytes())["kind"])

    root = f"mc/@v1/{reached.machine}"
    subscriber = reached.session.declare_subscriber(
        f"{root}/event", zenoh.handlers.Callback(on_event, indirect=False)
    )
    reached.ask("@rpc/bench/status")
    taken = []
    for number in range(STOPS):
        start = time.perf_counter()
        reached.session.put(
            f"{root}/estop",
            b"",
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )
        while events.get(timeout=10.0) != "estop":
            pass
        taken.append(1e6 * (time.perf_counter() - start))
        until = time.monotonic() + 10.0
        while reached.ask("@rpc/bench/status")["state"] != "ready" and time.monotonic() < until:
            with contextlib.suppress(NotAvailable):
                # refused as long as something still comes to rest
                reached.ask(
                    "@rpc/bench/reset", request=1_000_000 + 1000 * number + int(time.monotonic() * 10) % 1000
                )
        # the event that repeats it, and what else has come
        time.sleep(0.15)
        while not events.empty():
            events.get()
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    return taken


@contextmanager
def crowd(reached: Server, subscribers: int, streams: int) -> Iterator[None]:
    """Subscribers and streams in processes of their own, until the block ends."""
    listeners = ("tests.bench.listeners", reached.endpoint, reached.machine, str(subscribers), "--events")
    streaming = ("tests.bench.streams", reached.endpoint, reached.machine, str(streams))
    with companion(*listeners), companion(*streaming):
        yield
