"""Leases: whole, in order, side by side where disjoint."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.service.leases import LeaseTable


def test_a_lease_is_taken_whole_or_not_at_all() -> None:
    table = LeaseTable()
    table.request("a", [0])
    assert table.request("b", [0, 1]) == []
    assert table.holder(1) is None


def test_a_later_program_passes_only_if_it_needs_none_of_the_axes_waited_for() -> None:
    table = LeaseTable()
    table.request("a", [0])
    table.request("b", [0, 1])
    assert table.request("c", [1]) == []
    assert [grant.program for grant in table.request("d", [2])] == ["d"]
    assert [grant.program for grant in table.release("a")] == ["b"]
    assert [grant.program for grant in table.release("b")] == ["c"]


def test_who_gives_up_waiting_lets_those_behind_pass() -> None:
    table = LeaseTable()
    table.request("a", [0])
    table.request("b", [0, 1])
    table.request("c", [1])
    assert [grant.program for grant in table.release("b")] == ["c"]


def test_programs_beyond_the_slots_wait() -> None:
    table = LeaseTable(slots=2)
    table.request("a", [0])
    table.request("b", [1])
    assert table.request("c", [2]) == []
    (grant,) = table.release("a")
    assert (grant.program, grant.slot) == ("c", 0)


def test_who_waits_knows_for_whom() -> None:
    table = LeaseTable()
    table.request("a", [0])
    table.request("b", [0, 1])
    table.request("c", [1])
    assert table.ahead_of("c") == ["b"]
    assert table.ahead_of("a") == []


@pytest.mark.parametrize("axes", [[], [0]])
def test_asking_twice_or_for_nothing_is_a_mistake(axes: list[int]) -> None:
    table = LeaseTable()
    if axes:
        table.request("a", axes)
    with pytest.raises(ValueError, match=r"axis|axes"):
        table.request("a", axes)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.frozensets(st.integers(0, 5), min_size=1)), max_size=40))
def test_leases_never_overlap_and_everyone_is_served_at_last(
    steps: list[tuple[bool, frozenset[int]]],
) -> None:
    table = LeaseTable(slots=3)
    holding: dict[str, frozenset[int]] = {}
    asked: list[str] = []
    served: list[str] = []
    for number, (release, axes) in enumerate(steps):
        if release and holding:
            name = next(iter(holding))
            del holding[name]
            grants = table.release(name)
        else:
            asked.append(f"p{number}")
            grants = table.request(f"p{number}", axes)
        for grant in grants:
            assert not any(grant.axes & other for other in holding.values())
            holding[grant.program] = grant.axes
            served.append(grant.program)
        slots = [grant.slot for grant in map(table.grant_of, holding) if grant is not None]
        assert len(set(slots)) == len(holding)
    while holding:
        name = next(iter(holding))
        del holding[name]
        for grant in table.release(name):
            holding[grant.program] = grant.axes
            served.append(grant.program)
    assert sorted(served) == sorted(asked)
