"""Which emergency stops are copies of one."""

from __future__ import annotations

from mcserver.net.stop_copies import KNOWN, KNOWN_S, LEAST_NUMBER, StopCopies
from tests.clock import Clock


def test_a_number_is_a_copy_for_some_seconds_after_its_first() -> None:
    clock = Clock()
    copies = StopCopies(clock)
    assert not copies.is_copy(LEAST_NUMBER)
    clock.now += KNOWN_S
    assert copies.is_copy(LEAST_NUMBER)
    # counted from the first one: who repeats for ever stops again
    clock.now += 0.1
    assert not copies.is_copy(LEAST_NUMBER)


def test_no_number_and_numbers_of_counters_are_never_copies() -> None:
    copies = StopCopies(Clock())
    for number in (None, 0, 1, LEAST_NUMBER - 1):
        assert not copies.is_copy(number)
        assert not copies.is_copy(number)


def test_what_is_known_is_bounded_and_a_forgotten_number_stops() -> None:
    copies = StopCopies(Clock())
    for number in range(KNOWN + 1):
        assert not copies.is_copy(LEAST_NUMBER + number)
    assert copies.is_copy(LEAST_NUMBER + KNOWN)
    assert not copies.is_copy(LEAST_NUMBER)
