"""The floor of a remote call: a process that answers one Zenoh key, until its input closes."""

from __future__ import annotations

import sys

import zenoh


def main(endpoint: str) -> None:
    """Listen and answer."""
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", f'["{endpoint}"]')
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    answer = zenoh.handlers.Callback(lambda query: query.reply(query.key_expr, b"answer"), indirect=False)
    session.declare_queryable("bench/raw", answer, complete=True)
    print("ready", flush=True)
    sys.stdin.read()
    session.close()


if __name__ == "__main__":
    main(sys.argv[1])
