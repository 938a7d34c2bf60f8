"""``mcserver fleet-sim``: many light machines, to see how viewers, routers and own programs take them."""

from __future__ import annotations

import signal
import threading
from typing import Annotated

import typer

from mcserver.cli.console import narration
from mcserver.cli.options import ConnectOption, ZenohConfigOption
from mcserver.errors import ConfigurationError
from mcserver.net.keys import is_name

# Period of looking whether the fleet still runs [s].
LOOK_S = 0.5


def fleet_sim(
    machines: Annotated[int, typer.Option("--machines", "-n", min=1, max=100_000, help="How many.")] = 10,
    connect: ConnectOption = None,
    listen: Annotated[
        list[str] | None,
        typer.Option("--listen", "-l", metavar="E", help="Zenoh endpoint to listen on. Repeatable."),
    ] = None,
    zenoh: ZenohConfigOption = None,
    prefix: Annotated[
        str, typer.Option("--prefix", metavar="NAME", help="Machines are NAME-00001, …")
    ] = "sim",
    first: Annotated[int, typer.Option("--first", min=0, metavar="N", help="Number of the first one.")] = 1,
    axes: Annotated[int, typer.Option("--axes", min=1, max=64, help="Of each machine.")] = 6,
    state_hz: Annotated[
        float,
        typer.Option("--state-hz", min=0.1, max=50.0, help="States a second, while someone subscribes."),
    ] = 5.0,
    line_s: Annotated[
        float, typer.Option("--line-s", min=0.001, max=60.0, help="How long a line of a program takes.")
    ] = 0.1,
) -> None:
    """Simulate a fleet of light machines on the network until Ctrl-C or SIGTERM: real protocol, no motion."""
    from mcserver.fleet_sim.fleet import FleetOptions, open_fleet
    from mcserver.net.configuration import NetworkOptions

    if not is_name(f"{prefix}-00001"):
        raise ConfigurationError(
            "MC017", f"{prefix!r} cannot be part of a key", "use letters, digits, '-', '_', '.'"
        )
    network = NetworkOptions(
        listen=tuple(listen) if listen else (() if connect else None),
        connect=tuple(connect or ()),
        config_file=zenoh,
    )
    options = FleetOptions(machines, first, prefix, axes, state_hz, line_s, network)
    # a handler would run amid the wait of `fleet.run`, whose lock it would need; threads inherit the mask
    ending = (signal.SIGTERM, signal.SIGINT)
    signal.pthread_sigmask(signal.SIG_BLOCK, ending)
    session, fleet = open_fleet(options)
    names = f"{prefix}-{first:05d} … {prefix}-{first + machines - 1:05d}"
    where = ", ".join([*(connect or ()), *(listen or ())]) or "the Zenoh configuration, or the loopback"
    narration().print(f"{machines} light machines {names} at {where}")
    running = threading.Thread(target=fleet.run)
    running.start()
    while running.is_alive() and signal.sigtimedwait(ending, LOOK_S) is None:
        pass
    fleet.stop()
    running.join()
    session.close()  # type: ignore[no-untyped-call]
    fleet.close()
