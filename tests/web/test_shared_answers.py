"""Many viewers, one question."""

from __future__ import annotations

import asyncio

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
