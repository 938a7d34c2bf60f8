"""Replies leave beside the loop: a caller that takes none of them holds up nobody else's."""

from __future__ import annotations

import queue
import threading

from mcserver.net.replies import Outgoing, ReplySender

LIMIT_S = 5.0


def reply(size: int = 1, send: object = None, drop: object = None) -> Outgoing:
    return Outgoing(size, send or (lambda: None), drop or (lambda: None))  # type: ignore[arg-type]


def test_a_caller_that_is_stuck_holds_up_no_other_caller() -> None:
    sender = ReplySender(senders=3)
    freed, served = threading.Event(), threading.Semaphore(0)
    for caller in ("stuck", "also-stuck"):
        sender.push(caller, reply(send=lambda: freed.wait(LIMIT_S)))
    for number in range(100):
        sender.push(f"honest-{number % 7}", reply(send=served.release))
    assert all(served.acquire(timeout=LIMIT_S) for _ in range(100))
    freed.set()


def test_replies_of_one_caller_keep_their_order() -> None:
    sender = ReplySender(senders=4)
    order: list[int] = []
    last = threading.Event()
    for number in range(200):
        sender.push("one", reply(send=lambda number=number: order.append(number)))
    sender.push("one", reply(send=last.set))
    assert last.wait(LIMIT_S)
    assert order == list(range(200))


def test_what_waits_for_one_caller_is_bounded_by_count_and_by_bytes() -> None:
    sender = ReplySender(senders=1, caller_replies=3, caller_bytes=50)
    freed = threading.Event()
    dropped: queue.SimpleQueue[str] = queue.SimpleQueue()
    assert sender.has_room("stuck")
    # the one that is being sent may be of any size
    sender.push("stuck", reply(4000, send=lambda: freed.wait(LIMIT_S)))
    sender.push("stuck", reply(40))
    sender.push("stuck", reply(40, drop=lambda: dropped.put("bytes")))
    assert dropped.get(timeout=LIMIT_S) == "bytes"
    assert sender.has_room("stuck")
    sender.push("stuck", reply(1))
    assert not sender.has_room("stuck")
    assert sender.has_room("another")
    sender.push("stuck", reply(1, drop=lambda: dropped.put("count")))
    assert dropped.get(timeout=LIMIT_S) == "count"
    assert sender.dropped == 2
    freed.set()


def test_giving_up_blocks_nobody_either() -> None:
    sender = ReplySender()
    freed, served = threading.Event(), threading.Event()
    for _ in range(50):
        sender.discard(lambda: freed.wait(LIMIT_S))
    sender.push("honest", reply(send=served.set))
    assert served.wait(LIMIT_S)
    freed.set()


def test_a_reply_that_fails_costs_itself_alone() -> None:
    sender = ReplySender(senders=1)
    sent = threading.Event()

    def fail() -> None:
        raise RuntimeError("the link is gone")

    sender.push("one", reply(send=fail))
    sender.push("one", reply(send=sent.set))
    assert sent.wait(LIMIT_S)


def test_what_still_waits_at_the_end_is_dropped() -> None:
    sender = ReplySender(senders=1)
    freed, dropped = threading.Event(), threading.Event()
    sender.push("one", reply(send=lambda: freed.wait(LIMIT_S)))
    sender.push("one", reply(drop=dropped.set))
    sender.close()
    freed.set()
    assert dropped.wait(LIMIT_S)
