"""``mcserver gateway``: WebSocket and HTTP for clients without Zenoh."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated

import typer

from mcserver.cli.console import narration, results, write_json
from mcserver.cli.options import (
    CertificateOption,
    ConnectOption,
    HostOption,
    JsonOption,
    KeyOption,
    PortOption,
    ZenohConfigOption,
)
from mcserver.cli.serving import announcing, require_packages, role_of
from mcserver.errors import ConfigurationError


def gateway(
    host: HostOption = "127.0.0.1",
    port: PortOption = 8787,
    connect: ConnectOption = None,
    zenoh: ZenohConfigOption = None,
    tokens: Annotated[
        Path | None,
        typer.Option("--tokens", metavar="PATH", help="The token file; without it: loopback only."),
    ] = None,
    origin: Annotated[
        list[str] | None,
        typer.Option("--origin", metavar="URL", help="Web origin whose pages may connect. Repeatable."),
    ] = None,
    certificate: CertificateOption = None,
    key: KeyOption = None,
    add_token: Annotated[
        str | None,
        typer.Option(
            "--add-token", metavar="NAME", help="Write a client into --tokens, print its token, end."
        ),
    ] = None,
    role: Annotated[
        str, typer.Option("--role", help="Of --add-token: observer, agent, operator or engineer.")
    ] = "operator",
    json: JsonOption = False,
) -> None:
    """Serve WebSocket and HTTP for browsers and languages without Zenoh, until Ctrl-C."""
    require_packages("gateway", "gateway", ("fastapi", "uvicorn", "mcclient"))
    if add_token is not None:
        _add_token(tokens, add_token, role, json)
        return
    from mcserver.doors.listening import Address
    from mcserver.gateway.site import GatewayOptions, serve

    options = GatewayOptions(
        Address(host, port, certificate, key, announcing("gateway", json=json)),
        connect=tuple(connect or ()),
        config_file=zenoh,
        tokens=tokens,
        origins=tuple(origin or ()),
    )
    asyncio.run(serve(options))


def _add_token(path: Path | None, name: str, role: str, json: bool) -> None:
    from mcserver.gateway.tokens import add_token

    if path is None:
        raise ConfigurationError("MC070", "the token file is not named", "give it with --tokens PATH")
    chosen = role_of(role, "MC070")
    token = add_token(path, name, chosen)
    narration().print(f"{path}: {name} is {chosen.name.lower()}; the token is shown this once")
    if json:
        write_json({"ok": True, "name": name, "token": token})
    else:
        results().print(token)
