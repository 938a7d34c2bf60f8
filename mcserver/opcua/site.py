"""The process: states of all machines into an OPC UA server, for whoever it lets in."""

from __future__ import annotations

import asyncio
import contextlib
import functools
import logging
import socket
import time
from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import msgspec
from asyncua import ua
from mcclient import MachineStatus, MotionError
from mcclient.fleet import FleetLink, keep_states

from mcserver.doors.listening import Address, Protection, listen
from mcserver.net.roles import Role
from mcserver.opcua.door import Guard, ReadOnly, ReadOnlyServer, Trust, application_uri
from mcserver.opcua.machine_tool import MachineTool
from mcserver.opcua.nodesets import Model, load
from mcserver.opcua.orders import Order, carry_out
from mcserver.web.users import read_users

MOST_MACHINES = 1000
# between two looks at a tool table [s]
TOOLS_S = 10.0
PROTECTION = Protection(
    "MC085",
    "OPC UA",
    "passwords or certificates of clients",
    "give --users with a password file, or --trust with certificates",
)
ENCRYPTED = (
    ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
    ua.SecurityPolicyType.Aes128Sha256RsaOaep_SignAndEncrypt,
    ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
)


class OpcUaOptions(msgspec.Struct, frozen=True):
    """How the server is served.

    Attributes:
        users: a password file. trust: certificates of clients or their authorities (PEM).
        connect: Zenoh endpoints; empty: this computer. config_file: a Zenoh configuration for TLS.
        rate_hz: states a second.
    """

    address: Address
    users: Path | None = None
    trust: Path | None = None
    connect: tuple[str, ...] = ()
    config_file: Path | None = None
    rate_hz: float = 2.0


class Machines:
    """Nodes of the machines that were seen.

    Clients are served once machines have been looked for: one that comes back after a restart asks for the
    nodes that it knew, and does not ask again for those that are not there.

    Args:
        on_ready: called when they are.

    Attributes:
        server: has them. tools_due: when tool tables are looked at again [s of the monotonic clock].
    """

    def __init__(
        self, server: ReadOnlyServer, guard: Guard, model: Model, on_ready: Callable[[], None]
    ) -> None:
        self.server, self._guard, self._model = server, guard, model
        self._on_ready: Callable[[], None] | None = on_ready
        self._link: FleetLink | None = None
        self._known: dict[str, MachineTool] = {}
        self.tools_due = 0.0

    async def look(self, link: FleetLink, states: Mapping[str, MachineStatus]) -> None:
        """Show all states; add the machines that are new, and take up what another start has changed."""
        self._link = link
        new = [name for name in states if name not in self._known]
        started = [name for name in self._known if name in states and self._is_another(name, states[name])]
        wanted = new[: MOST_MACHINES - len(self._known)] + started
        await asyncio.gather(*(self._take(link, name) for name in wanted))
        for name, machine in self._known.items():
            found = states.get(name)
            await machine.show(found, time.time() if found is None else found.wall)
        await self._open()
        if time.monotonic() >= self.tools_due:
            self.tools_due = time.monotonic() + TOOLS_S
            present = [name for name in self._known if name in states]
            await asyncio.gather(*(self._show_tools(link, name) for name in present))

    async def lose(self) -> None:
        """Show that no machine answers."""
        self._link = None
        for machine in self._known.values():
            await machine.show(None, time.time())
        await self._open()

    async def _open(self) -> None:
        ready, self._on_ready = self._on_ready, None
        if ready is not None:
            await self.server.open()
            ready()

    def _is_another(self, name: str, status: MachineStatus) -> bool:
        return self._known[name].instance != status.instance

    async def _take(self, link: FleetLink, name: str) -> None:
        with contextlib.suppress(MotionError):
            info = await link.info(name)
            if name in self._known:
                await self._known[name].renew(info)
            else:
                self._known[name] = await MachineTool.create(self.server, self._model, info)
            for method, order in self._known[name].orders.items():
                self._guard.orders[method] = functools.partial(self._order, name, order)

    async def _order(
        self, machine: str, order: Order, who: str, role: Role, arguments: Sequence[ua.Variant]
    ) -> ua.StatusCode:
        if self._link is None:
            return ua.StatusCode(ua.StatusCodes.BadNoCommunication)
        return await carry_out(self._link, machine, order, who, role, arguments)

    async def _show_tools(self, link: FleetLink, name: str) -> None:
        with contextlib.suppress(MotionError):
            await self._known[name].show_tools((await link.tables(name)).tools)


async def serve(options: OpcUaOptions) -> None:
    """Serve until it is cancelled.

    Raises:
        ConfigurationError: MC085 an address that others reach without secrets or a certificate, a certificate
            that does not do; MC060 the password file.
        ServiceError: MC065 the address cannot be listened on.
    """
    async with serving(options) as machines:
        lost: set[asyncio.Task[None]] = set()

        def lose(_: MotionError) -> None:
            lost.add(asyncio.ensure_future(machines.lose()))
            lost.difference_update([each for each in lost if each.done()])

        await keep_states(
            machines.look,
            lose,
            period_s=1.0 / options.rate_hz,
            connect=options.connect,
            config_file=options.config_file,
        )


@asynccontextmanager
async def serving(options: OpcUaOptions) -> AsyncIterator[Machines]:
    """Serve, without machines yet."""
    address = options.address
    users = None if options.users is None else read_users(options.users, time.monotonic)
    trust = None if options.trust is None else Trust(options.trust)
    PROTECTION.require(address, has_secrets=users is not None or trust is not None)
    uri = None if address.certificate is None else application_uri(address.certificate)
    # it logs what clients send as it is
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    guard = Guard(users, trust)
    server = ReadOnlyServer(guard, listen(address.host, address.port))
    await server.init()
    model = await load(server)
    await server.set_application_uri(uri or f"urn:{socket.gethostname()}:mcserver")
    server.set_server_name("mcserver")
    server.set_endpoint(f"opc.tcp://{address.host}:{server.listening_port}/")
    policies = [ua.SecurityPolicyType.NoSecurity]
    if address.certificate is not None and address.key is not None:
        policies = list(ENCRYPTED)
        await server.load_certificate(address.certificate, "pem")
        await server.load_private_key(address.key, format="pem")
    server.set_security_policy(policies, permission_ruleset=ReadOnly())
    await server.start()

    def ready() -> None:
        if address.on_ready is not None:
            address.on_ready(f"opc.tcp://{address.host}:{server.listening_port}/")

    try:
        yield Machines(server, guard, model, ready)
    finally:
        await server.stop()
