"""``mcserver opcua``: machines as machine tools of OPC UA (OPC 40501-1)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mcserver.cli.options import (
    CertificateOption,
    ConnectOption,
    HostOption,
    JsonOption,
    KeyOption,
    PortOption,
    StatesRateOption,
    ZenohConfigOption,
)
from mcserver.cli.serving import announcing, require_packages, run_until_stopped


def opcua(
    host: HostOption = "127.0.0.1",
    port: PortOption = 4840,
    connect: ConnectOption = None,
    zenoh: ZenohConfigOption = None,
    rate: StatesRateOption = 2.0,
    users: Annotated[
        Path | None,
        typer.Option("--users", metavar="PATH", help="The page's password file: who may read, and order."),
    ] = None,
    trust: Annotated[
        Path | None,
        typer.Option("--trust", metavar="PEM", help="Certificates of clients, or of who signs them."),
    ] = None,
    certificate: CertificateOption = None,
    key: KeyOption = None,
    json: JsonOption = False,
) -> None:
    """Serve all machines as machine tools of OPC UA (OPC 40501-1) until Ctrl-C."""
    require_packages("opcua", "opcua", ("asyncua", "o6_nodeset_compiler", "mcclient"))
    from mcserver.doors.listening import Address
    from mcserver.opcua.site import OpcUaOptions, serve

    address = Address(host, port, certificate, key, announcing("OPC UA", json=json))
    run_until_stopped(serve(OpcUaOptions(address, users, trust, tuple(connect or ()), zenoh, rate)))
