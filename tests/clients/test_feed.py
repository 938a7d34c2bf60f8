"""Feeds: bounded, and ended by whoever reads or closes them."""

from __future__ import annotations

import asyncio

import pytest
from mcclient.feed import Feed, Queue


def feed(limit: int = 4) -> tuple[Queue[int], Feed[int], list[str]]:
    released: list[str] = []
    queue: Queue[int] = Queue(limit)
    return queue, Feed(queue, lambda: released.append("released")), released


async def test_a_reader_that_is_cancelled_loses_nothing() -> None:
    queue, items, released = feed()
    reader = asyncio.ensure_future(anext(items))
    await asyncio.sleep(0)
    reader.cancel()
    with pytest.raises(asyncio.CancelledError):
        await reader
    queue.push(1)
    assert await anext(items) == 1
    assert not released


async def test_a_loop_that_is_left_goes_on_where_it_was() -> None:
    queue, items, _ = feed()
    for number in range(3):
        queue.push(number)
    async for number in items:
        assert number == 0
        break
    assert await anext(items) == 1


async def test_closing_ends_a_loop_in_another_task_once_all_is_read() -> None:
    queue, items, released = feed()
    seen: list[int] = []

    async def read() -> None:
        async for number in items:
            seen.append(number)

    reader = asyncio.ensure_future(read())
    queue.push(7)
    await asyncio.sleep(0)
    items.close()
    await reader
    assert (seen, released) == ([7], ["released"])


async def test_a_block_closes_its_feed() -> None:
    _, items, released = feed()
    async with items:
        assert not released
    assert released == ["released"]


async def test_a_slow_reader_loses_the_oldest_and_can_see_it() -> None:
    queue, items, _ = feed(limit=2)
    for number in range(5):
        queue.push(number)
    assert (items.missed, await anext(items)) == (3, 3)
