"""From submitting a line to its acknowledgement, beside a Zenoh get that does nothing.

A bare Zenoh client sends the very bytes of a call and looks at none of the reply's: beside a raw get of the
same client that is the server's share. The SDK's calls are what a program waits for.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import msgspec
import zenoh

from tests.bench.figures import Figure, NotAvailable, percentile
from tests.bench.sdk_calls import WARMING, SdkCalls, sdk_calls
from tests.bench.server import Server, client_config, companion, free_port, server

CALLS = 200
ROUNDS = 5
# of calls that are not made back to back: what the one before has started is over by then
PAUSE_S = 0.005
PAUSED_CALLS = 80
RAW_KEY = "bench/raw"
# for a program that was aborted to end
SETTLING_S = 10.0


class Taken(NamedTuple):
    """What calls of one kind took: each of them [µs], and the answering process for all of them [µs].

    Attributes:
        calls: how many there were, those included that are not in ``times``.
    """

    times: list[float]
    processor: float
    calls: int

    @property
    def per_call(self) -> float:
        """Processor time a call [µs]."""
        return self.processor / self.calls


def measure() -> list[Figure]:
    """Raw gets, status calls and submitted lines in turn, each in the same way from the same kind of session.

    One call behind the other measures what the machine carries out for each of them too, on the other core;
    calls with a pause between them measure how soon it answers.
    """
    with raw_process() as (raw, answering), server() as reached, sdk_calls(reached) as sdk:
        back_to_back = _figures(raw, answering, reached, sdk, CALLS, 0.0, "")
        paused = _figures(raw, answering, reached, sdk, PAUSED_CALLS, PAUSE_S, ", 5 ms between calls")
    return [*back_to_back, *paused]


def _figures(
    raw: zenoh.Session,
    answering: int,
    reached: Server,
    sdk: SdkCalls,
    calls: int,
    pause_s: float,
    how: str,
) -> list[Figure]:
    """Measure in turn, so that whatever else the computer does meets all alike."""
    key = f"mc/@v1/{reached.machine}/@rpc/bench/status"
    serving = reached.process.pid
    kinds: dict[str, Callable[[int], Taken]] = {
        "raw": lambda _: timed(answering, lambda: latencies(raw, RAW_KEY, [b""] * calls, pause_s), calls),
        "status": lambda _: timed(
            serving, lambda: latencies(reached.session, key, status_requests(calls), pause_s), calls
        ),
        "acknowledgement": lambda turn: submitted(reached, turn, calls, pause_s, judge=False),
        "verdict": lambda turn: submitted(reached, turn, calls, pause_s, judge=True),
        "sdk status": lambda _: timed(serving, lambda: sdk.status(calls, pause_s), calls),
        "sdk acknowledgement": lambda _: timed(serving, lambda: sdk.acknowledged(calls, pause_s), calls),
        "sdk verdict": lambda _: timed(serving, lambda: sdk.judged(calls, pause_s), calls),
    }
    found: dict[str, list[Taken]] = {kind: [] for kind in kinds}
    for turn in range(ROUNDS):
        for kind, call in kinds.items():
            found[kind].append(call(turn))
    taken = {kind: _together(parts) for kind, parts in found.items()}
    raw_taken, status, acknowledged = taken["raw"], taken["status"], taken["acknowledgement"]
    figures = []
    for share in (0.5, 0.99):
        name, floor = f"p{100 * share:g}", percentile(raw_taken.times, share)
        goal, sdk_goal = ("≤ 3", "≤ 3") if share == 0.5 else ("", "")
        by_bare_client = "a raw get of a bare client"
        rows = (
            ("status", "status", "a raw get at the same time", goal),
            ("acknowledgement", "submit → acknowledgement", "a raw get; the journal is in it", goal),
            ("verdict", "submit → verdict", "a raw get; journal and planner's process are in it", ""),
            ("sdk status", "SDK: status", by_bare_client, sdk_goal),
            (
                "sdk acknowledgement",
                "SDK: line streamed → acknowledged",
                by_bare_client,
                sdk_goal,
            ),
            ("sdk verdict", "SDK: line sent → verdict", by_bare_client, ""),
        )
        figures += [
            Figure(f"{what} {name}{how}", percentile(taken[kind].times, share), "µs", floor, against, aim)
            for kind, what, against, aim in rows
        ]
    return figures + [
        Figure(
            f"processor time of the server a {what}{how}",
            each.per_call,
            "µs",
            raw_taken.per_call,
            "that of the process that answers a raw get",
        )
        for what, each in (("status", status), ("submit → acknowledgement", acknowledged))
    ]


def status_requests(calls: int) -> list[bytes]:
    """The requests of so many status calls, as the SDK writes them."""
    return [msgspec.msgpack.encode({"request": 1 + n}) for n in range(calls)]


def _together(parts: Sequence[Taken]) -> Taken:
    return Taken(
        [each for part in parts for each in part.times],
        sum(part.processor for part in parts),
        sum(part.calls for part in parts),
    )


def timed(pid: int, call: Callable[[], list[float]], calls: int) -> Taken:
    """Make calls, and take the processor time of the process that answers them."""
    before = processor_us(pid)
    times = call()
    return Taken(times, processor_us(pid) - before, calls)


def processor_us(pid: int) -> float:
    """Processor time of a process so far, its children not counted [µs].

    Raises:
        NotAvailable: the system does not tell (Linux does).
    """
    try:
        threads = [path.read_text().split() for path in Path(f"/proc/{pid}/task").glob("*/schedstat")]
    except OSError as error:
        raise NotAvailable(f"processor time of a process: {error}") from error
    return sum(int(numbers[0]) for numbers in threads) / 1000.0


def submitted(reached: Server, turn: int, calls: int, pause_s: float, *, judge: bool) -> Taken:
    """One line a call, each with a number of its own, into a program that ends with it."""
    client = f"{'judged' if judge else 'acknowledged'}-{turn}-{pause_s * 1000:g}"
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
    taken = timed(reached.process.pid, lambda: latencies(reached.session, key, requests, pause_s), calls)
    reached.ask(f"@rpc/{client}/abort", request=calls + 2, program=opened["program"])
    until = time.monotonic() + SETTLING_S
    while reached.ask("@rpc/bench/status")["programs"][-1]["state"] != "aborted" and time.monotonic() < until:
        # the next one waits for its axes, and what the machine does is its own
        time.sleep(0.01)
    return taken


@contextmanager
def raw_session() -> Iterator[zenoh.Session]:
    """A session to a process that does nothing but answer `RAW_KEY`."""
    with raw_process() as (session, _):
        yield session


@contextmanager
def raw_process() -> Iterator[tuple[zenoh.Session, int]]:
    """A session to a process that does nothing but answer `RAW_KEY`, and the process's number."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with (
        companion("tests.bench.raw_queryable", endpoint) as process,
        zenoh.open(client_config(endpoint)) as session,
    ):
        yield session, process.pid


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
    return taken[WARMING:]
