"""``mcctl zero X``: make the work coordinate system read zero, or any other number, where the axes are."""

from __future__ import annotations

import re
from typing import Annotated

import typer

from mcclient.cli.options import ConfigOption, ConnectOption, JsonOption, MachineOption
from mcclient.cli.send import send

_AXIS = re.compile(
    r"(?P<axis>[XYZABC]|\[[0-9]{1,2}\])(?:=?(?P<value>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)))?", re.I
)


def zero_line(axes: list[str], system: int) -> str:
    """Return the line of G-code that sets the system.

    Args:
        axes: such as ``X``, ``Y=5`` or ``[6]12.5``. system: 0: the one in force, else 1 … 9 for G54 … G59.3.

    Raises:
        typer.BadParameter: one of them is no axis, or stands twice.
    """
    words: dict[str, str] = {}
    for text in axes:
        found = _AXIS.fullmatch(text.strip())
        if found is None:
            raise typer.BadParameter(f"{text!r} is no axis: write X, Y=5 or [6]")
        axis = found["axis"].upper()
        if axis in words:
            raise typer.BadParameter(f"{axis} stands twice")
        words[axis] = found["value"] or "0"
    return f"G21 G90 G10 L20 P{system} " + " ".join(axis + value for axis, value in words.items())


def zero(
    axes: Annotated[
        list[str],
        typer.Argument(metavar="AXIS...", help="Axes by their words: X, or Y=5 to read 5 mm there."),
    ],
    system: Annotated[
        int, typer.Option("--system", min=0, max=9, help="1 to 9 for G54 to G59.3; 0: the one in force.")
    ] = 0,
    machine: MachineOption = None,
    connect: ConnectOption = None,
    zenoh: ConfigOption = None,
    json: JsonOption = False,
) -> None:
    """Set the work coordinate system where the axes are: mcctl zero X Y, mcctl zero Z=1.5. Nothing moves."""
    send([zero_line(axes, system)], machine=machine, connect=connect, zenoh=zenoh, json=json)
