"""Many viewers, one question."""

from __future__ import annotations

import asyncio
import gc

import pytest

from mcserver.web.shared_answers import SharedAnswers


def test_many_viewers_ask_once_in_a_period_and_share_errors() -> None:
    now = 0.0
    asked: list[float] = []

    async def ask() -> int:
        asked.append(now)
        await asyncio.sleep(0)
        if now > 5.0:
            raise RuntimeError("gone")
        return len(asked)

    async def run() -> None:
        nonlocal now
        answers = SharedAnswers(lambda: now)
        assert await asyncio.gather(*(answers.get("a", 3.0, ask) for _ in range(50))) == [1] * 50
        now = 2.9
        assert await answers.get("a", 3.0, ask) == 1
        answers.forget("a")
        assert await answers.get("a", 3.0, ask) == 2
        now = 6.0
        results = await asyncio.gather(
            *(answers.get("a", 3.0, ask) for _ in range(3)), return_exceptions=True
        )
        assert [type(each) for each in results] == [RuntimeError] * 3
        assert len(asked) == 3

    asyncio.run(run())


def test_a_viewer_that_leaves_takes_the_answer_from_nobody() -> None:
    async def run() -> None:
        gate = asyncio.Event()

        async def ask() -> str:
            await gate.wait()
            return "here"

        answers = SharedAnswers(lambda: 0.0)
        first = asyncio.ensure_future(answers.get("a", 1.0, ask))
        second = asyncio.ensure_future(answers.get("a", 1.0, ask))
        await asyncio.sleep(0)
        first.cancel()
        gate.set()
        assert await second == "here"
        with pytest.raises(asyncio.CancelledError):
            await first

    asyncio.run(run())


def test_an_error_whose_viewers_have_all_left_is_nobodys() -> None:
    async def run() -> None:
        loop, complaints = asyncio.get_running_loop(), list[object]()
        loop.set_exception_handler(lambda _, context: complaints.append(context))
        gate = asyncio.Event()

        async def ask() -> str:
            await gate.wait()
            raise RuntimeError("gone")

        waits = asyncio.ensure_future(SharedAnswers(lambda: 0.0).get("a", 1.0, ask))
        await asyncio.sleep(0)
        waits.cancel()
        await asyncio.gather(waits, return_exceptions=True)
        gate.set()
        for _ in range(3):
            await asyncio.sleep(0)
        del waits
        gc.collect()
        assert complaints == []

    asyncio.run(run())
