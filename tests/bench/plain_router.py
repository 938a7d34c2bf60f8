"""A Zenoh router without TLS, for measurements on one computer, until the input closes."""

from __future__ import annotations

import sys

from tests.zenoh_sessions import opened


def main(listen: str, connect: list[str]) -> None:
    with opened({"mode": "router", "listen/endpoints": [listen], "connect/endpoints": connect}):
        print("ready", flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
