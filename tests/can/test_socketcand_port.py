"""The port on a socketcand server: frames both ways, and connections that go and come."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

import pytest

from mcserver.can.hub import Hub
from mcserver.can.open import open_port
from mcserver.can.port import MAX_DRAINED, CanPort
from mcserver.can.socketcand import SocketcandPort
from mcserver.errors import RuntimeFault
from tests.can.hubs import LIMIT_S, address_of, receive, running_hub, wait_until

Pair = tuple[CanPort, CanPort]


@pytest.fixture
def hub() -> Iterator[Hub]:
    with running_hub() as running:
        yield running


@pytest.fixture
def pair(hub: Hub) -> Iterator[Pair]:
    one, other = open_port(address_of(hub)), open_port(address_of(hub))
    yield one, other
    one.close()
    other.close()


def test_a_frame_comes_to_the_other_end_as_it_was_sent(pair: Pair) -> None:
    one, other = pair
    frames = [(0x000, b"\x01\x00"), (0x080, b""), (0x7FF, bytes(range(0xF8, 0x100)))]
    for identifier, payload in frames:
        assert one.send(identifier, payload)
    assert receive(other, 3) == frames
    assert (one.counters.sent, other.counters.received) == (3, 3)


def test_own_frames_are_not_received(pair: Pair) -> None:
    one, other = pair
    one.send(0x181, b"\x01")
    receive(other, 1)
    assert one.drain() == []


def test_a_prepared_buffer_is_sent_as_it_is_now(pair: Pair) -> None:
    one, other = pair
    buffer = one.prepare(0x201, 4)
    for count in range(3):
        buffer[one.payload_offset] = count
        assert one.send_prepared(buffer)
    assert receive(other, 3) == [(0x201, bytes((count, 0, 0, 0))) for count in range(3)]


def test_what_is_no_classic_frame_cannot_be_prepared(pair: Pair) -> None:
    for identifier, length in ((0x800, 8), (-1, 0), (0x100, 9)):
        with pytest.raises(ValueError, match="no classic frame"):
            pair[0].prepare(identifier, length)


def test_at_most_so_many_frames_are_taken_in_one_call_and_none_is_lost(pair: Pair) -> None:
    one, other = pair
    total = 3 * MAX_DRAINED
    for count in range(total):
        assert one.send(0x100, count.to_bytes(2, "little"))
    frames = []
    while len(frames) < total:
        taken = receive(other, 1)
        assert len(taken) <= MAX_DRAINED
        frames += taken
    assert [int.from_bytes(payload, "little") for _, payload in frames] == list(range(total))


def test_a_lost_server_makes_the_port_down_and_nothing_raises() -> None:
    with running_hub() as hub:
        port = open_port(address_of(hub))
    wait_until(lambda: port.drain() == [] and port.counters.down, "the port sees the loss")
    assert port.fileno() == -1
    assert not port.send(0x100, b"")
    assert port.counters.unsent == 1
    port.close()


def test_a_server_that_comes_back_is_used_again_by_itself() -> None:
    with running_hub() as hub:
        number = hub.port
        port = open_port(address_of(hub))
    wait_until(lambda: port.drain() == [] and port.counters.down, "the port sees the loss")
    with running_hub(port=number) as hub:
        wait_until(lambda: port.drain() == [] and not port.counters.down, "the port is up again")
        other = open_port(address_of(hub))
        assert other.send(0x181, b"\x05")
        assert receive(port, 1) == [(0x181, b"\x05")]
        assert port.send(0x201, b"\x06")
        assert receive(other, 1) == [(0x201, b"\x06")]
        other.close()
        port.close()


def test_a_closed_port_stays_closed(hub: Hub) -> None:
    port = open_port(address_of(hub))
    port.close()
    port.close()
    assert port.drain() == []
    assert not port.send(0x100, b"")
    assert port.fileno() == -1


def test_a_server_that_is_not_there_is_said_at_once_with_a_remedy() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        number = listener.getsockname()[1]
    with pytest.raises(RuntimeFault) as refused:
        SocketcandPort("127.0.0.1", number, "can0")
    assert refused.value.code == "MC424"
    assert "socketcand server runs there" in refused.value.hint


def test_a_server_that_says_nothing_is_not_waited_for_without_end() -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as listener,
        pytest.raises(RuntimeFault, match="no answer"),
    ):
        SocketcandPort("127.0.0.1", listener.getsockname()[1], "can0", open_s=0.2)


def test_a_channel_that_the_server_has_not_is_refused() -> None:
    with running_hub("can1") as hub, pytest.raises(RuntimeFault, match="could not open bus"):
        open_port(address_of(hub, "can0"))


def serve_one(listener: socket.socket, texts: list[bytes], done: threading.Event) -> None:
    """A server that sends its answers however it likes, frames glued to them."""
    connection, _ = listener.accept()
    with connection:
        connection.sendall(texts[0])
        for text in texts[1:]:
            connection.recv(256)
            connection.sendall(text)
        done.wait(LIMIT_S)


def test_frames_glued_to_the_last_answer_and_cut_anywhere_are_taken() -> None:
    texts = [b"< hi >", b"< ok >", b"< ok >< frame 181 1.5 0102 >< fra", b"me 182 1.6  >< frame 9 9 zz >"]
    done = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=serve_one, args=(listener, texts, done))
        thread.start()
        port = SocketcandPort("127.0.0.1", listener.getsockname()[1], "can0")
        frames = port.drain()
        wait_until(lambda: frames.extend(port.drain()) or port.counters.malformed, "all has come")
        done.set()
        thread.join(LIMIT_S)
        port.close()
    assert frames == [(0x181, b"\x01\x02"), (0x182, b"")]
    assert port.counters.malformed == 1
