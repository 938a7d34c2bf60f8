"""Commands that look: ``list status programs``."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from mcclient.cli.options import LOOK_S, ConfigOption, ConnectOption, JsonOption, Target
from mcclient.cli.output import carry_out, error_as_json, fail, results, say, write_json
from mcclient.cli.tables import axes_text, machine_view, plain_table, programs_table
from mcclient.discovery import list_machines
from mcclient.errors import MotionError, NobodyAnswers
from mcclient.machine import Machine
from mcclient.types import Info, MachineStatus


def list_(connect: ConnectOption = None, zenoh: ConfigOption = None, json: JsonOption = False) -> None:
    """The machines that are there."""

    async def work() -> list[tuple[str, Info | MotionError]]:
        return await list_machines(connect or None, timeout_s=LOOK_S, config_file=zenoh)

    found = carry_out(work, json)
    if not found:
        if json:
            write_json([])
        nobody = NobodyAnswers("MC530", "the network is reached, but no machine", "start one: mcserver run")
        fail(nobody, as_json=False)
    if json:
        write_json([_machine_as_json(name, info) for name, info in found])
        return
    table = plain_table("machine", "axes", "tools", "cycle", "server")
    for name, info in found:
        if isinstance(info, MotionError):
            table.add_row(name, "", "", "", f"does not answer ({info.code})")
            continue
        tools = ",".join(f"T{tool.number}" for tool in info.tools)
        axes = axes_text([axis.index for axis in info.axes])
        table.add_row(name, axes, tools or "none", f"{1.0 / info.cycle_s:g} Hz", info.server)
    results().print(table)


def _machine_as_json(name: str, info: Info | MotionError) -> dict[str, Any]:
    if isinstance(info, MotionError):
        return {"machine": name, **error_as_json(info)}
    return {
        "machine": name,
        "ok": True,
        "server": info.server,
        "instance": info.instance,
        "axes": [axis.index for axis in info.axes],
        "tools": [tool.number for tool in info.tools],
        "cycle_s": info.cycle_s,
    }


def status(target: Target, json: JsonOption = False) -> None:
    """The machine's state now: axes, programs, faults."""

    async def work(one: Machine) -> tuple[str, Info, MachineStatus]:
        return one.name, one.info, await one.status()

    name, info, state = target.carry_out(work, json)
    if json:
        write_json(state)
    else:
        results().print(machine_view(name, info, state))


def programs(
    target: Target,
    running: Annotated[bool, typer.Option("--running", help="Only those that have not ended.")] = False,
    limit: Annotated[int, typer.Option("--limit", "-n", min=1, max=1000, help="How many.")] = 20,
    json: JsonOption = False,
) -> None:
    """Programs running, queued, ended and interrupted, the newest first."""

    found = target.carry_out(lambda one: one.programs(ended=not running, limit=limit), json)
    if json:
        write_json(found)
    elif found:
        results().print(programs_table(found))
    else:
        say("no programs")
