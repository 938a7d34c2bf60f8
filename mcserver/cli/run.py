"""``mcserver run``: the server."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Annotated

import msgspec
import typer

from mcserver.clearance.scene import Scene
from mcserver.cli.console import NarrationHandler, narration
from mcserver.cli.options import DEFAULT_MACHINE, MachineOption
from mcserver.cli.serving import require_linux
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import BUILT_IN, Machine, load_machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.net.keys import is_name
from mcserver.processes import raise_file_limit


def run(
    machine: MachineOption = DEFAULT_MACHINE,
    listen: Annotated[
        list[str] | None,
        typer.Option(
            "--listen",
            metavar="E",
            help="Zenoh endpoint to listen on; port 0 takes a free one. Repeatable. "
            "Default: tcp/127.0.0.1:7447.",
        ),
    ] = None,
    connect: Annotated[
        list[str] | None,
        typer.Option(
            "--connect", metavar="E", help="Router or peer to connect to, again and again. Repeatable."
        ),
    ] = None,
    journal: Annotated[
        Path | None,
        typer.Option("--journal", metavar="PATH", help="The journal's file; default: your state folder."),
    ] = None,
    name: Annotated[
        str | None,
        typer.Option("--name", metavar="N", help="Name in the key space, instead of the machine file's."),
    ] = None,
    zenoh: Annotated[
        Path | None,
        typer.Option(
            "--zenoh-config", metavar="PATH", help="A Zenoh configuration (JSON5) for TLS and access rules."
        ),
    ] = None,
    take_over: Annotated[
        bool,
        typer.Option("--take-over", help="Reset the drives on CAN buses even where another master is heard."),
    ] = False,
    recorder: Annotated[
        bool,
        typer.Option("--recorder/--no-recorder", help="Keep the black box, as the machine file says."),
    ] = True,
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="Say more of what happens.")] = False,
) -> None:
    """Run the server, until Ctrl-C or SIGTERM, which stop every axis in a controlled way."""
    require_linux("a server's realtime cycle")
    described = named(load_machine(machine), name)
    build_kinematics(described)
    if described.clearance is not None:
        Scene(described)
    if not recorder:
        described = without_recorder(described)
    from mcserver.net.configuration import NetworkOptions
    from mcserver.server import ServerOptions, serve
    from mcserver.service.service_options import LoadedFile

    if zenoh is not None and not zenoh.is_file():
        raise ConfigurationError(
            "MC018",
            f"there is no Zenoh configuration {zenoh}",
            "mcserver security init makes one: docs/security.md",
        )
    narrate_logs(verbose)
    # each client is a connection, and so is whoever has not introduced himself
    raise_file_limit()
    options = ServerOptions(
        network=NetworkOptions(
            listen=tuple(listen) if listen else None,
            connect=tuple(connect or ()),
            config_file=zenoh,
        ),
        journal=journal,
        take_over=take_over,
        machine_file=None if machine in BUILT_IN else LoadedFile.of(Path(machine)),
        on_ready=lambda endpoints: announce(described, endpoints),
        on_progress=lambda sentence: narration().print(f"{described.name}: {sentence}"),
    )
    asyncio.run(serve(described, options))
    narration().print(f"{described.name}: stopped")


def named(machine: Machine, name: str | None) -> Machine:
    """Return the machine under another name.

    Raises:
        ConfigurationError: MC017 the name cannot be part of a key.
    """
    if name is None:
        return machine
    if not is_name(name):
        raise ConfigurationError(
            "MC017", f"--name {name!r} cannot be part of a key", "use letters, digits, '-', '_', '.'"
        )
    return msgspec.structs.replace(machine, name=name)


def without_recorder(machine: Machine) -> Machine:
    """Return the machine with its recorder switched off."""
    off = msgspec.structs.replace(machine.recorder, enabled=False)
    return msgspec.structs.replace(machine, recorder=off)


def announce(machine: Machine, endpoints: list[str]) -> None:
    """One line that says who answers where, once clients are answered."""
    drives = ", ".join(sorted({axis.drive.kind for axis in machine.axes}))
    narration().print(
        f"{machine.name}: ready, {len(machine.axes)} axes ({drives} drives), "
        f"listening on {', '.join(endpoints)}"
    )


def narrate_logs(verbose: bool) -> None:
    """Logs of the server go to standard error, as all narration does."""
    level = logging.INFO if verbose else logging.WARNING
    logging.basicConfig(level=level, handlers=[NarrationHandler()], force=True)
    if not verbose:
        # what it calls errors are single attempts, reported by us where the last one fails
        logging.getLogger("canopen").setLevel(logging.CRITICAL)
