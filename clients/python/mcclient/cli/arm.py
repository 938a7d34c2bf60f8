"""``mcctl arm``: what waits for an operator, and the order that lets it start once."""

from __future__ import annotations

import math
from typing import Annotated, Any

import typer
from rich.table import Table
from rich.text import Text

from mcclient.cli.options import ConfigOption, ConnectOption, JsonOption, MachineOption, Target
from mcclient.cli.output import carry_out, results, say, write_json

SHOWN_HASH = 12


def arm(
    sha256: Annotated[
        str | None,
        typer.Argument(metavar="[HASH]", help="Of the text, at least 8 digits; left out: list what waits."),
    ] = None,
    seconds: Annotated[
        float, typer.Option("--seconds", "-s", min=1.0, max=3600.0, help="How long it may be started.")
    ] = 60.0,
    override: Annotated[
        float, typer.Option("--override", min=1.0, max=200.0, help="The greatest feed override, in percent.")
    ] = 100.0,
    machine: MachineOption = None,
    connect: ConnectOption = None,
    zenoh: ConfigOption = None,
    json: JsonOption = False,
) -> None:
    """Arm a program that somebody asked to run: this very text, once; without a hash, list what waits."""

    async def work() -> tuple[str, list[dict[str, Any]]]:
        async with Target(machine, connect, zenoh).open() as one:
            if sha256 is None:
                return one.name, await one.run_requests()
            return one.name, [await one.arm(sha256, seconds=seconds, override=override)]

    name, found = carry_out(work, json)
    if json:
        write_json({"ok": True, "machine": name, "requests": found})
    elif found:
        results().print(requests_table(found))
    else:
        say(f"{name}: nothing waits for an operator")


def requests_table(requests: list[dict[str, Any]]) -> Table:
    """Build a row for each request; names are shown as they are, without control characters."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("hash", "state", "client", "name", "moves", "lasts", "left", "override"):
        table.add_column(title, overflow="fold")
    for each in requests:
        moves = "; ".join(
            f"axis {part['axis']}: {part['low']:.3f} … {part['high']:.3f} {part['unit']}"
            for part in each["extents"]
        )
        cells = (
            each["sha256"][:SHOWN_HASH],
            each["state"],
            _plain(each["client"]),
            _plain(each["name"]),
            moves,
            f"{each['duration_s']:.3f} s",
            f"{math.ceil(each['remaining_s'])} s",
            f"{each['override']:g} %",
        )
        table.add_row(*(Text(cell) for cell in cells))
    return table


def _plain(text: str) -> str:
    return "".join(
        character if character.isprintable() else "\N{REPLACEMENT CHARACTER}" for character in text
    )
