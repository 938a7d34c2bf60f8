"""Leases: whole, in order, side by side where disjoint."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mcserver.service.leases import Grant, LeaseTable


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
    assert [grant.program for grant in table.release("a", planned=False)] == ["b"]
    assert [grant.program for grant in table.release("b", planned=False)] == ["c"]


def test_who_gives_up_waiting_lets_those_behind_pass() -> None:
    table = LeaseTable()
    table.request("a", [0])
    table.request("b", [0, 1])
    table.request("c", [1])
    assert [grant.program for grant in table.release("b", planned=False)] == ["c"]


def test_programs_beyond_the_slots_wait() -> None:
    table = LeaseTable(slots=2)
    table.request("a", [0])
    table.request("b", [1])
    assert table.request("c", [2]) == []
    (grant,) = table.release("a", planned=False)
    assert (grant.program, grant.slot) == ("c", 0)


@pytest.mark.parametrize("axes", [[], [0]])
def test_asking_twice_or_for_nothing_is_a_mistake(axes: list[int]) -> None:
    table = LeaseTable()
    if axes:
        table.request("a", axes)
    with pytest.raises(ValueError, match=r"axis|axes"):
        table.request("a", axes)


def test_a_slot_is_nobodys_until_the_planner_has_forgotten_who_had_it() -> None:
    table = LeaseTable(slots=2)
    table.request("a", [0])
    assert table.release("a", planned=True) == []
    # its axes are free
    (grant,) = table.request("b", [0])
    assert (grant.program, grant.slot) == ("b", 1)
    assert table.request("c", [1]) == []
    (grant,) = table.forgotten("a")
    assert (grant.program, grant.slot) == ("c", 0)
    # heard of twice, and of one that never had a slot
    assert table.forgotten("a") == table.forgotten("d") == []


def test_a_planner_that_has_died_has_forgotten_all() -> None:
    table = LeaseTable(slots=2)
    for name, axis in (("a", 0), ("b", 1)):
        table.request(name, [axis])
        table.release(name, planned=True)
    assert table.request("c", [0]) == []
    assert table.request("d", [1]) == []
    assert [(grant.program, grant.slot) for grant in table.forgotten(None)] == [("c", 0), ("d", 1)]


@settings(max_examples=60)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(["request", "release", "forgotten"]), st.frozensets(st.integers(0, 5), min_size=1)
        ),
        max_size=40,
    )
)
def test_leases_never_overlap_and_everyone_is_served_at_last(
    steps: list[tuple[str, frozenset[int]]],
) -> None:
    table = LeaseTable(slots=3)
    holding: dict[str, Grant] = {}
    left: dict[str, int] = {}
    asked: list[str] = []
    served: list[str] = []

    def release() -> list[Grant]:
        name = next(iter(holding))
        left[name] = holding.pop(name).slot
        return table.release(name, planned=True)

    def forget() -> list[Grant]:
        name = next(iter(left))
        del left[name]
        return table.forgotten(name)

    def take(grants: list[Grant]) -> None:
        for grant in grants:
            assert not any(grant.axes & other.axes for other in holding.values())
            assert grant.slot not in [*left.values(), *(other.slot for other in holding.values())]
            holding[grant.program] = grant
            served.append(grant.program)

    for number, (step, axes) in enumerate(steps):
        if step == "release" and holding:
            take(release())
        elif step == "forgotten" and left:
            take(forget())
        else:
            asked.append(f"p{number}")
            take(table.request(f"p{number}", axes))
    while holding or left:
        take(release() if holding else forget())
    assert sorted(served) == sorted(asked)


def test_what_is_lent_at_a_pause_is_for_what_is_done_by_hand_and_not_for_those_that_wait() -> None:
    table = LeaseTable()
    table.request("a", [0, 1])
    table.request("b", [0])
    table.lend("a", [0])
    assert table.request("c", [0]) == []
    assert [grant.program for grant in table.request("jog", [0], at_pause=True)] == ["jog"]
    assert table.request("other", [1], at_pause=True) == []
    assert table.request("step", [0], at_pause=True) == []
    assert (table.holder(0), table.holder(1), table.borrower("a")) == ("jog", "a", "jog")
    assert [grant.program for grant in table.release("jog", planned=False)] == ["step"]
    table.release("other", planned=False)
    assert table.release("step", planned=False) == []
    assert (table.borrower("a"), table.holder(0), table.holder(0, at_pause=True)) == (None, "a", None)
    table.take_back("a")
    assert table.request("late", [0], at_pause=True) == []


def test_who_ends_at_a_pause_leaves_its_axes_to_whoever_has_them_by_hand() -> None:
    table = LeaseTable()
    table.request("a", [0])
    table.request("b", [0])
    table.lend("a", [0])
    table.request("jog", [0], at_pause=True)
    assert table.release("a", planned=False) == []
    assert [grant.program for grant in table.release("jog", planned=False)] == ["b"]
