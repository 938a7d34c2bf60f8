"""A Zenoh router without TLS, for measurements on one computer, until the input closes."""

from __future__ import annotations

import json
import sys

import zenoh


def main(listen: str, connect: list[str]) -> None:
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "router",
        "listen/endpoints": [listen],
        "connect/endpoints": connect,
        "scouting/multicast/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config):
        print("ready", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
