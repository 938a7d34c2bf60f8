"""A start in the middle as the page shows it."""

from __future__ import annotations

import pytest
from mcclient.broken_off import broken_off
from mcclient.types import AxisStart, Continuation, Need, ProgramStatus, Switched, WayStep

from mcserver.web.jobs import Middle
from mcserver.web.panels.run_from import answers_to, continuation_html
from tests.wire_values import wire_value

WAY = Need("MC592", "X stands elsewhere", "jog there", "way")
OUTPUTS = Need("MC593", "the program had switched coolant", "say", "outputs")
LOST = Need("MC450", "axes that do not know where they are: X", "home them first: mcctl home X")


def test_where_the_axes_are_and_the_way_between_is_shown() -> None:
    shown = wire_value(
        Continuation,
        state=None,
        sha256=None,
        modal=("G21", "G90"),
        energize=(0, 2),
        axes=(AxisStart(0, "mm", 0.0, 120.0, True, True), AxisStart(2, "mm", 1.0, None, True, True)),
        way=(WayStep("lift: Z to <50> mm"),),
        switched=(Switched("coolant", 1.0, 0.0),),
        needs=(WAY, LOST),
    )
    page = continuation_html(shown)
    assert "<td>X</td><td class=n>0.000</td><td class=n>120.000</td><td>elsewhere</td>" in page
    assert "<td>Z</td><td class=n>1.000</td><td class=n>not known</td>" in page
    assert "<li>energize X, Z</li><li>lift: Z to &lt;50&gt; mm</li>" in page
    assert page.count("mc-warnings") == 1
    assert page.count("mc-faults") == 1


def test_each_answer_has_a_button_and_what_cannot_be_confirmed_has_none() -> None:
    middle = Middle("p-1")
    assert answers_to(set(), "Go on", middle) == [("Go on", middle)]
    assert answers_to({"way"}, "Go on", middle) == [("Take this way: go on", middle._replace(way=True))]
    labels = [label for label, _ in answers_to({"way", "outputs"}, "Go on", middle)]
    assert labels == ["Switch them on: take this way: go on", "Leave them: take this way: go on"]
    assert answers_to({"", "way"}, "Go on", middle) == []


def ran(name: str, state: str, opened: float, done: int = 3, line: int = 4) -> ProgramStatus:
    return wire_value(
        ProgramStatus, name, state, name=name, accepted=9, done=done, line=line, opened_at=opened
    )


def test_the_newest_program_that_was_broken_off_can_go_on_unless_something_runs() -> None:
    part = ran("part.nc", "interrupted", 1.0)
    assert broken_off([ran("jog axis 0", "finished", 2.0, 9), part]) == part
    assert broken_off([ran("next.nc", "finished", 2.0, 9), part]) is None
    assert broken_off([ran("next.nc", "running", 2.0), part]) is None
    assert broken_off([ran("queued.nc", "faulted", 2.0, 0, 0), part]) == part
    assert broken_off([ran("part.nc", "interrupted", 1.0, 9)], lines_left=True) is None
    assert broken_off([ran("part.nc", "finished", 1.0, 9)]) is None


@pytest.mark.parametrize(
    "name", ["manual input by ada", "manual input", "mcctl send", "work offset", "energize", "jog axis 1"]
)
def test_what_moves_axes_by_hand_is_no_program_to_go_on_with(name: str) -> None:
    part = ran("part.nc", "interrupted", 1.0)
    assert broken_off([ran(name, "faulted", 2.0), part]) == part


@pytest.mark.parametrize("name", ["linear.nc", "zero-point.nc", "energized.nc"])
def test_a_file_may_be_named_like_a_move_by_hand(name: str) -> None:
    last = ran(name, "interrupted", 2.0)
    assert broken_off([last, ran("part.nc", "finished", 1.0)]) == last
