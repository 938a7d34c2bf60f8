"""Interfaces that go, come back, or have no room: a port counts, and waits for nothing."""

from __future__ import annotations

import time

import pytest

from mcserver.can.open import open_port
from mcserver.can.port import CanPort
from mcserver.errors import RuntimeFault
from tests.socketcan.conftest import Open
from tests.socketcan.interfaces import LIMIT_S, down, receive, slow


def send_until_taken(port: CanPort, identifier: int) -> None:
    """As a cycle does: tries again and again, whatever came of the last one."""
    end = time.monotonic() + LIMIT_S
    while not port.send(identifier, b""):
        port.drain()
        assert time.monotonic() < end, "the port does not come back"
        time.sleep(0.01)


def drain_until_open(port: CanPort) -> None:
    end = time.monotonic() + LIMIT_S
    while port.fileno() < 0 or port.counters.down:
        port.drain()
        assert time.monotonic() < end, "the port does not come back"
        time.sleep(0.01)


def test_a_port_on_an_interface_that_went_down_counts_and_says_so(opened: Open) -> None:
    port = opened("vcan0")
    assert port.send(0x080, b"")
    with down("vcan0"):
        sent = [port.send(0x200 + node, bytes(8)) for node in range(1, 13)]
        assert sent == [False] * 12
        assert port.drain() == []
        assert port.counters.down
        assert port.counters.unsent == 12
    drain_until_open(port)


def test_a_port_that_only_listens_sees_that_its_interface_went_down(opened: Open) -> None:
    port = opened("vcan1")
    with down("vcan1"):
        assert port.drain() == []
        assert port.counters.down
    drain_until_open(port)


def test_an_interface_that_came_back_is_used_again_in_both_directions(opened: Open) -> None:
    one, other = opened("vcan0"), opened("vcan0")
    for _ in range(3):
        with down("vcan0"):
            assert not one.send(0x080, b"")
            assert other.drain() == []
        drain_until_open(other)
        send_until_taken(one, 0x181)
        assert receive(other, 1) == [(0x181, b"")]
        assert other.send(0x201, b"\1")
        assert receive(one, 1) == [(0x201, b"\1")]
    assert not one.counters.down
    assert not other.counters.down


def test_one_bus_that_is_down_leaves_the_others_alone(opened: Open) -> None:
    gone, sender, receiver = opened("vcan0"), opened("vcan1"), opened("vcan1")
    with down("vcan0"):
        for count in range(100):
            assert not gone.send(0x200, b"")
            assert sender.send(0x201, bytes([count]))
        assert receive(receiver, 100) == [(0x201, bytes([count])) for count in range(100)]
    drain_until_open(gone)


def test_an_interface_that_is_down_cannot_be_opened_and_the_remedy_brings_it_up() -> None:
    with down("vcan2"), pytest.raises(RuntimeFault) as refused:
        open_port("vcan2")
    assert refused.value.code == "MC424"
    assert "ip link set vcan2 up" in refused.value.hint
    open_port("vcan2").close()


def test_frames_without_room_are_counted_and_nothing_blocks(opened: Open) -> None:
    port, receiver = opened("vcan3"), opened("vcan3")
    tried = 5000
    with slow("vcan3"):
        # 5000 frames would take more than a minute at the speed of this bus: a port that waits would show it
        taken = sum(port.send(0x201, count.to_bytes(4, "little")) for count in range(tried))
        assert 0 < taken < tried
        assert (port.counters.sent, port.counters.unsent) == (taken, tried - taken)
        assert not port.counters.down
        came = receive(receiver, 1)
        assert came[0] == (0x201, bytes(4))
    send_until_taken(port, 0x081)
