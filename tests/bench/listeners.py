"""Many sessions that hear every cycle of a machine, until the input closes; prints how many messages came."""

from __future__ import annotations

import itertools
import sys

import zenoh

from tests.bench.server import client_config


def main(endpoint: str, machine: str, count: int) -> None:
    """Listen and count."""
    arrived = itertools.count()
    handler = zenoh.handlers.Callback(lambda _: next(arrived), indirect=False)
    sessions = [zenoh.open(client_config(endpoint)) for _ in range(count)]
    for session in sessions:
        session.declare_subscriber(f"mc/@v1/{machine}/tele/batch", handler)
        if "--events" in sys.argv:
            session.declare_subscriber(f"mc/@v1/{machine}/event", handler)
    print("ready", flush=True)
    sys.stdin.read()
    print(next(arrived), flush=True)
    for session in sessions:
        session.close()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
