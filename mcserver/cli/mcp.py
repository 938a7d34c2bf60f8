"""``mcserver mcp``: the tools of an agent over the Model Context Protocol."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mcserver.cli.options import DEFAULT_MACHINE, CertificateOption, KeyOption, MachineOption
from mcserver.errors import ConfigurationError, UsageFault
from mcserver.machine.machine_file import load_machine


def mcp(
    machine: MachineOption = DEFAULT_MACHINE,
    connect: Annotated[
        list[str] | None,
        typer.Option(
            "--connect",
            metavar="E",
            help="A running server or router, for status and runs; of several, the first reached.",
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
    token_file: Annotated[
        Path | None,
        typer.Option(
            "--token-file", metavar="PATH", help="With --http: the token that every request has to bring."
        ),
    ] = None,
    origin: Annotated[
        list[str] | None,
        typer.Option("--origin", metavar="URL", help="With --http: pages that may connect. Repeatable."),
    ] = None,
    certificate: CertificateOption = None,
    key: KeyOption = None,
) -> None:
    """Serve agents: check, simulate, draft; with --connect also status, hold, abort and requests for runs."""
    described = load_machine(machine)
    host, port = _address(http) if http else ("", 0)
    if not http and (token_file or origin or certificate or key):
        raise UsageFault(
            "MC017", "standard input needs no token, origin or TLS", "leave them out, or give --http"
        )
    try:
        from mcserver.doors.listening import Address
        from mcserver.language.agents.http import AgentAccess, read_token, serve
        from mcserver.language.agents.server import AgentTools, build_server
    except ImportError as error:
        raise ConfigurationError(
            "MC016",
            f"the agents' server needs {error.name}",
            "install the extra: pip install 'mcserver[mcp]'",
        ) from error
    token = read_token(token_file) if token_file is not None else None
    access = AgentAccess(Address(host, port, certificate, key), token, tuple(origin or ()))
    server = build_server(AgentTools(described, machine, connect=connect, zenoh=zenoh, recordings=recordings))
    if http:
        serve(server, access)
    else:
        server.run("stdio")


def _address(text: str) -> tuple[str, int]:
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageFault("MC017", f"{text!r} is no address", "such as 127.0.0.1:8808")
    return host.removeprefix("[").removesuffix("]"), int(port)
