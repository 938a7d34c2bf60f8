"""``mcctl io``: what is shown, and what a value on the command line means."""

from __future__ import annotations

import io
import math

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st
from mcclient.cli.io import channels_view, read_level
from mcclient.types import (
    AxesStatus,
    Info,
    InputInfo,
    InputStatus,
    MachineStatus,
    OutputInfo,
    OutputStatus,
)
from rich.console import Console

from tests.wire_values import wire_value

INPUTS = (
    InputInfo("door", 1, "digital", hold=True, source="can0 node 5 6000h:01 bit 3"),
    InputInfo("air", 0, "analog", "bar", stop=True),
)
OUTPUTS = (OutputInfo("lamp [red]", 0, "digital"), OutputInfo("power", 0, "analog", "W"))


def shown(
    info: tuple[tuple[InputInfo, ...], tuple[OutputInfo, ...]],
    inputs: tuple[InputStatus, ...] = (),
    outputs: tuple[OutputStatus, ...] = (),
) -> list[list[str]]:
    described = wire_value(Info, "m", "0", (1,), "i", 0.0, 1e-3, inputs=info[0], outputs=info[1])
    status = wire_value(
        MachineStatus, 0.0, 0.0, "i", "ready", wire_value(AxesStatus), inputs=inputs, outputs=outputs
    )
    text = io.StringIO()
    Console(file=text, width=120).print(channels_view(described, status))
    return [line.split() for line in text.getvalue().splitlines()]


def test_each_input_and_output_has_a_row() -> None:
    rows = shown(
        (INPUTS, OUTPUTS),
        (InputStatus("door", 1.0, holds=True), InputStatus("air", 3.5, stops=True)),
        (OutputStatus("lamp [red]", 0.0, "operator"), OutputStatus("power", 42.5)),
    )
    assert rows == [
        ["input", "number", "value", "state", "where"],
        ["door", "P1", "on", "holds", "the", "programs", "can0", "node", "5", "6000h:01", "bit", "3"],
        ["air", "E0", "3.5", "bar", "stops", "the", "machine", "simulated"],
        ["output", "number", "value", "set", "by", "where"],
        ["lamp", "[red]", "P0", "off", "operator", "simulated"],
        ["power", "E0", "42.5", "W", "–", "simulated"],
    ]


def test_a_machine_without_any_says_so() -> None:
    assert " ".join(shown(((), ()))[0]) == "this machine has no inputs and no outputs"


@pytest.mark.parametrize(
    ("word", "value"),
    [("on", True), ("OFF", False), ("true", True), ("1", 1.0), ("-2.5", -2.5), (" 7 ", 7.0)],
)
def test_a_value_is_on_off_or_a_number(word: str, value: bool | float) -> None:
    found = read_level(word)
    assert found == value
    assert type(found) is type(value)


@given(st.text(max_size=8))
def test_any_other_word_is_a_usage_error(word: str) -> None:
    try:
        assert isinstance(read_level(word), bool | float)
    except typer.BadParameter:
        assert word.strip().lower() not in ("on", "off", "true", "false")


def test_what_is_no_finite_number_is_left_to_the_server_to_refuse() -> None:
    assert math.isnan(float(read_level("nan")))
