"""The server's door: who gets in by which certificate and password, and what a connection may take.

asyncua leaves open, as of 2.1: a message may announce any size and is gathered before it is looked at;
requests and answers that nobody reads gather, each request with all that had come behind it; a subscription
is looked at as often as its client says; a session is taken over from another channel by its number, which
can be guessed, whether or not the attempt shows a valid user; anybody registers servers.
"""

from __future__ import annotations

import asyncio
import contextlib
import datetime
import socket
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

from asyncua import Server, ua
from asyncua.common.connection import TransportLimits
from asyncua.common.utils import ServiceError
from asyncua.crypto.permission_rules import PermissionRuleset, User, UserRole
from asyncua.server.address_space import AttributeService
from asyncua.server.binary_server_asyncio import BinaryServer, OPCUAProtocol
from asyncua.server.internal_server import InternalServer
from asyncua.server.internal_session import InternalSession
from asyncua.server.subscription_service import SubscriptionService
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives.asymmetric import rsa

from mcserver.errors import ConfigurationError
from mcserver.net.roles import Role
from mcserver.web.users import Users

MOST_CONNECTIONS = 300
# until a session is activated [s]
ARRIVAL_S = 30.0
# of a message from a client [B]: a read or a subscription of some thousand nodes
MOST_MESSAGE = 2**20
# of a message: type, chunk, size (Part 6, 7.1.2.2)
HEADER = 8
# between two looks at a subscription [ms]: machines are looked at twice a second
SHORTEST_MS, LONGEST_MS = 50.0, 3_600_000.0
# rounds of the loop in which accepted connections are made, and the time for what ends with them [s]
ROUNDS, STOP_S = 8, 5.0
# values of a node that wait for one who does not ask for them
MOST_QUEUED = 20
# nodes that all clients together have subscribed to
MOST_ITEMS = 100_000
# methods that one message may call
MOST_CALLS = 100
# Reading; Call for ConditionRefresh and for the orders that machines take; Write, which is answered
# node by node: clients take a refused service for a broken connection. Not ModifyMonitoredItems, which
# takes any length of a queue.
SERVICES = (
    "Browse BrowseNext Call CreateMonitoredItems CreateSubscription DeleteMonitoredItems DeleteSubscriptions "
    "ModifySubscription Publish Read RegisterNodes Republish SetMonitoringMode "
    "SetPublishingMode TransferSubscriptions TranslateBrowsePathsToNodeIds UnregisterNodes Write"
)
ALLOWED = frozenset(
    ua.NodeId(getattr(ua.ObjectIds, f"{name}Request_Encoding_DefaultBinary")) for name in SERVICES.split(" ")
)


# carries out a method of a machine: of which, for whom, in which role, with which arguments
Orders = dict[ua.NodeId, Callable[[str, Role, Sequence[ua.Variant]], Awaitable[ua.StatusCode]]]


class ReadOnly(PermissionRuleset):
    """Whoever has got in may read and call methods, and nobody may do anything else."""

    def check_validity(self, user: User, action_type: ua.NodeId, _: Any) -> bool:
        return user.role is not UserRole.Anonymous and action_type in ALLOWED


class ReadOnlyAttributes(AttributeService):
    """Attributes that this process alone writes, whatever access the models' nodes say."""

    async def write(self, params: ua.WriteParameters, user: User) -> list[ua.StatusCode]:
        if user.role is not UserRole.Admin:
            return [ua.StatusCode(ua.StatusCodes.BadNotWritable) for _ in params.NodesToWrite]
        written: list[ua.StatusCode] = await super().write(params, user)
        return written


class BoundedSubscriptions(SubscriptionService):
    """Subscriptions whose items are bounded in number, and that are looked at now and then."""

    async def create_subscription(
        self, params: ua.CreateSubscriptionParameters, *rest: Any, **named: Any
    ) -> ua.CreateSubscriptionResult:
        # in this order no number is the shortest, too
        params.RequestedPublishingInterval = min(
            max(SHORTEST_MS, params.RequestedPublishingInterval), LONGEST_MS
        )
        made: ua.CreateSubscriptionResult = await super().create_subscription(params, *rest, **named)
        return made

    async def create_monitored_items(
        self, params: ua.CreateMonitoredItemsParameters, *rest: Any
    ) -> list[ua.MonitoredItemCreateResult]:
        there = sum(len(each.monitored_item_srv._monitored_items) for each in self.subscriptions.values())
        if there + len(params.ItemsToCreate) > MOST_ITEMS:
            raise ServiceError(ua.StatusCodes.BadTooManyMonitoredItems)
        made: list[ua.MonitoredItemCreateResult] = await super().create_monitored_items(params, *rest)
        return made


