"""The floor of a remote call: a process that answers one Zenoh key, until its input closes."""

from __future__ import annotations

import sys

import zenoh

from tests.zenoh_sessions import opened


def main(endpoint: str) -> None:
    """Listen and answer."""
    session = opened({"listen/endpoints": [endpoint]})
    answer = zenoh.handlers.Callback(lambda query: query.reply(query.key_expr, b"answer"), indirect=False)
    session.declare_queryable("bench/raw", answer, complete=True)
    print("ready", flush=True)
    sys.stdin.read()
    session.close()


if __name__ == "__main__":
    main(sys.argv[1])
