"""Wrap Zenoh for the asyncio loop; its synchronous callbacks appear only here."""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import msgspec
import zenoh

from mcserver.errors import ServiceError
from mcserver.net.configuration import plain
from mcserver.net.keys import everything
from mcserver.net.messages import ENCODING
from mcserver.net.qos import Qos
from mcserver.net.sockets import port_of, shut_down

log = logging.getLogger(__name__)

TOKENS_TIMEOUT_S = 2.0
CLOSE_LIMIT_S = 3.0
EVENT_CACHE = 1000
EVENT_HEARTBEAT_S = 0.5
LOOK_LIMIT_S = 5.0

T = TypeVar("T")

OnSample = Callable[[zenoh.Sample], None]
OnQuery = Callable[[zenoh.Query], None]


def is_zenoh_fault(error: BaseException) -> bool:
    """Return whether Zenoh refused something, or panicked: a panic is not an `Exception`, and its class has
    no module.
    """
    return isinstance(error, zenoh.ZError) or type(error).__name__ == "PanicException"


class Publication(Protocol):
    """A declared publisher, plain or advanced."""

    def put(self, payload: bytes) -> None: ...
    def undeclare(self) -> None: ...


class MatchedPublication:
    """A declared publisher that knows without asking Zenoh whether there are subscribers.

    Attributes:
        wanted: there is a subscriber. Set in Zenoh's thread.
    """

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self.wanted = False
        self._publisher = publisher
        # it is notified at once of existing subscribers
        self._listener = publisher.declare_matching_listener(
            zenoh.handlers.Callback(self._on_matching, indirect=False)
        )

    def put(self, payload: bytes) -> None:
        self._publisher.put(payload)

    def _on_matching(self, status: zenoh.MatchingStatus) -> None:
        self.wanted = status.matching