class Trust:
    """Certificates of clients, and authorities whose certificates are as good.

    Raises:
        ConfigurationError: MC085 the file cannot be read, or has none.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._known = x509.load_pem_x509_certificates(path.read_bytes())
        except (OSError, ValueError) as error:
            raise ConfigurationError(
                "MC085", f"the certificates {path} cannot be read: {error}", "a PEM file of one or more"
            ) from error

    def holds(self, der: bytes | None) -> bool:
        """Return whether a valid certificate is one of these, or signed by an authority among them."""
        try:
            certificate = x509.load_der_x509_certificate(der or b"")
        except ValueError:
            return False
        now = datetime.datetime.now(datetime.UTC)
        if not certificate.not_valid_before_utc <= now <= certificate.not_valid_after_utc:
            return False
        return certificate in self._known or any(_signed_by(certificate, each) for each in self._known)


class Session(InternalSession):
    """A session of a user, who may order what his role may."""

    iserver: Guard

    async def call(self, params: list[ua.CallMethodRequest]) -> list[ua.CallMethodResult]:
        if len(params) > MOST_CALLS:
            raise ServiceError(ua.StatusCodes.BadTooManyOperations)
        return [await self._call(each) for each in params]

    async def _call(self, request: ua.CallMethodRequest) -> ua.CallMethodResult:
        order = self.iserver.orders.get(request.MethodId)
        if order is None:
            (found,) = await super().call([request])
            return found
        name, role = self.iserver.who(self.user)
        status = await order(name, role, request.InputArguments or ())
        return ua.CallMethodResult(StatusCode=status)


class Guard(InternalServer):
    """Sessions: each of one channel.

    Args:
        users: passwords; None: none are asked for. trust: None: every client's certificate does.

    Attributes:
        orders: by the methods' nodes.
    """

    def __init__(self, users: Users | None, trust: Trust | None) -> None:
        super().__init__(user_manager=self)
        self.attribute_service = ReadOnlyAttributes(self.aspace)
        self.subscription_service = BoundedSubscriptions(self.aspace, iserver=self)
        self.isession.subscription_service = self.subscription_service
        self.orders: Orders = {}
        self._users, self._trust = users, trust
        self._address = ""
        self.max_connections = MOST_CONNECTIONS
        self.max_pending_activation_seconds = ARRIVAL_S
        self.max_monitored_item_queue_size = MOST_QUEUED
        self.max_unacked_messages_per_subscription = MOST_QUEUED
        self.max_subscriptions = MOST_CONNECTIONS
        token = ua.AnonymousIdentityToken if users is None else ua.UserNameIdentityToken
        self.supported_tokens = (token,)

    def create_session(self, name: str, user: User | None = None, external: bool = False) -> InternalSession:
        return Session(self, self.aspace, self.subscription_service, name, user or User(), external)

    def who(self, user: User) -> tuple[str, Role]:
        """Return the name and the role of a session's user, as the password file has it now.

        Without passwords it is this computer's alone, whose users are engineers as at the gateway, or that of
        clients with certificates, which have no role of their own.
        """
        if self._users is None:
            return ("local", Role.ENGINEER) if self._trust is None else ("certificate", Role.OBSERVER)
        return user.name or "", self._users.role_of(user.name or "") or Role.OBSERVER

    def lookup_external_session(self, _: ua.NodeId) -> InternalSession | None:
        """Return no session: another channel has to make one of its own."""
        return None

    def register_server(self, *_: Any) -> None:
        raise ServiceError(ua.StatusCodes.BadServiceUnsupported)

    register_server2 = register_server

    def decrypt_user_token(self, isession: Any, token: ua.UserNameIdentityToken) -> tuple[str, str]:
        self._address = str(isession.name)
        found: tuple[str, str] = super().decrypt_user_token(isession, token)
        return found

    def get_user(
        self, _: InternalServer, username: str | None, password: str | None, certificate: bytes | None
    ) -> User | None:
        """Return who a session is; the certificate: of the channel."""
        if self._trust is not None and not self._trust.holds(certificate):
            raise ServiceError(ua.StatusCodes.BadCertificateUntrusted)
        if username is not None:
            host = self._address.rpartition(",")[0]
            if self._users is None or self._users.log_in(username, password or "", host) is None:
                raise ServiceError(ua.StatusCodes.BadUserAccessDenied)
        return User(UserRole.User, username)


class Connection(OPCUAProtocol):
    """A connection that is read only as far as it takes its answers."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._room = asyncio.Event()
        self._room.set()
        self._unread = b""
        if len(self.clients) >= MOST_CONNECTIONS:
            # whoever has not shown who he is gives his place up: the oldest first
            oldest = next((each for each in self.clients if not each.has_activated()), None)
            if oldest is not None:
                self.clients.remove(oldest)
                oldest.transport.abort()
        super().connection_made(transport)

    def has_activated(self) -> bool:
        """Return whether a session of this connection was activated."""
        session = None if self.processor is None else self.processor.session
        return session is not None and bool(session.is_activated())

    def pause_writing(self) -> None:
        self._room.clear()

    def resume_writing(self) -> None:
        self._room.set()

    def data_received(self, data: bytes) -> None:
        """Hand whole messages over, one by one, and read on once they have been answered."""
        assert self.transport is not None
        self._unread += data
        begin = 0
        while len(self._unread) - begin >= HEADER:
            size = int.from_bytes(self._unread[begin + 4 : begin + HEADER], "little")
            if HEADER < size <= MOST_MESSAGE:
                if len(self._unread) - begin < size:
                    break
                super().data_received(self._unread[begin : begin + size])
                begin += size
            else:
                self.transport.abort()
            # what is left is of a message shorter than its own head; an orderly end waits for the other side
            if self._buffer or self.transport.is_closing():
                self.transport.abort()
                return
        self._unread = self._unread[begin:]
        if not self.messages.empty():
            self.transport.pause_reading()

    async def _process_one_msg(self, header: Any, buf: Any) -> bool:
        await self._room.wait()
        if self.transport is None or self.transport.is_closing():
            # each answer to what had come before its end would be a line in the log
            return False
        try:
            goes_on: bool = await super()._process_one_msg(header, buf)
        finally:
            if self.messages.empty():
                self.transport.resume_reading()
        return goes_on

    async def _activation_watchdog(self) -> None:
        """End a connection without a session, whether it takes its answers or not."""
        await asyncio.sleep(self.iserver.max_pending_activation_seconds)
        if not self.has_activated() and self.transport is not None:
            self.transport.abort()


