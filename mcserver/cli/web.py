"""``mcserver web``: the operator's page, a process of its own that is only a client."""

from __future__ import annotations

import asyncio
import getpass
import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from mcserver.cli.console import narration
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


def web(
    host: HostOption = "127.0.0.1",
    port: PortOption = 8080,
    connect: ConnectOption = None,
    zenoh: ZenohConfigOption = None,
    users: Annotated[
        Path | None,
        typer.Option("--users", metavar="PATH", help="The password file; without it: loopback only."),
    ] = None,
    certificate: CertificateOption = None,
    key: KeyOption = None,
    programs: Annotated[
        Path | None,
        typer.Option(
            "--programs", metavar="DIR", help="Folder of uploaded programs; default: your state folder."
        ),
    ] = None,
    history: Annotated[
        Path | None,
        typer.Option(
            "--history", metavar="DIR", envvar="MC_HISTORY", help="Folder of mcserver history, to be shown."
        ),
    ] = None,
    add_user: Annotated[
        str | None,
        typer.Option(
            "--add-user", metavar="NAME", help="Write a user into --users and end; asks for the password."
        ),
    ] = None,
    role: Annotated[
        str, typer.Option("--role", help="Of --add-user: observer, agent, operator or engineer.")
    ] = "operator",
    json: JsonOption = False,
) -> None:
    """Serve the operator's page for one machine or a fleet, until Ctrl-C."""
    require_packages("web", "web", ("nicegui", "prometheus_client", "mcclient"))
    if add_user is not None:
        _add_user(users, add_user, role)
        return
    # before NiceGUI is imported: it would keep its own state in the working folder
    folder = programs or _state_folder()
    os.environ.setdefault("NICEGUI_STORAGE_PATH", str(folder / ".page"))
    from mcserver.doors.listening import Address
    from mcserver.web.site import WebOptions, serve

    options = WebOptions(
        Address(host, port, certificate, key, announcing("operator's page", json=json)),
        folder=folder,
        connect=tuple(connect or ()),
        config_file=zenoh,
        users=users,
        history=history,
    )
    asyncio.run(serve(options))


def _add_user(path: Path | None, name: str, role: str) -> None:
    from mcserver.web.users import add_user as write

    if path is None:
        raise ConfigurationError("MC060", "the password file is not named", "give it with --users PATH")
    chosen = role_of(role, "MC060")
    if sys.stdin.isatty():
        password = getpass.getpass(f"password of {name}: ")
        if password != getpass.getpass("again: "):
            raise ConfigurationError("MC060", "the two passwords differ", "try again")
    else:
        password = sys.stdin.readline().rstrip("\n")
    write(path, name, chosen, password)
    narration().print(f"{path}: {name} is {chosen.name.lower()}")


def _state_folder() -> Path:
    state = os.environ.get("STATE_DIRECTORY", "").partition(":")[0] or os.environ.get("XDG_STATE_HOME", "")
    return (Path(state) if state else Path.home() / ".local" / "state" / "mcserver") / "web"
