"""The numbering of lines, against a model of the server and a network that loses, repeats and delays."""

from __future__ import annotations

from collections import deque

from hypothesis import given, settings
from hypothesis import strategies as st
from mcclient.window import LineWindow


class Server:
    """Takes line n only if it is the next one, within its credit."""

    def __init__(self, room: int) -> None:
        self.accepted = 0
        self.consumed = 0
        self.room = room
        self.taken: list[str] = []

    @property
    def credit(self) -> int:
        return self.room - (self.accepted - self.consumed)

    def receive(self, first: int, lines: list[str]) -> tuple[int, int, int]:
        """The acknowledgement: accepted, credit, expected."""
        if first > self.accepted + 1:
            return self.accepted, self.credit, self.accepted + 1
        new = lines[self.accepted + 1 - first :][: self.credit]
        self.taken += new
        self.accepted += len(new)
        return self.accepted, self.credit, 0


def small_window(credit: int) -> LineWindow:
    return LineWindow(1, credit, buffer_lines=20, buffer_bytes=200, chunk_lines=6, chunk_bytes=40)


@settings(max_examples=150)
@given(
    total=st.integers(1, 60),
    room=st.integers(1, 30),
    fates=st.lists(
        st.sampled_from(["deliver", "lose", "repeat", "delay", "ack", "lose ack", "run", "doubt"]),
        max_size=120,
    ),
)
def test_no_line_is_lost_and_none_is_taken_twice_whatever_the_network_does(
    total: int, room: int, fates: list[str]
) -> None:
    server = Server(room)
    window = small_window(room)
    texts = [f"G01 X{n}" for n in range(total)]
    waiting = deque(texts)
    messages: deque[tuple[int, list[str]]] = deque()
    acks: deque[tuple[int, int, int]] = deque()

    def turn(fate: str) -> None:
        while waiting and window.has_room:
            window.give(waiting.popleft())
        while (chunk := window.next_chunk()) is not None:
            messages.append((chunk.first, chunk.lines))
            assert chunk.first + len(chunk.lines) - 1 <= window.accepted + window.credit
        if fate in ("deliver", "repeat") and messages:
            message = messages.popleft()
            for _ in range(1 + (fate == "repeat")):
                acks.append(server.receive(*message))
        elif fate == "lose" and messages:
            messages.popleft()
        elif fate == "delay" and messages:
            messages.rotate(1)
        elif fate == "ack" and acks:
            accepted, credit, expected = acks.popleft()
            window.acknowledge(accepted, credit, expected=expected)
        elif fate == "lose ack" and acks:
            acks.popleft()
        elif fate == "run":
            server.consumed = server.accepted
        elif fate == "doubt":
            window.acknowledge(server.accepted, server.credit)
            window.rewind()

    for fate in fates:
        turn(fate)
        assert server.taken == texts[: len(server.taken)]
    # from here on the network is well again, and the client in doubt asks
    for _ in range(20 * total):
        for fate in ("deliver", "ack", "run"):
            turn(fate)
        if not messages and not acks:
            turn("doubt")
        if len(server.taken) == total and not window.pending:
            break
    assert server.taken == texts
    assert not window.pending
    assert window.accepted == total


@settings(max_examples=100)
@given(count=st.integers(1, 30), faulty=st.integers(1, 30), accepted=st.integers(0, 30))
def test_after_a_rejection_the_faulty_number_is_the_next_one(count: int, faulty: int, accepted: int) -> None:
    window = small_window(100)
    for number in range(count):
        window.give(f"G01 X{number}")
    while window.next_chunk() is not None:
        continue
    window.acknowledge(min(accepted, count), 100)
    window.reject(faulty)
    following = min(faulty, count + 1)
    assert window.give("G01 X0") == following
    if window.accepted == following - 1:
        chunk = window.next_chunk()
        assert chunk is not None
        assert chunk.first == following


def test_memory_is_bounded_by_lines_and_by_bytes() -> None:
    window = small_window(10**6)
    while window.has_room:
        window.give("x" * 30)
    assert window.given == 7
    window.acknowledge(0, 0)
    assert window.next_chunk() is None


def test_a_line_longer_than_a_whole_chunk_is_sent_alone() -> None:
    window = small_window(100)
    window.give("x" * 500)
    assert not window.has_room
    chunk = window.next_chunk()
    assert chunk is not None
    assert chunk.lines == ["x" * 500]
