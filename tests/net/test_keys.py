"""Keys of a machine."""

from __future__ import annotations

import pytest
import zenoh

from mcserver.net.keys import Keys, all_machines, is_wild, machine_of


def test_keys_are_those_of_the_reference() -> None:
    keys = Keys("cell-1")
    assert keys.rpc("open") == "mc/@v1/cell-1/@rpc/open"
    assert keys.lines_in("p") == "mc/@v1/cell-1/in/p"
    assert keys.telemetry_axis(3) == "mc/@v1/cell-1/tele/axis/3"


@pytest.mark.parametrize("name", ["", "a/b", "*", "@x", "a b", "x" * 64, "-a"])
def test_a_name_that_cannot_be_a_chunk_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="cannot be part of a key"):
        Keys(name)


def test_a_wide_expression_does_not_reach_a_machine() -> None:
    keys = Keys("cell-1")
    wide = zenoh.KeyExpr("mc/**")
    assert not wide.intersects(zenoh.KeyExpr(keys.event))
    assert not zenoh.KeyExpr("mc/@v1/**").intersects(zenoh.KeyExpr(keys.rpc("abort")))
    assert zenoh.KeyExpr(all_machines()).intersects(zenoh.KeyExpr(keys.live("i")))


def test_the_machine_is_read_from_a_key() -> None:
    assert machine_of(Keys("cell-1").live("i")) == "cell-1"
    with pytest.raises(ValueError, match="is not a key of"):
        machine_of("other/key")


@pytest.mark.parametrize(("key", "wild"), [("a/*/b", True), ("a/b$*", True), ("a/**", True), ("a/b", False)])
def test_wildcards_are_seen(key: str, wild: bool) -> None:
    assert is_wild(key) is wild
