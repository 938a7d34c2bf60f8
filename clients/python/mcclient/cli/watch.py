"""``mcctl watch``: the machine, live."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Annotated

import typer
from rich.console import RenderableType
from rich.live import Live

from mcclient.cli.options import JsonOption, Target
from mcclient.cli.output import results, write_json
from mcclient.cli.tables import machine_view
from mcclient.cli.terminal import TerminalConsole
from mcclient.machine import Machine
from mcclient.types import MachineStatus

REFRESH_HZ = 10
PLAIN_S = 1.0
# headline, table heads, programs and faults beside the axes
OTHER_ROWS = 10


def watch(
    target: Target,
    once: Annotated[bool, typer.Option("--once", help="Show one state and leave.")] = False,
    json: JsonOption = False,
) -> None:
    """Axes, programs and faults, live; Ctrl-C leaves. With --json one line a state."""

    async def work(one: Machine) -> None:
        if once:
            _show_once(one, await one.status(), json)
        elif json:
            async for status in one.telemetry():
                write_json(status)
        elif results().is_terminal:
            await _live(one)
        else:
            await _plain(one)

    with contextlib.suppress(KeyboardInterrupt):
        target.carry_out(work, json)


def _show_once(machine: Machine, status: MachineStatus, as_json: bool) -> None:
    if as_json:
        write_json(status)
    else:
        results().print(machine_view(machine.name, machine.info, status))


async def _live(machine: Machine) -> None:
    console = TerminalConsole()
    status = await machine.status()

    def view() -> RenderableType:
        rows = max(3, console.height - OTHER_ROWS - len(status.tools))
        return machine_view(machine.name, machine.info, status, online=machine.online, rows=rows)

    with Live(view(), console=console, screen=True, auto_refresh=False) as live:

        async def follow() -> None:
            nonlocal status
            async for newest in machine.telemetry():
                status = newest

        following = asyncio.create_task(follow())
        try:
            while True:
                live.update(view(), refresh=True)
                await asyncio.sleep(1.0 / REFRESH_HZ)
        finally:
            following.cancel()


async def _plain(machine: Machine) -> None:
    """One line a second, for pipes and files."""
    shown_at = float("-inf")
    async for status in machine.telemetry():
        if status.t - shown_at < PLAIN_S and status.t >= shown_at:
            continue
        shown_at = status.t
        positions = " ".join(f"{position:.3f}" for position in status.axes.position)
        tools = " ".join(
            f"T{tool.number}:" + ",".join(f"{value:.3f}" for value in (*tool.position, *tool.orientation))
            for tool in status.tools
        )
        programs = " ".join(f"{each.program}:{each.state}:{each.line}" for each in status.programs)
        said = (f"{status.t:.1f}", status.state, positions, tools, programs)
        results().print(" ".join(word for word in said if word))
