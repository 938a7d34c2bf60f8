"""Hold-to-jog: what is late or out of turn moves nothing."""

from __future__ import annotations

import asyncio
from functools import partial

import pytest
from mcclient import RequestRefused

from mcserver.web.delays import MEASURED_S, DelayGate
from mcserver.web.jogging import MAX_DELAY_S, HeldJog
from tests.clock import Clock


class Machine:
    """Notes what it is asked for; ``answers`` are given one after the other."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, object]] = []
        self.gate = asyncio.Event()
        self.gate.set()
        self.ended = False

    async def jog(self, axis: int, velocity: float, program: str | None) -> str:
        self.calls.append(("start" if program is None else "keep", (axis, velocity)))
        await self.gate.wait()
        if program is not None and self.ended:
            raise RequestRefused("MC517", "it has ended")
        return "jog-1"

    async def abort(self, program: str | None = None) -> list[str]:
        self.calls.append(("abort", program))
        return [program or ""]


def rig() -> tuple[Machine, HeldJog, list[str]]:
    machine, said = Machine(), list[str]()
    return machine, HeldJog(machine, lambda error: said.append(f"{error.message} [{error.code}]")), said


async def test_a_press_starts_keeps_hold_and_a_release_aborts() -> None:
    machine, held, _ = rig()
    await held.press(1, partial(machine.jog, 0, 20.0), 0.0)
    await held.keep(1, 0.0)
    await held.release()
    assert machine.calls == [("start", (0, 20.0)), ("keep", (0, 20.0)), ("abort", "jog-1")]


async def test_a_release_while_the_server_answers_ends_the_jog_that_it_started() -> None:
    machine, held, _ = rig()
    machine.gate.clear()
    pressing = asyncio.ensure_future(held.press(1, partial(machine.jog, 0, 20.0), 0.0))
    await asyncio.sleep(0)
    await held.release()
    machine.gate.set()
    await pressing
    assert machine.calls == [("start", (0, 20.0)), ("abort", "jog-1")]
    await held.keep(1, 0.0)
    assert len(machine.calls) == 2


async def test_what_was_under_way_for_too_long_starts_and_keeps_nothing() -> None:
    machine, held, said = rig()
    await held.press(1, partial(machine.jog, 0, 20.0), MAX_DELAY_S + 0.1)
    assert machine.calls == []
    assert said == ["This was pressed 0.4 s ago: the link was held up [MC604]"]
    await held.press(2, partial(machine.jog, 0, 20.0), 0.0)
    await held.keep(2, MAX_DELAY_S + 4.5)
    assert machine.calls == [("start", (0, 20.0))]


async def test_a_jog_that_has_ended_is_not_started_again_by_its_keeps() -> None:
    machine, held, _ = rig()
    await held.press(1, partial(machine.jog, 0, 20.0), 0.0)
    machine.ended = True
    await held.keep(1, 0.0)
    await held.keep(1, 0.0)
    assert [kind for kind, _ in machine.calls] == ["start", "keep"]


async def test_an_old_press_after_a_newer_one_moves_nothing() -> None:
    machine, held, _ = rig()
    await held.press(2, partial(machine.jog, 0, 20.0), 0.0)
    await held.press(1, partial(machine.jog, 1, 20.0), 0.0)
    assert machine.calls == [("start", (0, 20.0))]


async def test_a_refusal_is_shown_and_nothing_is_held() -> None:
    machine, held, said = rig()

    async def refuse(*_: object, **__: object) -> str:
        raise RequestRefused("MC512", "the axis is leased")

    machine.jog = refuse  # type: ignore[method-assign]
    await held.press(1, partial(machine.jog, 0, 20.0), 0.0)
    await held.release()
    assert said == ["the axis is leased [MC512]"]
    assert machine.calls == []


def test_the_quickest_message_of_late_is_the_measure_of_the_others() -> None:
    clock = Clock()
    gate = DelayGate(clock)
    for sent_s, came_s, delay_s in ((0.0, 0.5, 0.0), (1.0, 1.0, 0.0), (2.0, 7.0, 5.0), (8.0, 8.3, 0.3)):
        clock.now = came_s
        assert gate.observe(sent_s) == pytest.approx(delay_s)
    # a stall is no new measure, however long it takes
    clock.now = 30.0 + MEASURED_S
    assert gate.observe(10.0) == pytest.approx(20.0 + MEASURED_S)


def test_clocks_that_drift_apart_make_no_message_late() -> None:
    clock = Clock()
    gate = DelayGate(clock)
    for beat in range(5000):
        # of 100 parts in a million, for a day's work
        clock.now = 2.0 * beat * 1.0001
        assert gate.observe(2.0 * beat) < MAX_DELAY_S / 10
    # one that stood while the computer slept is measured anew
    for beat in range(5000, 5100):
        clock.now = 2.0 * beat + 600.0
        delay_s = gate.observe(2.0 * beat)
    assert delay_s == 0.0
