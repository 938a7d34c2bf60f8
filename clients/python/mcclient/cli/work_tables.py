"""``mcctl tables``: work offsets and tools, their names and lives, and who changed them."""

from __future__ import annotations

import shlex
import time
from typing import Annotated

import typer

from mcclient.cli.options import JsonOption, Target
from mcclient.cli.output import results, write_json
from mcclient.cli.tables import plain_table
from mcclient.machine import Machine
from mcclient.types import TableChange, Tables
from mcclient.work_tables import change_text, offset_line, tool_line, undo_line, undo_row, use_text


def tables(
    target: Target,
    row: Annotated[str | None, typer.Argument(help="To name it or set its life: G54 … G59.3, or T3.")] = None,
    name: Annotated[str | None, typer.Option(help="For people; '' takes it away.")] = None,
    life: Annotated[
        float | None, typer.Option(min=0.0, help="For how long the tool may cut [min]; 0: no limit.")
    ] = None,
    used: Annotated[
        float | None, typer.Option(min=0.0, help="How long it has cut [min]; 0 behind a new one.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Work offsets and tools as lines that set them, for mcctl send, and who changed them.

    With a row its name, or how long a tool may cut, is changed.
    """
    if (row is None) != (name is None and life is None and used is None):
        raise typer.BadParameter("a row goes with --name, --life or --used")

    async def work(one: Machine) -> Tables:
        if row is not None:
            await one.set_table_row(row, name=name, life_min=life, used_min=used)
        return await one.tables()

    found = target.carry_out(work, json)
    if json:
        write_json(found)
        return
    rows = plain_table("row", "name", "as a line", "", "cut [min]", no_wrap=True)
    for each in found.offsets:
        turned = {"R": each.rotation} if each.rotation else {}
        line = offset_line(each.system, {**each.origin, **turned})
        rows.add_row(each.system, found.names.get(each.system, ""), line)
    for system in found.names.keys() - {each.system for each in found.offsets}:
        rows.add_row(system, found.names[system])
    for tool in found.tools:
        line = tool_line(tool.number, tool.length, tool.diameter)
        source = "set by G10 L1" if tool.changed else "as the machine file"
        rows.add_row(f"T{tool.number}", tool.name, line, source, use_text(tool))
    results().print(rows)
    if not found.changes:
        return
    changes = plain_table("when", "who", "what", "to undo")
    for change in found.changes[:20]:
        when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(change.wall))
        who = f"{change.name} ({change.client})" if change.name else change.client
        changes.add_row(when, who, change_text(change), undo_line(change) or _undo_command(change))
    results().print(changes)


def _undo_command(change: TableChange) -> str:
    back = undo_row(change)
    if back is None:
        return ""
    options = {"name": "--name", "life_min": "--life", "used_min": "--used"}
    said = {key: value if isinstance(value, str) else f"{value:.6g}" for key, value in back.items()}
    words = [f"{options[key]} {shlex.quote(value)}" for key, value in said.items() if key in options]
    return f"mcctl tables {change.row} {' '.join(words)}"
