"""``mcserver mtconnect``: machines as devices of an MTConnect agent."""

from __future__ import annotations

import asyncio

from mcserver.cli.console import narration
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
from mcserver.cli.serving import announcing, require_packages


def mtconnect(
    host: HostOption = "127.0.0.1",
    port: PortOption = 5000,
    connect: ConnectOption = None,
    zenoh: ZenohConfigOption = None,
    rate: StatesRateOption = 10.0,
    certificate: CertificateOption = None,
    key: KeyOption = None,
    json: JsonOption = False,
) -> None:
    """Serve all machines as devices of an MTConnect agent, until Ctrl-C: read-only, to whoever reaches it."""
    require_packages("mtconnect", "mtconnect", ("starlette", "uvicorn", "mcclient"))
    from mcserver.doors.listening import LOOPBACK, Address
    from mcserver.mtconnect.site import AgentOptions, serve

    if host not in LOOPBACK:
        narration().print(f"whoever reaches {host} may read all states: MTConnect has no logins")
    address = Address(host, port, certificate, key, announcing("MTConnect agent", json=json))
    asyncio.run(serve(AgentOptions(address, tuple(connect or ()), zenoh, rate)))
