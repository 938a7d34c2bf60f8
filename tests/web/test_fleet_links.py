"""Connections to machines of a fleet: for known machines, released when nobody looks."""

from __future__ import annotations

import asyncio
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from mcclient import MotionError

from mcserver.web import fleet as fleets
from mcserver.web.fleet import MAX_LINKS, UNUSED_S, VISITOR_LINKS, Fleet, Seen


class FakeLink:
    """A connection that connects to nothing."""

    def __init__(self, name: str, *_: Any) -> None:
        self.name = name
        self.visitors: Counter[str] = Counter()
        self.used_at = 0.0
        self.closed = False

    @property
    def in_use(self) -> bool:
        return bool(self.visitors)

    async def close(self) -> None:
        self.closed = True


@pytest.fixture
def fleet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fleet:
    monkeypatch.setattr(fleets, "MachineLink", FakeLink)
    made = Fleet((), None, tmp_path)
    for number in range(500):
        made.machines[f"cell-{number}"] = Seen(f"cell-{number}")
    return made


async def test_names_that_nobody_has_seen_make_no_connection(fleet: Fleet) -> None:
    for number in range(1000):
        with pytest.raises(MotionError) as refused:
            fleet.link(f"nosuch-{number}", "eve")
        assert refused.value.code == "MC063"
    assert fleet.links == []
    assert fleet.link("cell-1", "alice").name == "cell-1"


async def test_a_fleet_of_500_is_opened_one_machine_after_the_other(fleet: Fleet) -> None:
    first = fleet.link("cell-0", "alice")
    for number in range(500):
        fleet.link(f"cell-{number}", "alice")
    await asyncio.sleep(0)
    assert len(fleet.links) == MAX_LINKS
    assert first.closed
    assert [link.name for link in fleet.links][-1] == "cell-499"


async def test_what_somebody_looks_at_stays_and_what_was_used_longest_ago_goes(fleet: Fleet) -> None:
    looked_at = fleet.link("cell-0", "alice")
    looked_at.visitors["alice"] += 1
    fleet.link("cell-1", "alice")
    fleet.link("cell-2", "alice")
    fleet.link("cell-1", "alice")
    for number in range(3, MAX_LINKS + 1):
        fleet.link(f"cell-{number}", "bob")
    names = [link.name for link in fleet.links]
    assert "cell-0" in names
    assert "cell-1" in names
    assert "cell-2" not in names


async def test_one_visitor_looks_at_so_many_machines_and_others_at_theirs(fleet: Fleet) -> None:
    for number in range(VISITOR_LINKS):
        fleet.link(f"cell-{number}", "eve").visitors["eve"] += 1
    with pytest.raises(MotionError) as refused:
        fleet.link("cell-99", "eve")
    assert refused.value.code == "MC063"
    # those that are open stay so for eve, and others open theirs
    fleet.link("cell-0", "eve")
    fleet.link("cell-99", "alice")


async def test_a_connection_that_nobody_looks_at_is_released(
    fleet: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = 1000.0
    monkeypatch.setattr(fleets.time, "monotonic", lambda: now)
    used, unused = fleet.link("cell-1", "alice"), fleet.link("cell-2", "alice")
    used.visitors["alice"] += 1
    now += UNUSED_S + 1.0
    fleet.release_unused()
    assert fleet.links == [used]
    monkeypatch.undo()
    await asyncio.sleep(0)
    assert unused.closed


async def test_machines_are_asked_for_groups_and_tags_once_a_start(fleet: Fleet) -> None:
    asked: list[str] = []

    class Asked:
        async def info(self, name: str) -> Any:
            asked.append(name)
            if name == "cell-1":
                raise MotionError("MC530", "nobody answers", "")
            return SimpleNamespace(group="hall", tags=["mill"])

    for name in ("cell-0", "cell-1"):
        fleet.machines[name].status = cast(Any, SimpleNamespace(instance="one"))
    for _ in range(2):
        await fleet._look_aside(cast(Any, Asked()))
    assert sorted(asked) == ["cell-0", "cell-1"]
    assert [(fleet.machines[name].group, fleet.machines[name].tags) for name in ("cell-0", "cell-1")] == [
        ("hall", ("mill",)),
        ("", ()),
    ]