class ZenohSession:
    """One Zenoh session; `close` ends everything declared through it.

    A malformed key declared by a stranger makes Zenoh panic with its routing tables locked, and the session
    permanently deaf. Dropping its declarations would then abort the process, so references to all are kept
    here.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._advanced: list[Publication] = []
        self._declared: list[Any] = []
        self._deaf = False
        self._looking = threading.Lock()

    @classmethod
    async def open(cls, config: zenoh.Config) -> ZenohSession:
        """Open a session without blocking the loop.

        Raises:
            ServiceError: MC522 it cannot listen on the endpoint, or not reach the router.
        """
        try:
            session = await asyncio.to_thread(zenoh.open, config)
        except zenoh.ZError as error:
            raise ServiceError(
                "MC522",
                f"Zenoh cannot be opened: {plain(error)}",
                "does the router run that it is to reach? is the port taken by another server? see --listen",
            ) from error
        return cls(session)

    @property
    def zenoh_id(self) -> str:
        """Its id on the network, which everyone who gets a reply learns."""
        return str(self._session.zid())

    def link_sources(self) -> list[str]:
        """Return this side's locators of its links."""
        return [link.src for link in self._session.info.links()]

    def subscribe(self, key: str, on_sample: OnSample) -> None:
        """Call ``on_sample`` in Zenoh's thread for each sample."""
        self._declared.append(self._session.declare_subscriber(key, self._callback(on_sample)))

    def queryable(self, key: str, on_query: OnQuery) -> None:
        """Call ``on_query`` in Zenoh's thread for each query, which the callee has to drop."""
        self._declared.append(self._session.declare_queryable(key, self._callback(on_query), complete=True))

    def token(self, key: str) -> None:
        """Declare a liveliness token until the session ends."""
        self._declared.append(self._session.liveliness().declare_token(key))

    async def tokens(self, key: str) -> list[str]:
        """Return the keys of the present liveliness tokens."""

        def ask() -> list[str]:
            replies = self._session.liveliness().get(key, timeout=TOKENS_TIMEOUT_S)
            return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

        return await asyncio.to_thread(ask)

    def watch_tokens(self, key: str, on_sample: OnSample) -> None:
        """Call ``on_sample`` in Zenoh's thread as tokens appear (PUT, present ones too) and disappear."""
        self._declared.append(
            self._session.liveliness().declare_subscriber(key, self._callback(on_sample), history=True)
        )

    def matched_publisher(self, key: str, qos: Qos) -> MatchedPublication:
        """Return a publisher that knows whether there are subscribers."""
        matched = MatchedPublication(self.publisher(key, qos))
        self._declared.append(matched)
        return matched

    def publisher(self, key: str, qos: Qos) -> zenoh.Publisher:
        self._use_tables()
        publisher = self._session.declare_publisher(
            key,
            encoding=ENCODING,
            priority=qos.priority,
            congestion_control=qos.congestion,
            express=qos.express,
            reliability=qos.reliability,
        )
        self._declared.append(publisher)
        return publisher

    def recoverable_publisher(self, key: str, qos: Qos) -> Publication:
        """Return a publisher whose subscribers detect gaps and fill them from its cache."""
        self._use_tables()
        publisher = zenoh.ext.declare_advanced_publisher(
            self._session,
            key,
            encoding=ENCODING,
            priority=qos.priority,
            congestion_control=qos.congestion,
            express=qos.express,
            reliability=qos.reliability,
            cache=zenoh.ext.CacheConfig(EVENT_CACHE),
            sample_miss_detection=zenoh.ext.MissDetectionConfig(
                heartbeat=EVENT_HEARTBEAT_S, sporadic_heartbeat=None
            ),
            publisher_detection=True,
        )
        self._advanced.append(publisher)
        return publisher

    def end(self, publisher: zenoh.Publisher) -> None:
        """End a publisher before the session ends."""
        self._use_tables()
        self._declared.remove(publisher)
        publisher.undeclare()  # type: ignore[no-untyped-call]

    async def is_deaf(self) -> bool:
        """Return whether Zenoh no longer receives through this session, which a stranger's malformed key can
        cause.
        """
        try:
            async with asyncio.timeout(LOOK_LIMIT_S):
                await asyncio.to_thread(self._use_tables)
        except zenoh.ZError as error:
            log.debug("Zenoh takes no declaration: %s", error)
        except TimeoutError:
            self._deaf = True
        return self._deaf

    def _use_tables(self) -> None:
        """Use the routing tables, so that a panic in them is raised here and affects only this call.

        Raises:
            zenoh.ZError: the session is deaf, or closed.
        """
        if not self._deaf and self._looking.acquire(blocking=False):
            try:
                self._session.undeclare(self._session.declare_keyexpr(everything()))
            except BaseException as error:
                # later declarations of the key would fail before they panic
                self._deaf = not isinstance(error, zenoh.ZError)
                raise zenoh.ZError(str(error)) from None
            finally:
                self._looking.release()
        elif self._deaf:
            raise zenoh.ZError("the session is deaf")

    async def endpoints(self) -> list[str]:
        """Return the endpoints that the session listens on; only needed if port 0 was requested."""

        def ask() -> list[str]:
            for reply in self._session.get(f"@/{self._session.zid()}/*", timeout=2.0):
                if reply.ok is not None:
                    return list(msgspec.json.decode(reply.ok.payload.to_bytes()).get("locators", []))
            return []

        return await asyncio.to_thread(ask)

    def _callback(self, callback: Callable[[T], None]) -> zenoh.handlers.Callback[T]:
        return zenoh.handlers.Callback(callback, indirect=False)

    async def close(self) -> None:
        """End everything declared, advanced publishers first, within `CLOSE_LIMIT_S`."""
        loop = asyncio.get_running_loop()
        closed = asyncio.Event()
        close: Callable[[], None] = self._session.close
        ports = {port_of(source) for source in self.link_sources()}

        def end_publishers() -> None:
            self._use_tables()
            for publisher in self._advanced:
                publisher.undeclare()

        def end() -> None:
            # a deaf session frees its port before it panics
            for step in (end_publishers, close):
                try:
                    step()
                except BaseException as error:
                    log.warning("Zenoh did not close cleanly: %s", error)
            if self._deaf:
                # Zenoh leaves some links open, on which the other side would wait forever
                shut_down(ports)
            loop.call_soon_threadsafe(closed.set)
            if self._deaf:
                # never drop the declarations: keep them as long as the process lives
                threading.Event().wait()

        # in a thread that may be left behind, since closing may hang on a dead link
        threading.Thread(target=end, name="zenoh-close", daemon=True).start()
        try:
            await asyncio.wait_for(closed.wait(), CLOSE_LIMIT_S)
        except TimeoutError:
            log.warning("Zenoh did not close within %s s", CLOSE_LIMIT_S)
