"""A network thread does what the loop would do while the loop sleeps, and only then."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

import pytest

from mcserver.net.borrowing import Borrower
from mcserver.net.inbox import Inbox
from mcserver.net.shared_loop import SharedLoop, Turn
from tests.net.client import WireClient
from tests.net.conftest import Rig

LIMIT_S = 5.0


async def in_thread(work: Callable[[], object]) -> None:
    """Run ``work`` in a thread while the loop sleeps."""
    ended = asyncio.Event()
    loop = asyncio.get_running_loop()

    def run() -> None:
        work()
        loop.call_soon_threadsafe(ended.set)

    threading.Thread(target=run).start()
    await asyncio.wait_for(ended.wait(), LIMIT_S)


def shared_loop() -> SharedLoop:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, SharedLoop)
    return loop


async def test_the_turn_is_not_lent_while_the_loop_works() -> None:
    loop = shared_loop()
    borrowed: list[bool] = []
    thread = threading.Thread(target=lambda: borrowed.append(loop.turn.borrow()))
    thread.start()
    # the loop is in this function, and so awake
    thread.join()
    assert borrowed == [False]


async def test_the_turn_is_lent_while_the_loop_sleeps_and_given_back() -> None:
    loop = shared_loop()
    borrowed = threading.Event()

    def borrow() -> None:
        while not loop.turn.borrow():
            pass
        borrowed.set()
        loop.turn.give_back()

    for _ in range(100):
        borrowed.clear()
        await in_thread(borrow)
        assert borrowed.is_set()


def test_the_loop_goes_before_all_who_would_borrow() -> None:
    turn = Turn()
    turn.give_back()
    assert turn.borrow()
    back = threading.Event()

    def loop() -> None:
        turn.take_back()
        back.set()

    thread = threading.Thread(target=loop)
    thread.start()
    while not turn.wanted:
        pass
    turn.give_back()
    # however often somebody tries, the loop has it next
    while not back.is_set():
        assert not turn.borrow()
    thread.join()


async def test_what_a_borrower_schedules_is_done_though_the_loop_sleeps_for_ever() -> None:
    loop = shared_loop()
    done = asyncio.Event()

    def schedule() -> None:
        while not loop.turn.borrow():
            pass
        loop.call_later(0.0, done.set)
        loop.notice()
        loop.turn.give_back()

    thread = threading.Thread(target=schedule)
    thread.start()
    await done.wait()
    thread.join()


async def test_a_loop_whose_turn_was_borrowed_looks_again_soon_by_itself() -> None:
    loop = shared_loop()
    done = asyncio.Event()

    def borrow(leave: Callable[[], object]) -> None:
        while not loop.turn.borrow():
            pass
        leave()
        loop.turn.give_back()

    # a first borrower wakes the loop, which is on the alert from then on
    await in_thread(lambda: borrow(loop.notice))
    # another one wakes nobody, and nothing else does
    thread = threading.Thread(target=borrow, args=(lambda: loop.call_later(0.0, done.set),))
    thread.start()
    await done.wait()
    thread.join()


class Handled:
    """Messages in the order in which they were handled, and by which thread."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self.order: list[int] = []
        self.by_loop: list[int] = []
        self.inbox: Inbox[int] = Inbox(loop, self._in_loop, limit=10_000)
        self.finished = 0
        self.borrower: Borrower[int] = Borrower(loop, self.inbox, self._now, (self.inbox,), self._finish)

    def _in_loop(self, number: int) -> None:
        self.order.append(number)
        self.by_loop.append(number)

    def _now(self, number: int) -> None:
        self.order.append(number)

    def _finish(self) -> None:
        self.finished += 1


async def test_messages_of_one_thread_keep_their_order_whoever_handles_them() -> None:
    handled = Handled(asyncio.get_running_loop())
    count = 3000

    def send() -> None:
        for number in range(count):
            # every third is of a kind that only the loop handles
            (handled.borrower if number % 3 else handled.inbox).push(number)

    await in_thread(send)
    while len(handled.order) < count:
        await asyncio.sleep(0)
    assert handled.order == list(range(count))


