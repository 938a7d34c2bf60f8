"""Values as operators read them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from mcclient import Diagnostic, MachineStatus, ProgramStatus
from mcclient.types import AxesStatus, Severity

import mcserver
from mcserver.web.formatting import (
    banner,
    channel_text,
    clock_text,
    current_program,
    diagnostics_html,
    page_hint,
    position_text,
    program_excerpt,
    remaining_text,
)
from tests.wire_values import wire_value


def status(state: str = "ready", *programs: ProgramStatus) -> MachineStatus:
    return wire_value(
        MachineStatus,
        t=0.0,
        wall=0.0,
        instance="i",
        state=state,
        axes=wire_value(AxesStatus),
        programs=programs,
    )


def program(name: str, state: str, opened_at: float = 0.0) -> ProgramStatus:
    return wire_value(ProgramStatus, name, state, opened_at=opened_at)


@pytest.mark.parametrize(
    ("seconds", "text"), [(None, "–"), (0.0, "0:00"), (65.2, "1:05"), (7384.0, "2:03:04"), (-3.0, "0:00")]
)
def test_times_read_as_clocks(seconds: float | None, text: str) -> None:
    assert clock_text(seconds) == text


@pytest.mark.parametrize(
    ("kind", "value", "unit", "text"),
    [
        ("digital", 1.0, "", "on"),
        ("digital", 0.0, "", "off"),
        ("analog", 2.5, "bar", "2.5 bar"),
        ("analog", 2.5, "", "2.5"),
    ],
)
def test_a_channel_is_on_or_off_or_a_number(kind: str, value: float, unit: str, text: str) -> None:
    assert channel_text(kind, value, unit) == text


def test_a_position_has_no_negative_zero() -> None:
    assert position_text(-0.0001) == "0.000"
    assert position_text(-0.01) == "-0.010"


def test_the_emergency_stop_is_shown_before_all_else() -> None:
    held = program("a", "held")
    assert banner(status("estop", held), online=True)[0] == "EMERGENCY STOP"
    assert banner(status("fault", held), online=True)[0] == "fault"
    assert banner(status("ready", held), online=True)[0] == "held"
    assert banner(status("estop"), online=False)[0] == "offline"
    assert banner(None, online=True)[0] == "offline"


def test_the_program_that_runs_is_shown_before_those_that_wait_or_have_ended() -> None:
    shown = current_program(
        status("ready", program("old", "finished", 9.0), program("q", "queued"), program("r", "held"))
    )
    assert shown is not None
    assert shown.program == "r"
    assert current_program(status()) is None


def test_a_program_cannot_put_markup_into_the_page() -> None:
    shown = program_excerpt(["(<script>alert(1)</script>)"], 1, {1: "<b>"})
    assert "<script>" not in shown
    assert "<b>" not in shown
    assert 'class="bad"' in shown


def test_the_time_left_is_a_lower_bound_where_only_what_is_planned_is_known() -> None:
    known = wire_value(ProgramStatus, "p", "running", eta_s=65.0, duration_s=100.0)
    assert remaining_text(known) == "1:05"
    assert remaining_text(wire_value(ProgramStatus, "p", "running", eta_s=65.0)) == "≥ 1:05"
    assert remaining_text(wire_value(ProgramStatus, "p", "running")) == "–"


def test_remedies_name_the_page_s_buttons_and_no_commands() -> None:
    assert page_hint("home them first: mcctl home X Y") == "home them first: press Home in the card Homing"
    assert page_hint("remove the cause, then mcctl reset") == "remove the cause, then press Reset"
    assert page_hint("set them back (mcctl zero), or run it") == (
        "set them back (use Zero or Set in the card Position), or run it"
    )
    assert page_hint("say so: mcctl tables T3 --used 0") == "say so: press Change a tool …"
    assert page_hint("jog there") == "jog there"
    assert page_hint("mcctl list shows who answers") == "the page of all machines shows who answers"
    assert page_hint("the bus (`mcctl drives` shows it)") == "the bus (the card Drives shows it)"
    assert page_hint("once it is clear, machine.continue_program('6b-4'), or mcctl continue") == (
        "once it is clear, press Continue"
    )
    assert page_hint("an operator arms it, once: mcctl arm") == (
        "an operator arms it, once: use the card Runs to arm"
    )
    assert page_hint("once it is clear, open another one with machine.program()") == (
        "once it is clear, run it again"
    )
    assert page_hint("once the server is back, mcctl programs tells how far it came") == (
        "once the server is back, the card of what was broken off tells how far it came"
    )


@pytest.mark.parametrize("layer", ["service", "executor", "net", "planning", "recorder"])
def test_no_remedy_of_the_server_is_a_command_on_the_page(layer: str) -> None:
    files = Path(mcserver.__file__).parent.joinpath(layer).rglob("*.py")
    said = [each for file in files for each in re.findall(r"mcctl [a-z].*", file.read_text("utf-8"))]
    assert [each for each in said if "mcctl" in page_hint(each)] == []


def test_warnings_alone_are_shown_as_warnings_and_with_a_fault_each_says_which_it_is() -> None:
    warning = Diagnostic("MC139", "nearly a circle", 2, hint="mcctl zero", severity=Severity.WARNING)
    fault = Diagnostic("MC104", "<b>", 3)
    alone = diagnostics_html((warning,))
    assert 'class="mc-warnings"' in alone
    assert "warning, line 2" in alone
    assert "use Zero or Set in the card Position" in alone
    both = diagnostics_html((warning, fault))
    assert 'class="mc-faults"' in both
    assert "<b>" not in both
    assert diagnostics_html(()) == ""
