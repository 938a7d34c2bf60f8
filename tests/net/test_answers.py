"""The memory of answers: bounded, and the same answer to the same request."""

from __future__ import annotations

import pytest

from mcserver.errors import ServiceError
from mcserver.net.answers import Answer, AnswerMemory
from tests.clock import Clock


def ask(memory: AnswerMemory, request: int, got: list[Answer], method: str = "open") -> bool:
    return memory.begin("hmi", request, method, got.append)


def test_the_same_request_is_new_only_once() -> None:
    memory, got = AnswerMemory(Clock(0.0)), list[Answer]()
    assert ask(memory, 1, got)
    memory.finish("hmi", 1, Answer(True, b"x"))
    assert not ask(memory, 1, got)
    assert got == [Answer(True, b"x")] * 2


def test_a_repeat_while_the_first_is_under_way_waits_for_its_answer() -> None:
    memory, got = AnswerMemory(Clock(0.0)), list[Answer]()
    assert ask(memory, 1, got)
    assert not ask(memory, 1, got)
    assert got == []
    memory.finish("hmi", 1, Answer(False, b"e"))
    assert got == [Answer(False, b"e")] * 2


def test_another_client_may_use_the_same_number() -> None:
    memory, got = AnswerMemory(Clock(0.0)), list[Answer]()
    assert ask(memory, 1, got)
    assert memory.begin("other", 1, "open", got.append)


def test_the_same_number_for_another_method_is_refused() -> None:
    memory, got = AnswerMemory(Clock(0.0)), list[Answer]()
    ask(memory, 1, got)
    with pytest.raises(ServiceError, match="MC506: "):
        ask(memory, 1, got, "close")


def test_answers_are_forgotten_by_age() -> None:
    clock = Clock(0.0)
    memory, got = AnswerMemory(clock, age_s=10.0), list[Answer]()
    ask(memory, 1, got)
    memory.finish("hmi", 1, Answer(True, b"x"))
    clock.now = 10.5
    assert ask(memory, 1, got)


def test_answers_are_bounded_by_count_and_by_bytes() -> None:
    memory, got = AnswerMemory(Clock(0.0), limit=10, limit_bytes=50), list[Answer]()
    for request in range(100):
        ask(memory, request, got)
        memory.finish("hmi", request, Answer(True, b"0123456789"))
        assert len(memory) <= 10
    assert len(memory) == 5
    assert not ask(memory, 99, got)


def test_the_requests_of_one_client_make_no_other_client_s_answer_go() -> None:
    memory, got = AnswerMemory(Clock(0.0), limit=10), list[Answer]()
    memory.begin("victim", 1, "jog", got.append)
    memory.finish("victim", 1, Answer(True, b"moved"))
    for request in range(5000):
        ask(memory, request, got)
        memory.finish("hmi", request, Answer(True, b"x"))
    assert not memory.begin("victim", 1, "jog", got.append)
    assert got[-1] == Answer(True, b"moved")


def test_a_client_too_many_is_refused_until_an_old_one_s_answers_have_aged() -> None:
    clock = Clock(0.0)
    memory, got = AnswerMemory(clock, clients=3, age_s=10.0), list[Answer]()
    for name in ("a", "b", "c"):
        memory.begin(name, 1, "jog", got.append)
        memory.finish(name, 1, Answer(True, b"x"))
    with pytest.raises(ServiceError, match="MC508: "):
        memory.begin("d", 1, "jog", got.append)
    clock.now = 10.5
    assert memory.begin("d", 1, "jog", got.append)
    assert len(memory) == 1


def test_a_request_under_way_is_never_forgotten() -> None:
    memory, got = AnswerMemory(Clock(0.0), limit=3), list[Answer]()
    ask(memory, 0, got)
    for request in range(1, 20):
        ask(memory, request, got)
        memory.finish("hmi", request, Answer(True, b"x"))
    assert not ask(memory, 0, got)