class Listener(BinaryServer):
    """Takes connections at a socket that listens."""

    def __init__(self, guard: InternalServer, listener: socket.socket, limits: TransportLimits) -> None:
        super().__init__(guard, *listener.getsockname()[:2], limits)
        self._listener = listener

    def _make_protocol(self) -> OPCUAProtocol:
        return Connection(self.iserver, self._policies, self.clients, self.closing_tasks, self.limits)

    async def start(self) -> None:
        self._server = await asyncio.get_running_loop().create_server(
            self._make_protocol, sock=self._listener
        )
        self.cleanup_task = asyncio.create_task(self._close_task_loop())

    async def stop(self) -> None:
        """Take no more connections, then end all.

        The library ends them first: a client that dials again meanwhile, or one that does not read, would
        keep it waiting for ever.
        """
        if self._server is None:
            self._listener.close()
            return
        self._server.close()
        # those accepted a moment ago come up in the loop's next rounds
        for _ in range(ROUNDS):
            for transport in tuple(self.iserver.asyncio_transports):
                transport.abort()
            await asyncio.sleep(0)
        self.cleanup_task.cancel()
        await asyncio.gather(self.cleanup_task, return_exceptions=True)
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(STOP_S):
                await self._close_tasks()


class ReadOnlyServer(Server):
    """A server behind this door."""

    def __init__(self, guard: Guard, listener: socket.socket) -> None:
        super().__init__(iserver=guard)
        self._listener = listener
        self.listening_port: int = listener.getsockname()[1]
        self.limits = TransportLimits(65535, 65535, MOST_MESSAGE // 65535 + 1, MOST_MESSAGE)

    async def start(self) -> None:
        """Start all but the listener, at which clients wait until `open`."""
        await self._setup_server_nodes()
        await self.iserver.start()
        self.bserver = Listener(self.iserver, self._listener, self.limits)
        self.bserver.set_policies(self._policies)

    async def open(self) -> None:
        """Take connections."""
        await self.bserver.start()


def application_uri(path: Path) -> str:
    """Return the URI in a server's certificate, which its description has to have, too (Part 6, 6.2.2).

    Raises:
        ConfigurationError: MC085 there is none, its key is not RSA, or it cannot be read.
    """
    try:
        certificate = x509.load_pem_x509_certificate(path.read_bytes())
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris: Sequence[str] = names.get_values_for_type(x509.UniformResourceIdentifier)
        if not isinstance(certificate.public_key(), rsa.RSAPublicKey):
            raise ValueError("its key is not RSA")
        if not uris:
            raise ValueError("it has no URI")
    except (OSError, ValueError, x509.ExtensionNotFound) as error:
        raise ConfigurationError(
            "MC085",
            f"the certificate {path} does not do for OPC UA: {error}",
            "mcserver security opcua FOLDER NAME --host HOST makes one",
        ) from error
    return uris[0]


def _signed_by(certificate: x509.Certificate, authority: x509.Certificate) -> bool:
    try:
        constraints = authority.extensions.get_extension_for_class(x509.BasicConstraints).value
        certificate.verify_directly_issued_by(authority)
    except (x509.ExtensionNotFound, ValueError, TypeError, InvalidSignature):
        return False
    return constraints.ca
