"""The line that ``mcctl zero`` sends."""

from __future__ import annotations

import pytest
import typer
from mcclient.cli.zero import zero_line


@pytest.mark.parametrize(
    ("axes", "system", "line"),
    [
        (["X"], 0, "G21 G90 G10 L20 P0 X0"),
        (["x", "Y=5", "z-1.5"], 2, "G21 G90 G10 L20 P2 X0 Y5 Z-1.5"),
        (["[6]", "[7]=.5"], 9, "G21 G90 G10 L20 P9 [6]0 [7].5"),
    ],
)
def test_axes_become_the_words_of_g10(axes: list[str], system: int, line: str) -> None:
    assert zero_line(axes, system) == line


@pytest.mark.parametrize("axes", [["E"], ["X", "x=1"], ["X G1"], ["X=1e3"], [""]])
def test_what_is_no_axis_is_wrong_usage(axes: list[str]) -> None:
    with pytest.raises(typer.BadParameter):
        zero_line(axes, 0)
