"""``mcctl io``: inputs and outputs, live, and set by name."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Annotated

import typer
from rich.console import Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from mcclient.cli.options import JsonOption, Target, with_target
from mcclient.cli.output import results, write_json
from mcclient.cli.tables import plain_table
from mcclient.cli.terminal import TerminalConsole
from mcclient.machine import Machine
from mcclient.types import Info, InputInfo, MachineStatus, OutputInfo

REFRESH_HZ = 10
_LEVELS = {"on": True, "off": False, "true": True, "false": False}


def build_app() -> typer.Typer:
    """Return the command tree below ``mcctl io``."""
    app = typer.Typer(
        help="Inputs and outputs: a table, or set one by name.",
        invoke_without_command=True,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback()(with_target(show))
    # a value may be negative: such words are no options
    app.command("set", context_settings={"ignore_unknown_options": True})(with_target(set_))
    return app


def show(
    target: Target,
    context: typer.Context,
    watch: Annotated[bool, typer.Option("--watch", "-w", help="Live; Ctrl-C leaves.")] = False,
    json: JsonOption = False,
) -> None:
    """Inputs and outputs: a table, or set one by name."""
    if context.invoked_subcommand is not None:
        return

    async def work(one: Machine) -> None:
        status = await one.status()
        if json:
            write_json(_as_json(status))
            if watch:
                async for status in one.telemetry():
                    write_json(_as_json(status))
        elif watch and results().is_terminal:
            await _live(one, status)
        else:
            results().print(channels_view(one.info, status))

    with contextlib.suppress(KeyboardInterrupt):
        target.carry_out(work, json)


def set_(
    target: Target,
    name: Annotated[str, typer.Argument(metavar="NAME", help="Of an output, or of a simulated input.")],
    value: Annotated[str, typer.Argument(metavar="VALUE", help="on, off, or a number in its unit.")],
    json: JsonOption = False,
) -> None:
    """Set an output, or a simulated input: mcctl io set lamp on."""
    level = read_level(value)

    async def work(one: Machine) -> float:
        if any(each.name == name for each in one.info.inputs):
            return (await one.set_simulated_input(name, level)).value
        return (await one.set_output(name, level)).value

    done = target.carry_out(work, json)
    if json:
        write_json({"ok": True, "name": name, "value": done})
    else:
        results().print(Text(f"{name} = {done:g}"))


def read_level(text: str) -> bool | float:
    """Return what a word of the command line means as a value.

    Raises:
        typer.BadParameter: it is neither on, off nor a number.
    """
    word = text.strip().lower()
    if word in _LEVELS:
        return _LEVELS[word]
    try:
        return float(word)
    except ValueError:
        raise typer.BadParameter(f"{text!r} is no value: write on, off or a number") from None


def channels_view(info: Info, status: MachineStatus) -> RenderableType:
    """Tables of the inputs and outputs."""
    parts: list[RenderableType] = []
    if info.inputs:
        parts.append(_inputs_table(info, status))
    if info.outputs:
        parts.append(_outputs_table(info, status))
    return Group(*parts) if parts else Text("this machine has no inputs and no outputs", style="dim")


def _inputs_table(info: Info, status: MachineStatus) -> Table:
    table = _table("input", "state")
    for known, each in zip(info.inputs, status.inputs, strict=False):
        state = Text("")
        if each.stops:
            state = Text("stops the machine", style="bold red")
        elif each.holds:
            state = Text("holds the programs", style="yellow")
        table.add_row(
            Text(known.name),
            _number(known),
            _value(known, each.value),
            state,
            Text(known.source or "simulated"),
        )
    return table


def _outputs_table(info: Info, status: MachineStatus) -> Table:
    table = _table("output", "set by")
    for known, each in zip(info.outputs, status.outputs, strict=False):
        table.add_row(
            Text(known.name),
            _number(known),
            _value(known, each.value),
            Text(each.set_by or "–", style="" if each.set_by else "dim"),
            Text(known.target or "simulated"),
        )
    return table


def _table(kind: str, fourth: str) -> Table:
    table = plain_table()
    table.add_column(kind, min_width=14, no_wrap=True)
    table.add_column("number", min_width=8, no_wrap=True)
    table.add_column("value", justify="right", min_width=10, no_wrap=True)
    table.add_column(fourth, min_width=18, no_wrap=True)
    table.add_column("where", style="dim")
    return table


def _number(known: InputInfo | OutputInfo) -> str:
    return f"{'P' if known.kind == 'digital' else 'E'}{known.number}"


def _value(known: InputInfo | OutputInfo, value: float) -> Text:
    if known.kind == "digital":
        return Text("on", style="green") if value else Text("off", style="dim")
    return Text(f"{value:g} {known.unit}".rstrip())


def _as_json(status: MachineStatus) -> dict[str, object]:
    return {
        "t": status.t,
        "inputs": {each.name: each.value for each in status.inputs},
        "outputs": {each.name: each.value for each in status.outputs},
    }


async def _live(machine: Machine, status: MachineStatus) -> None:
    console = TerminalConsole()
    with Live(channels_view(machine.info, status), console=console, auto_refresh=False) as live:
        loop = asyncio.get_running_loop()
        due = loop.time()
        async for newest in machine.telemetry():
            if loop.time() >= due:
                due = loop.time() + 1.0 / REFRESH_HZ
                live.update(channels_view(machine.info, newest), refresh=True)
