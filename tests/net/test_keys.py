"""Keys of a machine."""

from __future__ import annotations

import pytest
import zenoh

from mcserver.net.keys import Call, Keys


def test_keys_are_those_of_the_reference() -> None:
    keys = Keys("cell-1")
    assert keys.rpc("hmi", "open") == "mc/@v1/cell-1/@rpc/hmi/open"
    assert keys.lines_in("hmi", "p") == "mc/@v1/cell-1/in/hmi/p"
    assert keys.telemetry_axis(3) == "mc/@v1/cell-1/tele/axis/3"


@pytest.mark.parametrize("name", ["", "a/b", "*", "@x", "a b", "x" * 64, "-a"])
def test_a_name_that_cannot_be_a_chunk_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be part of a key"):
        Keys(name)


def test_a_wide_expression_does_not_reach_a_machine() -> None:
    keys = Keys("cell-1")
    wide = zenoh.KeyExpr("mc/**")
    assert not wide.intersects(zenoh.KeyExpr(keys.event))
    assert not zenoh.KeyExpr("mc/@v1/**").intersects(zenoh.KeyExpr(keys.rpc("hmi", "abort")))
    assert zenoh.KeyExpr("mc/@v1/*/live/*").intersects(zenoh.KeyExpr(keys.live("i", "2e")))


def test_a_call_is_read_from_its_key() -> None:
    keys = Keys("cell-1")
    assert keys.call_of(keys.rpc("alice.hmi-1", "open")) == Call("alice.hmi-1", "open", exact=True)
    assert keys.call_of("mc/@v1/*/@rpc/alice/status") == Call("alice", "status", exact=False)


@pytest.mark.parametrize("rest", ["*/open", "alice/*", "**", "alice/**", "al$*/open", "open", "a/b/open", ""])
def test_a_key_that_names_no_one_call_is_none(rest: str) -> None:
    assert Keys("cell-1").call_of(f"mc/@v1/cell-1/@rpc/{rest}") is None


@pytest.mark.parametrize("rest", ["*/p", "alice/*", "**", "p", "alice/p/q", ""])
def test_a_key_that_names_no_one_stream_is_none(rest: str) -> None:
    keys = Keys("cell-1")
    assert keys.stream_of(keys.lines_in("alice", "p")) == ("alice", "p")
    assert keys.stream_of(f"mc/@v1/cell-1/in/{rest}") is None


@pytest.mark.parametrize(
    ("key", "stops"),
    [
        ("mc/@v1/cell-1/estop", True),
        ("mc/@v1/*/estop", True),
        ("mc/@v1/**", False),
        ("mc/@v1/cell-1/*", False),
    ],
)
def test_a_stop_is_asked_for_by_name(key: str, stops: bool) -> None:
    assert Keys("cell-1").is_stop(key) is stops
