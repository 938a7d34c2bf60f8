"""What a page says to who does not look at it: ends, pauses, alarms, and what is old."""

from __future__ import annotations

import dataclasses

import pytest
from mcclient import Fault, MachineStatus
from mcclient.types import AxesStatus, DiskStatus, ProgramStatus

from mcserver.web.announcements import Announcer, title_of
from mcserver.web.panels.notices import notices_of
from tests.wire_values import wire_value

AXES = wire_value(
    AxesStatus,
    index=(0, 1),
    position=(0.0, 5.0),
    setpoint=(0.0, 5.0),
    velocity=(0.0, 0.0),
    torque=(0.0, 0.0),
    state=("standstill", "off"),
)


def state(*programs: ProgramStatus, faults: tuple[Fault, ...] = ()) -> MachineStatus:
    return wire_value(
        MachineStatus,
        t=1.0,
        wall=0.0,
        instance="i",
        state="ready",
        axes=AXES,
        programs=programs,
        faults=faults,
    )


def part(
    word: str, *, lasted: float | None = None, notice: str = "", fault: Fault | None = None
) -> ProgramStatus:
    ended = None if lasted is None else 100.0 + lasted
    return wire_value(
        ProgramStatus,
        "p-1",
        word,
        name="part.gcode",
        opened_at=100.0,
        ended_at=ended,
        notice=notice,
        line=7,
        fault=fault,
    )


def test_the_end_of_a_job_is_announced_once() -> None:
    announcer = Announcer("cell-1")
    assert announcer.update(state(part("running")), {"p-1"}) == []
    (said,) = announcer.update(state(part("finished", lasted=3.0)), {"p-1"})
    assert said == ("positive", "cell-1: part.gcode", "part.gcode is finished after 0:03", False)
    assert announcer.update(state(part("finished", lasted=3.0)), {"p-1"}) == []


@pytest.mark.parametrize(("lasted", "said"), [(2.0, 0), (65.0, 1)])
def test_of_others_programs_only_long_ones_are_announced(lasted: float, said: int) -> None:
    announcer = Announcer("cell-1")
    announcer.update(state(part("running")), ())
    assert len(announcer.update(state(part("finished", lasted=lasted)), ())) == said


def test_what_ended_before_the_page_was_opened_is_not_announced() -> None:
    old = Fault("MC400", "emergency stop", "reset")
    announcer = Announcer("cell-1")
    assert announcer.update(state(part("faulted", lasted=65.0), faults=(old,)), ()) == []


def test_an_alarm_and_the_program_that_it_ends_are_announced() -> None:
    fault = Fault("MC421", "axis X does not follow", "look at it", axis=0)
    announcer = Announcer("cell-1")
    announcer.update(state(part("running")), ())
    ended, alarm = announcer.update(state(part("faulted", lasted=65.0, fault=fault), faults=(fault,)), ())
    assert (ended.kind, alarm.kind) == ("negative", "negative")
    assert "MC421" in ended.text
    assert alarm == ("negative", "cell-1: alarm", "axis X does not follow [MC421]", True)
    # latched, and cleared: nothing new
    assert announcer.update(state(faults=(fault,)), ()) == []
    assert announcer.update(state(), ()) == []


def test_a_pause_says_what_the_program_asks_for() -> None:
    announcer = Announcer("cell-1")
    announcer.update(state(part("running")), ())
    (said,) = announcer.update(state(part("paused", notice="fit tool 3")), ())
    assert said == ("positive", "cell-1: part.gcode waits", "fit tool 3", False)
    ((kind, text),) = notices_of(state(part("paused", notice="fit tool 3")), online=True, failure="")
    assert kind == "mc-notice"
    assert text == "part.gcode waits at line 7: fit tool 3. Then press Resume."


def test_what_a_running_program_says_is_a_note_and_an_ended_one_says_nothing() -> None:
    ((kind, text),) = notices_of(state(part("running", notice="roughing")), online=True, failure="")
    assert (kind, text) == ("mc-note", "part.gcode: roughing")
    assert notices_of(state(part("finished", lasted=1.0, notice="roughing")), online=True, failure="") == ()


def test_a_slow_disk_is_said_with_the_time_since_when_it_is() -> None:
    slow = dataclasses.replace(state(), disk=DiskStatus(since=3661.0, commit_s=2.0, sync_s=0.0, worst_s=2.0))
    ((kind, text),) = notices_of(slow, online=True, failure="")
    assert kind == "mc-note"
    assert "01:01:01 UTC" in text
    assert "MC524" in text


@pytest.mark.parametrize(
    ("status", "end"),
    [(None, "It has not been seen yet."), (state(part("running")), "What is shown is old.")],
)
def test_a_machine_that_is_away_says_why_and_what_is_shown_then(
    status: MachineStatus | None, end: str
) -> None:
    ((kind, text),) = notices_of(status, online=False, failure="no server answers")
    assert kind == "mc-faults"
    assert text == f"The machine does not answer: no server answers. {end}"


def test_a_tab_says_how_far_a_program_is_and_else_what_is_wrong() -> None:
    running = wire_value(ProgramStatus, "p-1", "running", progress=0.434)
    assert title_of("cell-1", "running", running) == "43 % running · cell-1"
    assert title_of("cell-1", "ready", wire_value(ProgramStatus, "p-1", "finished", progress=1.0)) == "cell-1"
    assert title_of("cell-1", "EMERGENCY STOP", None) == "EMERGENCY STOP · cell-1"
