"""``mcserver simulate --input``: values of inputs over time."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mcserver.errors import UsageFault
from mcserver.machine.io_section import ScriptedValue
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.simulation.input_script import with_inputs
from mcserver.simulation.simulation import Simulation, simulate
from tests.machine_text import axes_text


def machine() -> Machine:
    return parse_machine(
        f'[machine]\nname = "m"\n{axes_text()}'
        '[[bus]]\nname = "can0"\n'
        '[[input]]\nnumber = 3\nname = "front door"\nsimulated = [{ at_s = 1.0, value = true }]\n'
        '[[input]]\nnumber = 3\nname = "air"\nkind = "analog"\n'
        '[[input]]\nnumber = 4\nname = "real"\n'
        'source = { bus = "can0", node = 5, object = "6000h", bit = 0 }\n'
    )


def test_entries_join_the_script_of_the_file_in_order_of_time() -> None:
    door, real, air = with_inputs(machine(), ["front door=off@0.5", "3=on@2s", "air=-4.5"]).inputs
    assert door.script == (ScriptedValue(0.5, 0.0), ScriptedValue(1.0, 1.0), ScriptedValue(2.0, 1.0))
    assert air.script == (ScriptedValue(0.0, -4.5),)
    assert real.source is not None


def test_a_real_input_is_simulated_where_it_is_given() -> None:
    _, real, _ = with_inputs(machine(), ["real=on@1"]).inputs
    assert real.source is None


@pytest.mark.parametrize(
    "entry",
    [
        "",
        "door",
        "nothing=on",
        "front door=2",
        "front door=",
        "=on",
        "air=nan",
        "air=1@-1",
        "air=1@x",
        "5=on",
    ],
)
def test_what_cannot_be_meant_is_refused(entry: str) -> None:
    with pytest.raises(UsageFault, match=r"input|value|number|time") as caught:
        with_inputs(machine(), [entry])
    assert caught.value.code == "MC029"


@given(st.text("frontdair3=@.on- ", max_size=16))
def test_any_text_is_an_entry_or_a_usage_fault(text: str) -> None:
    with contextlib.suppress(UsageFault):
        with_inputs(machine(), [text])


def guarded(*entries: str) -> Simulation:
    """Return a run of a second along an axis, behind a door that holds while it is open."""
    described = parse_machine(
        f'[machine]\nname = "m"\n{axes_text()}[[input]]\nnumber = 1\nname = "door"\nhold_on = true\n'
    )
    return simulate("G1010\nG94 F600\nG01 X10", with_inputs(described, entries))


def test_a_program_that_an_input_holds_goes_on_when_it_no_longer_does() -> None:
    alone, held = guarded().report, guarded("door=on@0.5", "door=off@2").report
    assert held["ok"]
    assert held["axes"]["0"]["position"] == pytest.approx(10.0, abs=0.01)
    assert held["duration_s"] == pytest.approx(alone["duration_s"] + 1.5, abs=0.2)
    assert [each["code"] for each in held["diagnostics"]] == ["MC441", "MC447"]


def test_a_program_that_an_input_holds_for_good_ends_with_its_line() -> None:
    held = guarded("door=on@0.5")
    (fault,) = (each for each in held.report["diagnostics"] if each["severity"] == "error")
    assert (held.exit_code, fault["code"], fault["line"]) == (1, "MC441", 3)
    assert 'held for good by: "door"' in fault["message"]
