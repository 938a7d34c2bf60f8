"""A region's router: what its uplink lets through, by the file in deploy/ (docs/fleet.md)."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.bench.server import client_config, free_port
from tests.zenoh_sessions import opened

FILE = Path(__file__).parents[2] / "deploy/zenoh/region.json5"
LIMIT_S = 10.0


def router(listen: str, connect: list[str], downsampling: list[Any]) -> zenoh.Session:
    ends = {"listen/endpoints": [listen], "connect/endpoints": connect}
    return opened({"mode": "router", **ends, "downsampling": downsampling})


def written() -> list[Any]:
    """The file's rules; on the loopback every interface is the uplink."""
    rules: list[Any] = json.loads(zenoh.Config.from_file(FILE).get_json("downsampling"))
    for each in rules:
        each["interfaces"] = ["lo"]
    return rules


class Uplink:
    """Counts what a subscriber above gets of what is put below."""

    def __init__(self, above: zenoh.Session, below: zenoh.Session) -> None:
        self.arrived: Counter[str] = Counter()
        self._below = below
        above.declare_subscriber(
            "mc/@v1/**",
            zenoh.handlers.Callback(lambda each: self.arrived.update([str(each.key_expr)]), indirect=False),
        )

    def put(self, *keys: str) -> None:
        """Put each key, then wait for a message behind them."""
        for key in keys:
            self._below.put(f"mc/@v1/{key}", b"x")
        self.arrived["mc/@v1/end"] = 0
        until = time.monotonic() + LIMIT_S
        while not self.arrived["mc/@v1/end"]:
            assert time.monotonic() < until, "nothing arrives"
            self._below.put("mc/@v1/end", b"x")
            time.sleep(0.01)


def uplinks(rules: list[Any]) -> Iterator[Uplink]:
    above, below = (f"tcp/127.0.0.1:{free_port()}" for _ in range(2))
    with ExitStack() as stack:
        stack.enter_context(router(above, [], []))
        stack.enter_context(router(below, [above], rules))
        sessions = [stack.enter_context(zenoh.open(client_config(each))) for each in (above, below)]
        uplink = Uplink(*sessions)
        uplink.put()
        yield uplink


@pytest.fixture
def uplink() -> Iterator[Uplink]:
    yield from uplinks(written())


@pytest.fixture
def wide_uplink() -> Iterator[Uplink]:
    rules = written()
    # so seldom that the second of two never passes while the test runs
    rules[0]["rules"] = [{"key_expr": "mc/@v1/*/tele/state", "freq": 0.01}]
    yield from uplinks(rules)


def test_cycles_do_not_pass_and_states_and_acknowledgements_do(uplink: Uplink) -> None:
    uplink.put(
        "cell-1/tele/batch", "cell-1/tele/axis/3", "cell-1/tele/state", "cell-2/tele/state", "cell-1/ack/p-1"
    )
    assert {key.removeprefix("mc/@v1/") for key in uplink.arrived} == {
        "cell-1/tele/state",
        "cell-2/tele/state",
        "cell-1/ack/p-1",
        "end",
    }


def test_a_rule_with_a_wildcard_counts_all_machines_together(wide_uplink: Uplink) -> None:
    wide_uplink.put("cell-1/tele/state", "cell-2/tele/state")
    assert sum(count for key, count in wide_uplink.arrived.items() if key.endswith("state")) == 1
