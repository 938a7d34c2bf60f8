"""The dead man's time of a jog, on a virtual clock."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import cast

from mcserver.service.jog import DEFAULT_HOLD_S, READING_S, Jogging
from mcserver.service.service import MachineService
from tests.service.simulated_cell import VirtualLoop


class OneJog:
    """A service with one jog under way."""

    client = "hmi"
    over = False
    state = "running"

    def __init__(self, loop: VirtualLoop) -> None:
        self.let_go_at: float | None = None
        self.on_program_ended: list[object] = []
        self._loop = loop

    def program(self, _program: str) -> OneJog:
        return self

    def abort(self, _program: str, _reason: str) -> None:
        self.over = True
        self.let_go_at = self._loop.time()


def play(script: Callable[[VirtualLoop, Jogging], None]) -> float | None:
    """Plays a jog with a dead man's time of 0.5 s; when it was let go."""
    loop = VirtualLoop()
    jog = OneJog(loop)

    async def run() -> None:
        jogging = Jogging(cast(MachineService, jog))
        jogging._watch("j1", 0.5)
        script(loop, jogging)
        await asyncio.sleep(3.0)

    try:
        loop.run_until_complete(run())
    finally:
        loop.close()
    return jog.let_go_at


def keep(jogging: Jogging, hold_s: float | None = 0.4) -> None:
    jogging._keep("hmi", "j1", hold_s)


def hold_up(loop: VirtualLoop, seconds: float) -> None:
    """The whole server gets no processor."""
    loop._virtual += seconds


def test_a_jog_that_nobody_keeps_is_let_go_at_its_time() -> None:
    assert play(lambda _loop, _jogging: None) == 0.5


def test_a_jog_goes_on_for_its_time_after_it_was_kept_last() -> None:
    assert play(lambda loop, jogging: loop.call_later(0.3, keep, jogging) and None) == 0.7
    of_the_server = play(lambda loop, jogging: loop.call_later(0.3, keep, jogging, None) and None)
    assert of_the_server == 0.3 + DEFAULT_HOLD_S


def test_a_server_that_was_held_up_reads_what_has_arrived_before_it_lets_go() -> None:
    def script(loop: VirtualLoop, jogging: Jogging) -> None:
        loop.call_later(0.2, hold_up, loop, 0.6)
        # it had arrived meanwhile, and is read a little later
        loop.call_later(0.81, keep, jogging)

    let_go_at = play(script)
    assert let_go_at is not None
    assert abs(let_go_at - 1.21) < 1e-9


def test_a_server_that_was_held_up_lets_go_of_a_jog_that_nobody_keeps() -> None:
    let_go_at = play(lambda loop, _jogging: loop.call_later(0.2, hold_up, loop, 0.6) and None)
    assert let_go_at is not None
    assert abs(let_go_at - (0.8 + READING_S)) < 1e-9
