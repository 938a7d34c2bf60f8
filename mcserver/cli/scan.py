"""``mcserver scan``: what is on a CAN bus, and a machine file to start from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
import typer
from rich.table import Table

from mcserver.cli.console import narration, results, write_json, write_text
from mcserver.cli.options import JsonOption


def scan(
    address: Annotated[
        str, typer.Argument(metavar="BUS", help="can0, socketcand:HOST:PORT/CHANNEL, udp:GROUP:PORT.")
    ],
    machine_file: Annotated[
        bool, typer.Option("--machine-file", help="Print a machine file to start from, instead of the table.")
    ] = False,
    take_over: Annotated[
        bool, typer.Option("--take-over", help="Ask the nodes even where another master is heard.")
    ] = False,
    eds: Annotated[
        Path | None, typer.Option("--eds", metavar="FOLDER", help="Where to look for the drives' EDS files.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Look who is on a CAN bus: identity and modes of every node. Nothing is configured, reset or started."""
    from mcserver.can.open import open_port
    from mcserver.canopen.bus_scan import with_eds
    from mcserver.canopen.listening import Listening, refuse_other_masters
    from mcserver.canopen.scan import machine_file as file_of
    from mcserver.canopen.scan import scan as look

    port = open_port(address)
    try:
        if not take_over:
            refuse_other_masters([Listening(address, port, ())], LISTEN_S)
        nodes = look(port)
    finally:
        port.close()
    if eds is not None:
        nodes = with_eds(nodes, [eds])
    if json:
        write_json({"bus": address, "nodes": nodes})
    elif machine_file:
        write_text(file_of("machine", address, nodes))
    elif nodes:
        results().print(table_of(nodes))
    else:
        narration().print(f"{address}: no node answers: check power, bit rate and terminators")


# Drives that send by themselves are no reason to ask nothing: only a master at work is.
LISTEN_S = 0.25


def table_of(nodes: Sequence[object]) -> Table:
    """One row a node."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for title in ("node", "what", "vendor", "product", "revision", "serial", "modes", "EDS"):
        table.add_column(title)
    for node in nodes:
        shown = msgspec.structs.asdict(node)  # type: ignore[arg-type]
        numbers = [shown[name] for name in ("vendor_id", "product_code", "revision", "serial")]
        table.add_row(
            str(shown["node"]),
            shown["what"],
            *("–" if number is None else f"0x{number:08X}" for number in numbers),
            ", ".join(shown["modes"]) or "–",
            Path(shown["eds"]).name or "–",
        )
    return table
