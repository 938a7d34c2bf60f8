"""The operator's commands: ``hold resume step abort override jog reset estop``."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence
from typing import Annotated, Any

import typer

from mcclient.cli.jog_keys import from_terminal, jog_by_keys
from mcclient.cli.options import (
    JsonOption,
    ProgramOption,
    Target,
    axis_name,
    axis_of,
)
from mcclient.cli.output import carry_out, errors_shown, results, write_json
from mcclient.errors import RequestRefused
from mcclient.estop import emergency_stop
from mcclient.machine import Machine
from mcclient.transport import endpoints_of

# Between two looks whether a jog has ended [s].
JOG_LOOK_S = 0.05

AxesOption = Annotated[
    list[int] | None, typer.Option("--axis", "-a", metavar="N", help="One axis; repeatable. Default: all.")
]


def _order(
    target: Target,
    as_json: bool,
    act: Callable[[Machine], Awaitable[dict[str, Any]]],
    sentence: Callable[[str, dict[str, Any]], str],
) -> None:
    async def work(machine: Machine) -> tuple[str, dict[str, Any]]:
        return machine.name, await act(machine)

    name, outcome = target.carry_out(work, as_json)
    if as_json:
        write_json({"ok": True, "machine": name, **outcome})
    else:
        results().print(sentence(name, outcome))


def _order_programs(
    what: str, target: Target, as_json: bool, order: Callable[[Machine], Awaitable[Sequence[str]]]
) -> None:
    """Gives an order to programs; ``order`` returns those concerned, ``what`` is its word."""

    async def act(machine: Machine) -> dict[str, Any]:
        return {"programs": await order(machine)}

    def sentence(name: str, outcome: dict[str, Any]) -> str:
        programs = outcome["programs"]
        return f"{name}: {what} {', '.join(programs)}" if programs else f"{name}: no program to {what}"

    _order(target, as_json, act, sentence)


def hold(target: Target, program: ProgramOption = None, json: JsonOption = False) -> None:
    """Feed hold: stop along the path, ready to resume."""
    _order_programs("hold", target, json, lambda one: one.hold(program))


def resume(target: Target, program: ProgramOption = None, json: JsonOption = False) -> None:
    """End a hold, M00 or M01."""
    _order_programs("resume", target, json, lambda one: one.resume(program))


def abort(target: Target, program: ProgramOption = None, json: JsonOption = False) -> None:
    """Stop along the path and drop the rest of the program."""
    _order_programs("abort", target, json, lambda one: one.abort(program))


def override(
    target: Target,
    percent: Annotated[
        float, typer.Argument(min=0.0, max=200.0, help="100 is as programmed, 0 stands still.")
    ],
    program: ProgramOption = None,
    json: JsonOption = False,
) -> None:
    """Feed override in percent, of one program or of all, those to come included."""

    async def act(one: Machine) -> dict[str, Any]:
        return {"percent": (await one.override(percent, program)).percent}

    def sentence(name: str, outcome: dict[str, Any]) -> str:
        return f"{name}: override {outcome['percent']:g} %"

    _order(target, json, act, sentence)


def jog(
    target: Target,
    axis: Annotated[str, typer.Argument(metavar="AXIS", help="Its letter (X Y Z A B C) or number.")],
    distance: Annotated[
        float | None,
        typer.Argument(metavar="DISTANCE", help="From where it is, signed [mm, deg]."),
    ] = None,
    velocity: Annotated[
        float | None,
        typer.Option("--velocity", "-v", help="[mm/s, deg/s]; default: a tenth of the axis's limit."),
    ] = None,
    keys: Annotated[
        bool, typer.Option("--keys", help="Move while an arrow key, + or - is held down; q ends.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Move one axis by hand: mcctl jog X 5, mcctl jog 7 -0.5, mcctl jog Z --keys. Ctrl-C stops it."""

    async def act(one: Machine) -> dict[str, Any]:
        found = axis_of(axis, one.info)
        if keys:
            await jog_by_keys(one, found, velocity, from_terminal())
            return {"axis": found.index}
        axes = (await one.status()).axes
        homed = dict(zip(axes.index, axes.homed, strict=False)).get(found.index, True)
        program = await one.jog(found.index, distance, velocity=velocity)
        await _ended_jog(one, program)
        return {
            "program": program,
            "axis": found.index,
            "distance": distance,
            "unit": found.unit,
            # slower where it is not homed, by a key of the machine file that is not known here
            "velocity": None if velocity is None or not homed else min(abs(velocity), found.max_velocity),
            "homed": homed,
        }

    def sentence(name: str, outcome: dict[str, Any]) -> str:
        shown = axis_name(outcome["axis"])
        if keys:
            return f"{name}: axis {shown} stands"
        speed = "" if outcome["velocity"] is None else f" at {outcome['velocity']:g} {outcome['unit']}/s"
        move = f"{distance:g} {outcome['unit']}{speed}"
        # nothing but the operator's eyes keeps such an axis from its end
        caution = "" if outcome["homed"] else "; it is not homed: slowly, and without soft limits"
        return f"{name}: axis {shown} goes by {move} (program {outcome['program']}){caution}"

    with errors_shown(json):
        if keys is (distance is not None):
            raise RequestRefused(
                "MC511",
                "a jog needs either a distance or --keys",
                "such as: mcctl jog X 5, mcctl jog X --keys",
            )
    _order(target, json, act, sentence)


async def _ended_jog(one: Machine, program: str) -> None:
    """Wait for the end of a jog: with its client it would be stopped.

    Raises:
        RequestRefused: it was stopped, or failed.
    """
    while True:
        found = next((each for each in await one.programs() if each.program == program), None)
        if found is None or found.state == "finished":
            return
        if found.fault is not None:
            raise RequestRefused(found.fault.code, found.fault.message, found.fault.hint)
        if found.ended_at is not None:
            raise RequestRefused("MC506", f"the jog was stopped: {found.state}", "see mcctl status")
        await asyncio.sleep(JOG_LOOK_S)


def reset(target: Target, axes: AxesOption = None, json: JsonOption = False) -> None:
    """Clear a latched fault or emergency stop; axes stay without energy until captured (G1010)."""

    async def act(one: Machine) -> dict[str, Any]:
        await one.reset(axes)
        return {}

    _order(target, json, act, lambda name, _: f"{name}: reset")


def estop(
    target: Target,
    reason: Annotated[str, typer.Option("--reason", help="Why, for the record.")] = "mcctl",
    json: JsonOption = False,
) -> None:
    """Emergency stop of every axis, until reset. No safety function: use the machine's own circuit too."""

    async def work() -> str:
        return await emergency_stop(
            target.machine,
            endpoints_of(target.connect),
            client="mcctl",
            reason=reason,
            config_file=target.config_file,
        )

    name = carry_out(work, json)
    if json:
        write_json({"ok": True, "machine": name, "state": "estop"})
    else:
        results().print(f"{name}: emergency stop, latched; mcctl reset clears it")
