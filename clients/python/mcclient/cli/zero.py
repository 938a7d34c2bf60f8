"""``mcctl zero X``: make the work coordinate system read zero, or any other number, where the axes are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated

import typer

from mcclient.cli.options import JsonOption, Target
from mcclient.cli.output import errors_shown
from mcclient.cli.send import send
from mcclient.errors import RequestRefused
from mcclient.machine import Machine
from mcclient.types import MachineStatus, ProbeStatus, WorkOffset
from mcclient.work_tables import SYSTEMS

_AXIS = re.compile(
    r"(?P<axis>[XYZABC]|\[[0-9]{1,2}\])(?:=?(?P<value>[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)))?", re.I
)
# an axis by its number, as of other commands
_NUMBER = re.compile(r"^([0-9]{1,2})(?==|$)")


def zero_line(axes: list[str], system: int) -> str:
    """Return the line of G-code that sets the system.

    Args:
        axes: such as ``X``, ``Y=5`` or ``[6]12.5``. system: 0: the one in force, else 1 … 9 for G54 … G59.3.

    Raises:
        typer.BadParameter: one of them is no axis, or stands twice.
    """
    words: dict[str, str] = {}
    for text in axes:
        found = _AXIS.fullmatch(_NUMBER.sub(r"[\1]", text.strip()))
        if found is None:
            raise typer.BadParameter(f"{text!r} is no axis: write X, Y=5 or 6=12.5")
        axis = found["axis"].upper()
        if axis in words:
            raise typer.BadParameter(f"{axis} stands twice")
        words[axis] = found["value"] or "0"
    return f"G21 G90 G10 L20 P{system} " + " ".join(axis + value for axis, value in words.items())


def probed_line(
    axes: list[str], system: int, probe: ProbeStatus | None, offsets: Sequence[WorkOffset] = ()
) -> str:
    """Return the line of G-code that lets the last probed place read zero, or the numbers given.

    Args:
        offsets: work coordinate systems that were set.

    Raises:
        RequestRefused: MC511 nothing was probed, an axis has no letter or number there, or the system is
            turned, so that an axis alone says nothing.
    """
    name = SYSTEMS[max(system, 1) - 1]
    if any(each.rotation for each in offsets if each.system == name):
        raise RequestRefused(
            "MC511",
            f"{name} is turned: what the probe met does not follow from one axis",
            f"go there and set it: mcctl zero, or end the rotation: G10 L2 P{max(system, 1)} R0",
        )
    if probe is None or not probe.tripped:
        raise RequestRefused("MC511", "the probe has met nothing", "probe first, such as: G38.2 Z-10 F100")
    words = []
    for word in zero_line(axes, system).split()[5:]:
        found = _AXIS.fullmatch(word)
        assert found is not None
        axis = found["axis"]
        number = axis.strip("[]") if axis.startswith("[") else str("XYZABC".index(axis))
        if number not in probe.positions:
            raise RequestRefused("MC511", f"the machine has no axis {axis}", "see mcctl status")
        words.append(f"{axis}{probe.positions[number] - float(found['value'] or 0):.6f}")
    return f"G21 G90 G10 L2 P{system} " + " ".join(words)


def zero(
    target: Target,
    axes: Annotated[
        list[str],
        typer.Argument(metavar="AXIS...", help="Axes by their words: X, or Y=5 to read 5 mm there."),
    ],
    system: Annotated[
        int, typer.Option("--system", min=0, max=9, help="1 to 9 for G54 to G59.3; 0: the one in force.")
    ] = 0,
    probe: Annotated[
        bool, typer.Option("--probe", help="Where the probe met the work (G38.2), not where the axes are.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Set the work coordinate system where the axes are: mcctl zero X Y, mcctl zero Z=1.5. Nothing moves."""
    line = zero_line(axes, system)

    async def look(one: Machine) -> MachineStatus | None:
        # it would wait for the axes, and set where they are when they come free
        found = await one.programs(ended=False)
        # at a pause the axes stand, and what waits for them waits on
        standing = ("paused", "queued") if any(each.state == "paused" for each in found) else ()
        for program in found:
            if program.state in standing:
                continue
            raise RequestRefused(
                "MC512",
                f"{program.program} of {program.client} is {program.state}: zero is set where the axes stand",
                "wait for its end, or abort it",
            )
        return await one.status() if probe else None

    found = target.carry_out(look, json)
    if found is not None:
        with errors_shown(json):
            line = probed_line(axes, system, found.probe, found.work_offsets)
    send(target, [line], at_pause=True, json=json)
