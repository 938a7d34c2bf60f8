"""Machines as a link shows them, and the site that serves them."""

from __future__ import annotations

import asyncio
import contextlib
import datetime
from pathlib import Path
from typing import Any, NamedTuple

from asyncua import Client
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.crypto.uacrypto import CertProperties
from mcclient.types import (
    AxesStatus,
    Fault,
    Info,
    MachineStatus,
    ProgramState,
    ProgramStatus,
    Tables,
    ToolRow,
)

from mcserver.doors.listening import Address
from mcserver.net.roles import Role
from mcserver.opcua.site import Machines, OpcUaOptions, serving
from mcserver.security.site import Site
from mcserver.security.site_folder import write_application, write_site
from mcserver.web.users import add_user
from tests.wire_values import wire_value

WALL = 1_800_000_000.0
ODD = "Halle 3/Fräse: +#."
SECRET = "a long secret"
LOST_DRIVE = Fault("MC407", "axis 1 does not answer", axis=1)


def state(*faults: Fault, **fields: Any) -> MachineStatus:
    axes = wire_value(AxesStatus, (0,), (0.0,), (0.0,), (0.0,))
    return wire_value(MachineStatus, wall=WALL, axes=axes, faults=faults, **fields)


def program(now: str, name: str = "part.nc", **fields: Any) -> ProgramStatus:
    return wire_value(ProgramStatus, "id-1", ProgramState(now), "alice", name, **fields)


class Fleet:
    """A link to machines with these tools, and the orders that went over it."""

    def __init__(self, *tools: int) -> None:
        self.tools = tools
        self.described: dict[str, Any] = {}
        self.orders: list[tuple[str, str, dict[str, object]]] = []

    async def info(self, name: str) -> Info:
        return wire_value(Info, name, "0.1.0", **self.described)

    async def order(self, machine: str, method: str, **fields: object) -> None:
        self.orders.append((machine, method, fields))

    async def tables(self, _: str) -> Tables:
        rows = tuple(ToolRow(number, 10.0, 5.0) for number in self.tools)
        return wire_value(Tables, tool_table=True, tools=rows)


class Files(NamedTuple):
    """Of a site: server's and client's certificates and keys, one of another site, users, the authority."""

    server: tuple[Path, Path]
    client: tuple[Path, Path]
    other: tuple[Path, Path]
    users: Path
    authority: Path


def site_files(folder: Path) -> Files:
    now = datetime.datetime.now(datetime.UTC)
    site, other = folder / "site", folder / "other"
    for each in (site, other):
        write_site(each, Site("127.0.0.1"), now)
    for name, role in (("mes", Role.OBSERVER), ("helper", Role.AGENT), ("boss", Role.OPERATOR)):
        add_user(folder / "users", name, role, SECRET)
    return Files(
        write_application(site, "hall", ("127.0.0.1",), now),
        write_application(site, "mes", (), now),
        write_application(other, "mes", (), now),
        folder / "users",
        site / "authority.pem",
    )


class Served:
    """A server that a test may kill and start again, always at one port."""

    def __init__(self, files: Files) -> None:
        self._files = files
        self._stack = contextlib.AsyncExitStack()
        self.port = 0
        self.machines: Machines

    @property
    def url(self) -> str:
        return f"opc.tcp://127.0.0.1:{self.port}/"

    async def start(self) -> None:
        address = Address("127.0.0.1", self.port, *self._files.server)
        options = OpcUaOptions(address, self._files.users, self._files.authority)
        self.machines = await self._stack.enter_async_context(serving(options))
        self.port = self.machines.server.listening_port

    async def stop(self) -> None:
        await self._stack.aclose()
        # transports that were closed are let go in the loop's next rounds
        for _ in range(5):
            await asyncio.sleep(0)

    async def look(self, states: dict[str, MachineStatus], *tools: int) -> None:
        fleet: Any = Fleet(*tools)
        self.machines.tools_due = 0.0
        await self.machines.look(fleet, states)


async def channel(served: Served, pair: tuple[Path, Path], user: str, password: str) -> Client:
    """A client that has not connected yet."""
    client = Client(served.url, timeout=60.0)
    client.application_uri = "urn:mcserver:opcua:mes"
    client.set_user(user)
    client.set_password(password)
    certificate, key = (CertProperties(each, "pem") for each in pair)
    await client.set_security(SecurityPolicyBasic256Sha256, certificate, key)
    return client
