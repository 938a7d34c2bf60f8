"""The line that ``mcctl zero`` sends."""

from __future__ import annotations

import pytest
import typer
from mcclient.cli.home import pairs
from mcclient.cli.zero import probed_line, zero_line
from mcclient.errors import RequestRefused
from mcclient.types import ProbeStatus


@pytest.mark.parametrize(
    ("axes", "system", "line"),
    [
        (["X"], 0, "G21 G90 G10 L20 P0 X0"),
        (["x", "Y=5", "z-1.5"], 2, "G21 G90 G10 L20 P2 X0 Y5 Z-1.5"),
        (["[6]", "[7]=.5"], 9, "G21 G90 G10 L20 P9 [6]0 [7].5"),
        (["6", "12=-.5"], 0, "G21 G90 G10 L20 P0 [6]0 [12]-.5"),
    ],
)
def test_axes_become_the_words_of_g10(axes: list[str], system: int, line: str) -> None:
    assert zero_line(axes, system) == line


@pytest.mark.parametrize("axes", [["E"], ["X", "x=1"], ["X G1"], ["X=1e3"], [""], ["7="], ["123"]])
def test_what_is_no_axis_is_wrong_usage(axes: list[str]) -> None:
    with pytest.raises(typer.BadParameter):
        zero_line(axes, 0)


PROBED = ProbeStatus("p-1", 3, True, {"0": 12.5, "2": -3.2, "7": 90.0}, 1.0)


@pytest.mark.parametrize(
    ("axes", "system", "line"),
    [
        (["Z"], 0, "G21 G90 G10 L2 P0 Z-3.200000"),
        (["z=12.5"], 3, "G21 G90 G10 L2 P3 Z-15.700000"),
        (["X=-1", "[7]"], 1, "G21 G90 G10 L2 P1 X13.500000 [7]90.000000"),
    ],
)
def test_the_place_that_was_probed_becomes_the_origin(axes: list[str], system: int, line: str) -> None:
    assert probed_line(axes, system, PROBED) == line


@pytest.mark.parametrize("probe", [None, ProbeStatus("p-1", 3, False, {"2": 1.0}, 1.0)])
def test_without_contact_there_is_no_origin(probe: ProbeStatus | None) -> None:
    with pytest.raises(RequestRefused):
        probed_line(["Z"], 0, probe)


def test_an_axis_that_the_machine_lacks_is_refused() -> None:
    with pytest.raises(RequestRefused):
        probed_line(["Y"], 0, PROBED)


@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["X", "0"], {"X": 0.0}),
        (["X", "-7.5", "7", "1e1"], {"X": -7.5, "7": 10.0}),
        (["X=0", "Z=-1.5"], {"X": 0.0, "Z": -1.5}),
    ],
)
def test_a_reference_is_axes_and_positions(words: list[str], found: dict[str, float]) -> None:
    assert pairs(words) == found


@pytest.mark.parametrize("words", [["X"], ["X", "Y"], ["X", "0", "X", "1"], ["X", ""], ["X=1", "Y"]])
def test_words_that_are_no_reference_are_refused(words: list[str]) -> None:
    with pytest.raises(RequestRefused):
        pairs(words)
