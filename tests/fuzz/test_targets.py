"""A short run of the fuzzer: whatever comes is taken or refused with the target's own error."""

from __future__ import annotations

import pytest

from tests.fuzz.__main__ import fault_of, input_of
from tests.fuzz.targets import targets

INPUTS = 20
TARGETS = targets()


@pytest.mark.parametrize("name", TARGETS)
def test_whatever_comes_is_taken_or_refused(name: str) -> None:
    target = TARGETS[name]
    for number in range(INPUTS * target.share):
        data = input_of(target, name, 0, number)
        wrong = fault_of(target, data)
        assert not wrong, f"{data!r}\n{wrong}"


@pytest.mark.parametrize("name", TARGETS)
def test_a_fault_of_a_target_is_found(name: str) -> None:
    target = TARGETS[name]

    def run(_: bytes) -> None:
        raise ZeroDivisionError

    broken = type(target)(run, target.refusals, target.seeds)
    assert "ZeroDivisionError" in fault_of(broken, b"")
