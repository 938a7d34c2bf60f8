"""``mcserver gateway``: WebSocket and HTTP for clients without Zenoh."""

from __future__ import annotations

import asyncio
import importlib.util
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
        str, typer.Option("--role", help="Of --add-token: observer, operator or engineer.")
    ] = "operator",
    json: JsonOption = False,
) -> None:
    """Serve WebSocket and HTTP for browsers and languages without Zenoh, until Ctrl-C."""
    missing = [name for name in ("fastapi", "uvicorn", "mcclient") if importlib.util.find_spec(name) is None]
    if missing:
        raise ConfigurationError(
            "MC016",
            f"mcserver gateway needs {', '.join(missing)}",
            "pip install 'mcserver[gateway]' mcclient",
        )
    if add_token is not None:
        _add_token(tokens, add_token, role, json)
        return
    from mcserver.gateway.site import GatewayOptions, serve

    def ready(address: str) -> None:
        narration().print(f"gateway: {address} (Ctrl-C ends)", markup=False)
        if json:
            write_json({"ok": True, "url": address})

    options = GatewayOptions(
        host=host,
        port=port,
        connect=tuple(connect or ()),
        config_file=zenoh,
        tokens=tokens,
        origins=tuple(origin or ()),
        certificate=certificate,
        key=key,
        on_ready=ready,
    )
    asyncio.run(serve(options))


def _add_token(path: Path | None, name: str, role: str, json: bool) -> None:
    from mcserver.gateway.tokens import add_token
    from mcserver.web.users import Role

    if path is None:
        raise ConfigurationError("MC070", "the token file is not named", "give it with --tokens PATH")
    try:
        chosen = Role.of(role)
    except ValueError:
        raise ConfigurationError(
            "MC070", f"there is no role {role!r}", "observer, operator or engineer"
        ) from None
    token = add_token(path, name, chosen)
    narration().print(f"{path}: {name} is {chosen.name.lower()}; the token is shown this once", markup=False)
    if json:
        write_json({"ok": True, "name": name, "token": token})
    else:
        results().print(token, markup=False)
