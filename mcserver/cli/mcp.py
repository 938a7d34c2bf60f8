"""``mcserver mcp``: the tools of an agent over the Model Context Protocol."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mcserver.cli.options import DEFAULT_MACHINE, MachineOption
from mcserver.errors import UsageFault
from mcserver.machine.machine_file import load_machine


def mcp(
    machine: MachineOption = DEFAULT_MACHINE,
    connect: Annotated[
        list[str] | None,
        typer.Option(
            "--connect", metavar="E", help="A running server or router, for status and runs. Repeatable."
        ),
    ] = None,
    zenoh: Annotated[
        Path | None,
        typer.Option(
            "--zenoh-config", metavar="PATH", help="A Zenoh configuration (JSON5): the agent's role."
        ),
    ] = None,
    recordings: Annotated[
        Path | None,
        typer.Option("--recordings", metavar="FOLDER", help="Recordings that the agent may list."),
    ] = None,
    http: Annotated[
        str | None,
        typer.Option(
            "--http", metavar="HOST:PORT", help="Serve streamable HTTP there, instead of standard input."
        ),
    ] = None,
) -> None:
    """Serve agents: check, simulate, draft; with --connect also status, hold, abort and requests for runs."""
    described = load_machine(machine)
    host, port = _address(http) if http else ("", 0)
    try:
        from mcserver.language.agents.server import AgentTools, build_server
    except ImportError as error:
        raise UsageFault(
            "MC016",
            f"the agents' server needs {error.name}",
            "install the extra: pip install 'mcserver[mcp]'",
        ) from error
    server = build_server(AgentTools(described, machine, connect=connect, zenoh=zenoh, recordings=recordings))
    if http:
        server.run("streamable-http", host=host, port=port)
    else:
        server.run("stdio")


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageFault("MC017", f"{text!r} is no address", "such as 127.0.0.1:8808")
    return host, int(port)
