"""``mcctl home X`` and ``mcctl reference X 0``: where the axes are."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import typer

from mcclient.cli.options import (
    JsonOption,
    Target,
    axis_name,
    axis_of,
)
from mcclient.cli.output import carry_out, results, say, write_json
from mcclient.errors import MotionError, RequestRefused
from mcclient.machine import Machine
from mcclient.types import Event, Info, MachineStatus


def home(
    target: Target,
    axes: Annotated[
        list[str] | None, typer.Argument(metavar="[AXIS]...", help="Letters (X Y Z A B C) or numbers.")
    ] = None,
    all_: Annotated[bool, typer.Option("--all", help="Every axis that can find its reference.")] = False,
    json: JsonOption = False,
) -> None:
    """Let axes find their references: mcctl home X Y, mcctl home --all. Ctrl-C stops them."""

    async def work() -> tuple[str, dict[str, Any]]:
        if bool(axes) is all_:
            raise RequestRefused("MC511", "either axes or --all", "such as: mcctl home X, mcctl home --all")
        async with target.open() as one:
            chosen = None if all_ else [axis_of(text, one.info).index for text in axes or ()]
            program, homed = await _home(one, chosen, narrate=not json)
            return one.name, {"program": program, **_positions(homed, one.info, await one.status())}

    name, outcome = carry_out(work, json)
    _tell(name, outcome, json)


async def _home(machine: Machine, axes: list[int] | None, *, narrate: bool) -> tuple[str, list[int]]:
    """Home axes to their end; their numbers in the order in which they were homed."""
    events = machine.events()
    program = (await machine.home(axes)).program
    homed: list[int] = []
    try:
        async for event in events:
            if event.program != program:
                continue
            if event.kind == "axis.homed" and event.axis is not None:
                homed.append(event.axis)
            if narrate:
                _narrate(event)
            if event.kind == "program.ended":
                _check_ended(event)
                return program, homed
    except asyncio.CancelledError:
        await machine.abort(program)
        raise
    raise MotionError("MC534", "the connection ended while axes were homed", "see mcctl status")


def _narrate(event: Event) -> None:
    if event.axis is None:
        return
    name = axis_name(event.axis)
    if event.kind == "axis.homing" and event.message != "done":
        say(f"{name}: {event.message}")
    elif event.kind == "axis.homed":
        say(f"{name}: homed", "green")


def _check_ended(event: Event) -> None:
    if event.fault is not None:
        raise MotionError(event.fault.code, event.fault.message, event.fault.hint)
    if event.state != "finished":
        raise MotionError("MC506", f"homing was stopped: {event.reason or event.state}", "home again")


def reference(
    target: Target,
    words: Annotated[
        list[str], typer.Argument(metavar="AXIS POSITION...", help="Such as X 0, or X=0 Y=12.5 [mm, deg].")
    ],
    json: JsonOption = False,
) -> None:
    """Say where axes are: mcctl reference X 0, mcctl reference Z=-12.5. Nothing moves."""

    async def work() -> tuple[str, dict[str, Any]]:
        given = pairs(words)
        async with target.open() as one:
            positions = {axis_of(axis, one.info).index: value for axis, value in given.items()}
            await one.reference(positions)
            return one.name, _positions(list(positions), one.info, await one.status())

    name, outcome = carry_out(work, json)
    _tell(name, outcome, json)


def pairs(words: list[str]) -> dict[str, float]:
    """Axes and positions of a command line: ``X 0`` or ``X=0``, any number of them.

    Raises:
        RequestRefused: MC511 they are none.
    """
    parts = [part for word in words for part in word.split("=", 1)]
    found: dict[str, float] = {}
    for axis, value in zip(parts[::2], parts[1::2], strict=False):
        if axis in found:
            raise RequestRefused("MC511", f"{axis} stands twice", "give each axis one position")
        try:
            found[axis] = float(value)
        except ValueError:
            raise RequestRefused(
                "MC511", f"{value!r} is no position", "such as: mcctl reference X 0 Y 12.5"
            ) from None
    if len(parts) % 2 or not parts:
        raise RequestRefused("MC511", "an axis has no position", "such as: mcctl reference X 0 Y 12.5")
    return found


def _positions(axes: list[int], info: Info, status: MachineStatus) -> dict[str, Any]:
    units = {axis.index: axis.unit for axis in info.axes}
    place = {axis: status.axes.position[at] for at, axis in enumerate(status.axes.index)}
    return {"axes": [{"axis": axis, "position": place[axis], "unit": units[axis]} for axis in axes]}


def _tell(name: str, outcome: dict[str, Any], as_json: bool) -> None:
    if as_json:
        write_json({"ok": True, "machine": name, **outcome})
        return
    shown = ", ".join(
        f"{axis_name(each['axis'])} at {each['position']:.3f} {each['unit']}" for each in outcome["axes"]
    )
    results().print(f"{name}: homed {shown}")
