"""Numbering, repeats, gaps and credit, against a model that keeps every line."""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from mcserver.service.line_queue import Gap, LineQueue

LIMIT = 20


class QueueAgainstModel(RuleBasedStateMachine):
    """A client that repeats, skips, overlaps and sends too much; a planner that consumes and rejects."""

    def __init__(self) -> None:
        super().__init__()
        self.queue = LineQueue(5, limit_lines=LIMIT, limit_bytes=10_000)
        self.taken: list[int] = []
        self.consumed = 4

    @rule(offset=st.integers(-10, 3), count=st.integers(1, 30))
    def send(self, offset: int, count: int) -> None:
        first = max(1, self.queue.expected + offset)
        expected = self.queue.expected
        credit = self.queue.credit
        result = self.queue.take(first, [f"line {first + index}" for index in range(count)])
        if first > expected:
            assert result == Gap(expected)
            return
        assert not isinstance(result, Gap)
        assert result.first == expected
        assert len(result.lines) == min(max(0, first + count - expected), credit)
        for index, line in enumerate(result.lines):
            assert line == f"line {expected + index}"
            self.taken.append(expected + index)

    @rule(share=st.floats(0.0, 1.0))
    def consume(self, share: float) -> None:
        self.consumed += int(share * (self.queue.accepted - self.consumed))
        self.queue.consume(self.consumed)

    @rule(ahead=st.integers(1, 5))
    def reject(self, ahead: int) -> None:
        line = self.consumed + ahead
        if line > self.queue.accepted:
            return
        self.queue.reject(line)
        self.taken = [number for number in self.taken if number < line]
        self.consumed = line - 1

    @invariant()
    def each_line_is_taken_once_and_in_order(self) -> None:
        assert self.taken == list(range(5, self.queue.expected))

    @invariant()
    def what_waits_is_bounded_and_credit_says_how_much_fits(self) -> None:
        assert self.queue.credit == LIMIT - (self.queue.accepted - self.consumed)
        assert 0 <= self.queue.credit <= LIMIT


QueueAgainstModel.TestCase.settings = settings(max_examples=60, stateful_step_count=30)
TestQueueAgainstModel = QueueAgainstModel.TestCase


def test_long_lines_use_up_the_credit_too() -> None:
    queue = LineQueue(limit_lines=100, limit_bytes=1000)
    queue.take(1, ["x" * 600])
    assert queue.credit == 99
    queue.take(2, ["x" * 600])
    assert queue.credit == 0
    queue.consume(1)
    assert queue.credit == 99
