"""``mcctl tables``: work offsets and tools, and who changed them."""

from __future__ import annotations

import time

from rich.table import Table

from mcclient.cli.options import JsonOption, Target
from mcclient.cli.output import carry_out, results, write_json
from mcclient.types import Tables
from mcclient.work_tables import change_text, offset_line, tool_line, undo_line


def tables(target: Target, json: JsonOption = False) -> None:
    """Work offsets and tools as lines that set them, and who changed them: change them with mcctl send."""

    async def work() -> Tables:
        async with target.open() as one:
            return await one.tables()

    found = carry_out(work, json)
    if json:
        write_json(found)
        return
    rows = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("row", "as a line", ""):
        rows.add_column(title, no_wrap=True)
    for each in found.offsets:
        turned = {"R": each.rotation} if each.rotation else {}
        rows.add_row(each.system, offset_line(each.system, {**each.origin, **turned}))
    for tool in found.tools:
        line = tool_line(tool.number, tool.length, tool.diameter)
        rows.add_row(f"T{tool.number}", line, "set by G10 L1" if tool.changed else "as the machine file")
    results().print(rows)
    if not found.changes:
        return
    changes = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("when", "who", "what", "to undo"):
        changes.add_column(title)
    for change in found.changes[:20]:
        when = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(change.wall))
        who = f"{change.name} ({change.client})" if change.name else change.client
        changes.add_row(when, who, change_text(change), undo_line(change) or "")
    results().print(changes)
