"""Messages between two processes: whole, in order, and without waiting."""

from __future__ import annotations

import asyncio
import select
import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.planning.message_pipe import READ_BYTES, MessagePipe, WatchedPipe


def pair() -> tuple[MessagePipe, MessagePipe]:
    ours, theirs = socket.socketpair()
    return MessagePipe(ours), MessagePipe(theirs)


def pump(sender: MessagePipe, receiver: MessagePipe, count: int) -> list[bytes]:
    """Passes on what waits until ``count`` messages have come."""
    found: list[bytes] = []
    while len(found) < count:
        sender.flush()
        select.select([receiver], [], [], 5.0)
        found += receiver.receive()
    return found


@given(st.lists(st.binary(max_size=2000), min_size=1, max_size=20))
def test_messages_of_any_length_arrive_whole_and_in_order(messages: list[bytes]) -> None:
    ours, theirs = pair()
    for message in messages:
        ours.send(message)
    assert pump(ours, theirs, len(messages)) == messages
    ours.close()
    theirs.close()


def test_a_sender_never_waits_for_a_reader_that_does_not_read() -> None:
    ours, theirs = pair()
    messages = [bytes([n]) * READ_BYTES for n in range(20)]
    for message in messages:
        ours.send(message)
    assert ours.blocked
    assert pump(ours, theirs, len(messages)) == messages
    assert not ours.blocked
    ours.close()
    theirs.close()


def test_what_was_sent_before_the_end_is_read_before_it() -> None:
    ours, theirs = pair()
    ours.send(b"last")
    ours.close()
    assert theirs.receive() == [b"last"]
    with pytest.raises(EOFError):
        theirs.receive()
    theirs.close()


def test_sending_to_one_that_is_gone_is_an_error() -> None:
    ours, theirs = pair()
    theirs.close()
    with pytest.raises(BrokenPipeError):
        ours.send(b"x")
    ours.close()


async def test_messages_of_one_turn_of_the_loop_leave_together_behind_it() -> None:
    ours, theirs = pair()
    watched = WatchedPipe(asyncio.get_running_loop(), ours, lambda: None)
    watched.send(b"first")
    watched.send(b"second")
    assert theirs.receive() == []
    await asyncio.sleep(0)
    assert theirs.receive() == [b"first", b"second"]
    watched.send(b"third")
    watched.flush()
    assert theirs.receive() == [b"third"], "whoever cannot wait for the loop flushes"
    watched.send(b"last")
    watched.release()
    assert theirs.receive() == [b"last"]
    ours.close()
    theirs.close()