async def test_whoever_brings_a_message_handles_it_while_the_loop_sleeps() -> None:
    handled = Handled(asyncio.get_running_loop())

    def send() -> None:
        # sooner or later the loop is asleep; where a borrowed turn never came, the test runs into its limit
        while len(handled.by_loop) == len(handled.order):
            handled.borrower.push(0)

    await in_thread(send)


async def test_a_message_that_cannot_be_handled_keeps_no_turn() -> None:
    loop = shared_loop()

    def fail(number: int) -> None:
        raise RuntimeError(f"message {number}")

    inbox: Inbox[int] = Inbox(loop, fail, limit=10)
    borrower: Borrower[int] = Borrower(loop, inbox, fail, (inbox,), lambda: None)
    for number in range(10):
        await in_thread(lambda number=number: borrower.push(number))  # type: ignore[misc]
    assert await asyncio.wait_for(asyncio.sleep(0, "awake"), LIMIT_S) == "awake"


async def test_an_answer_leaves_without_the_turn_and_before_what_nobody_waits_for() -> None:
    loop = shared_loop()
    done: list[str] = []

    def answer() -> None:
        # the turn is free again, or the loop has it: nobody else is there to take it
        assert threading.current_thread() is not threading.main_thread()
        done.append("answered")

    def handle(_: int) -> Callable[[], None]:
        done.append("handled")
        return answer

    inbox: Inbox[int] = Inbox(loop, lambda _: None, limit=10)
    borrower: Borrower[int] = Borrower(loop, inbox, handle, (inbox,), lambda: done.append("finished"))

    def send() -> None:
        # sooner or later the loop is asleep at both moments; else the test runs into its limit
        while "finished" not in done:
            done.clear()
            borrower.push(1)

    await in_thread(send)
    assert done == ["handled", "answered", "finished"]


async def test_a_finish_that_fails_keeps_no_turn() -> None:
    loop = shared_loop()
    tried: list[int] = []

    def finish() -> None:
        tried.append(1)
        raise RuntimeError("finish")

    inbox: Inbox[int] = Inbox(loop, lambda _: None, limit=10)
    borrower: Borrower[int] = Borrower(loop, inbox, lambda _: lambda: None, (inbox,), finish)

    def send() -> None:
        while not tried:
            borrower.push(1)

    await in_thread(send)
    assert await asyncio.wait_for(asyncio.sleep(0, "awake"), LIMIT_S) == "awake"


async def test_a_loop_that_lends_no_turn_has_its_inbox(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = shared_loop()
    # asyncio's debug mode refuses timers of other threads
    monkeypatch.setattr(loop, "get_debug", lambda: True)
    handled = Handled(loop)
    await in_thread(lambda: handled.borrower.push(1))
    while not handled.order:
        await asyncio.sleep(0)
    assert handled.by_loop == [1]


async def test_calls_and_lines_of_one_client_are_served_in_its_order(rig: Rig, client: WireClient) -> None:
    program = (await client.call("open"))["program"]
    for first in range(1, 101, 2):
        client.put(client.lines_key(program), [first, ["move", "move"]])
        reply = await client.call("submit", program=program, first=1, lines=["move"])
        # of lower priority, the lines may come later than the call; never twice, never with a gap
        assert reply["accepted"] <= first + 1
    async with asyncio.timeout(LIMIT_S):
        while len(rig.pipelines.made[program].executed) < 100:
            await asyncio.sleep(0.001)
    assert rig.pipelines.made[program].executed == [(number, "move") for number in range(1, 101)]


async def test_a_change_is_seen_by_the_next_status_of_anybody(rig: Rig, client: WireClient) -> None:
    program = (await client.call("open"))["program"]
    other = WireClient(rig.endpoint, "bench", "other")
    for _ in range(20):
        await client.call("hold", program=program)
        (held,) = (await other.call("status"))["programs"]
        assert held["state"] == "held"
        await client.call("resume", program=program)
        (running,) = (await other.call("status"))["programs"]
        assert running["state"] == "running"
    await other.close()
