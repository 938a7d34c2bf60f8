"""Publications leave in order, from a thread of their own, and never more than there is room for."""

from __future__ import annotations

import threading

import zenoh

from mcserver.net.publishing import PublishingThread
from tests.net.client import WireClient
from tests.net.conftest import Rig

LIMIT_S = 5.0


def test_messages_leave_in_the_order_in_which_they_were_given() -> None:
    publishing = PublishingThread("test")
    left: list[bytes] = []
    for number in range(500):
        publishing.put(left.append, b"%d" % number)
    publishing.close()
    assert left == [b"%d" % number for number in range(500)]


def test_a_put_that_hangs_holds_up_nobody_who_publishes() -> None:
    publishing = PublishingThread("test", limit=3)
    freed, hanging = threading.Event(), threading.Event()

    def hang(_: bytes) -> None:
        hanging.set()
        freed.wait(LIMIT_S)

    left: list[bytes] = []
    publishing.put(hang, b"")
    assert hanging.wait(LIMIT_S)
    for number in range(10):
        publishing.put(left.append, b"%d" % number)
    assert publishing.dropped == 7
    freed.set()
    publishing.close()
    assert left == [b"0", b"1", b"2"]


def test_a_put_that_fails_costs_itself_alone() -> None:
    publishing = PublishingThread("test")
    left: list[bytes] = []

    def fail(_: bytes) -> None:
        raise zenoh.ZError("the link is gone")

    publishing.put(fail, b"")
    publishing.put(left.append, b"next")
    publishing.close()
    assert left == [b"next"]


async def test_a_stop_is_confirmed_while_every_other_publication_hangs(rig: Rig, client: WireClient) -> None:
    events = client.subscribe("event")
    await client.call("status")
    freed = threading.Event()
    rig.publishing.put(lambda _: freed.wait(LIMIT_S), b"")
    try:
        client.session.put(f"{client.root}/estop", b"")
        await events.first(lambda event: event["kind"] == "estop")
        assert [event["kind"] for event in events.all] == ["estop"]
    finally:
        freed.set()
