"""The one place that wraps Zenoh: a session in client mode, and the asyncio loop."""

from __future__ import annotations

import asyncio
import atexit
import contextlib
import json
import logging
import os
import re
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from mcclient.errors import ConfigurationError, NobodyAnswers
from mcclient.inbox import Inbox
from mcclient.keys import is_name
from mcclient.wire import ENCODING

log = logging.getLogger(__name__)

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
CLOSE_LIMIT_S = 2.0
LEASE_MS = 2000
REPLIES_LIMIT = 8192
# below this a put is a copy into a batch; above it may have to wait for the link, which the loop must not
LARGE_PUT_BYTES = 8 * 1024
# Zenoh's errors name places in its own sources: "… at /home/…/net/runtime.rs:123."
_SOURCE_PLACE = re.compile(r"\s*(?:\(?\bat\s+)?\S*/\S+\.rs:\d+(?::\d+)?\.?\)?")
RETRY = {"period_init_ms": 50, "period_max_ms": 500, "period_increase_factor": 1.5}


@dataclass(frozen=True, slots=True)
class Arrived:
    """A sample.

    Attributes:
        gone: the key (a liveliness token) has gone.
    """

    key: str
    payload: bytes
    gone: bool


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer to a query; ``ok`` is False for an error reply, ``source`` the Zenoh id of who gave it."""

    key: str
    payload: bytes
    ok: bool
    source: str | None = None


Deliver = Callable[[Arrived], None]
# whether what comes from the session with this Zenoh id is believed; None: Zenoh does not say where from
Trust = Callable[[str | None], bool]


def endpoints_of(connect: str | Sequence[str] | None) -> tuple[str, ...]:
    """Endpoints given, else those of the environment variable MC_CONNECT, separated by commas."""
    if connect is None:
        connect = os.environ.get("MC_CONNECT", "")
    if isinstance(connect, str):
        connect = connect.split(",")
    return tuple(endpoint.strip() for endpoint in connect if endpoint.strip())


class Subscription:
    """Delivers until it is closed."""

    def __init__(self, inbox: Inbox[Arrived], undeclare: Callable[[], None]) -> None:
        self._inbox = inbox
        self._undeclare: Callable[[], None] | None = undeclare

    @property
    def dropped(self) -> int:
        """Samples that came faster than they were taken."""
        return self._inbox.dropped

    def close(self) -> None:
        """Ends it; again is no error."""
        undeclare, self._undeclare = self._undeclare, None
        if undeclare is None:
            return
        try:
            undeclare()
        except zenoh.ZError as error:
            log.debug("undeclaring: %s", error)


def configuration(endpoints: tuple[str, ...], timeout_s: float, config_file: Path | None) -> zenoh.Config:
    """Client mode: connects within ``timeout_s`` at first, and for ever again after a loss.

    Raises:
        ConfigurationError: MC537 the file or an endpoint is not a Zenoh configuration.
    """
    settings: dict[str, object] = {
        "mode": "client",
        "connect/timeout_ms": max(1, round(timeout_s * 1000)),
        "connect/exit_on_failure": True,
        "connect/retry": RETRY,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
    }
    if endpoints or config_file is None:
        settings["connect/endpoints"] = list(endpoints or (DEFAULT_ENDPOINT,))
    try:
        config = zenoh.Config.from_file(config_file) if config_file else zenoh.Config()
        for key, value in settings.items():
            config.insert_json5(key, json.dumps(value))
    except (zenoh.ZError, OSError) as error:
        raise refused_configuration(error) from error
    return config


class _Trusted:
    """Whose replies and samples are taken: everybody's until a machine is chosen."""

    def __init__(self) -> None:
        self.accepts: Trust = lambda _: True


class Link:
    """One Zenoh session; all of it is used from the loop that opened it."""

    def __init__(self, session: zenoh.Session, loop: asyncio.AbstractEventLoop) -> None:
        self._session = session
        self._loop = loop
        self._replies: Inbox[Callable[[], None]] = Inbox(loop, lambda act: act(), limit=REPLIES_LIMIT)
        self._declared: list[Any] = []
        self._trust = _Trusted()
        self.closed = False
        # under way; who closes the link does not wait for their answers
        self._queries: set[asyncio.Future[None]] = set()
        atexit.register(self._close_at_exit)

    @classmethod
    async def open(
        cls, endpoints: tuple[str, ...], *, timeout_s: float, config_file: Path | None = None
    ) -> Link:
        """Connects.

        Raises:
            ConfigurationError: MC537.
            NobodyAnswers: MC530 nothing listens at the endpoints.
        """
        config = configuration(endpoints, timeout_s, config_file)
        try:
            session = await asyncio.to_thread(zenoh.open, config)
        except zenoh.ZError as error:
            where = ", ".join(endpoints or (DEFAULT_ENDPOINT,))
            raise NobodyAnswers(
                "MC530",
                f"nothing can be reached at {where}",
                "start a server (mcserver run), or name its endpoint with --connect",
                details={"reason": str(error)},
            ) from error
        return cls(session, asyncio.get_running_loop())

    def believe(self, trust: Trust) -> None:
        """Take replies and samples only from the sessions that ``trust`` accepts; tokens from all.

        Anybody whom the network's access rules let may publish on a machine's keys: a sample's source is the
        session that gave it its time stamp, a reply's the one that replied.
        """
        self._trust.accepts = trust

    async def query(
        self,
        key: str,
        payload: bytes | None,
        *,
        timeout_s: float,
        one: bool = False,
    ) -> list[Reply]:
        """Return all replies; an empty list says nothing about whether the query arrived.

        Args:
            one: a single server is asked: its reply is returned as it comes, and Zenoh's word that none
                follows is not waited for.
        """
        if self.closed:
            return []
        gathered: list[Reply] = []
        finished: asyncio.Future[None] = self._loop.create_future()
        self._queries.add(finished)
        finished.add_done_callback(self._queries.discard)
        trust = self._trust

        def finish() -> None:
            if not finished.done():
                finished.set_result(None)

        def take(reply: Reply) -> None:
            gathered.append(reply)
            if one:
                finish()

        def on_reply(reply: zenoh.Reply) -> None:
            source = _replier(reply)
            if not trust.accepts(source):
                return
            if reply.ok is not None:
                came = Reply(str(reply.ok.key_expr), reply.ok.payload.to_bytes(), True, source)
            elif reply.err is not None and str(reply.err.encoding) == ENCODING:
                came = Reply(key, reply.err.payload.to_bytes(), False, source)
            else:
                # Zenoh's own error replies (a time-out on the way) are not the server's answer
                return
            self._replies.push(lambda: take(came))

        def on_end() -> None:
            # the loop need not be woken for what it knows
            if not finished.done():
                self._replies.push(finish)

        try:
            self._session.get(
                key,
                zenoh.handlers.Callback(on_reply, on_end, indirect=False),
                payload=payload,
                encoding=ENCODING if payload is not None else None,
                timeout=timeout_s,
                target=zenoh.QueryTarget.BEST_MATCHING,
                consolidation=zenoh.ConsolidationMode.NONE,
                congestion_control=zenoh.CongestionControl.BLOCK,
                priority=zenoh.Priority.INTERACTIVE_HIGH,
                express=True,
            )
        except zenoh.ZError as error:
            log.debug("query %s: %s", key, error)
            return []
        await finished
        return gathered

    async def live_keys(self, key: str, *, timeout_s: float) -> list[str]:
        """Keys of the liveliness tokens that are there now."""
        gathered: list[str] = []
        finished: asyncio.Future[None] = self._loop.create_future()

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                live = str(reply.ok.key_expr)
                self._replies.push(lambda: gathered.append(live))

        def on_end() -> None:
            self._replies.push(lambda: None if finished.done() else finished.set_result(None))

        try:
            self._session.liveliness().get(
                key, zenoh.handlers.Callback(on_reply, on_end, indirect=False), timeout=timeout_s
            )
        except zenoh.ZError as error:
            log.debug("liveliness %s: %s", key, error)
            return []
        await finished
        return gathered

    async def put(
        self,
        key: str,
        payload: bytes,
        *,
        priority: zenoh.Priority = zenoh.Priority.DATA_HIGH,
        express: bool = False,
        drop: bool = False,
    ) -> None:
        """Send, blocking only the caller where the link is full; nobody hears of what the link loses.

        Args:
            drop: where the link is full it is lost instead: the next one is newer.
        """

        def send() -> None:
            try:
                self._session.put(
                    key,
                    payload,
                    encoding=ENCODING,
                    priority=priority,
                    express=express,
                    congestion_control=zenoh.CongestionControl.DROP
                    if drop
                    else zenoh.CongestionControl.BLOCK,
                )
            except zenoh.ZError as error:
                log.debug("put %s: %s", key, error)

        if len(payload) < LARGE_PUT_BYTES and priority is not zenoh.Priority.REAL_TIME:
            send()
        else:
            await self._loop.run_in_executor(None, send)

    def subscribe(self, key: str, deliver: Deliver, *, limit: int) -> Subscription:
        """Calls ``deliver`` in the loop with each sample; of those that wait, the newest ``limit`` are
        kept.
        """
        inbox = Inbox(self._loop, deliver, limit=limit)
        subscriber = self._session.declare_subscriber(key, _samples(inbox, self._trust))
        return Subscription(inbox, subscriber.undeclare)

    def subscribe_recovering(self, key: str, deliver: Deliver, *, limit: int) -> Subscription:
        """As `subscribe`, and what was lost on the way is fetched from the publisher's cache where it has
        one.
        """
        inbox = Inbox(self._loop, deliver, limit=limit)
        try:
            subscriber: Any = zenoh.ext.declare_advanced_subscriber(
                self._session,
                key,
                _samples(inbox, self._trust),
                recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
            )
        except (zenoh.ZError, AttributeError) as error:
            # an extension that older builds of Zenoh lack; the reader of events closes gaps by itself too
            log.debug("advanced subscriber %s: %s", key, error)
            return self.subscribe(key, deliver, limit=limit)
        return Subscription(inbox, subscriber.undeclare)

    def watch_tokens(self, key: str, deliver: Deliver, *, limit: int = 4096) -> Subscription:
        """As liveliness tokens come and go, those already there too."""
        inbox = Inbox(self._loop, deliver, limit=limit)
        subscriber = self._session.liveliness().declare_subscriber(key, _tokens(inbox), history=True)
        return Subscription(inbox, subscriber.undeclare)

    def declare_token(self, key: str) -> Callable[[], None]:
        """Return a liveliness token, until the link closes or what is returned is called."""
        token = self._session.liveliness().declare_token(key)
        self._declared.append(token)

        def undeclare() -> None:
            self._declared.remove(token)
            token.undeclare()  # type: ignore[no-untyped-call]

        return undeclare

    async def close(self) -> None:
        """Ends all that was declared, within `CLOSE_LIMIT_S`."""
        if self.closed:
            return
        self.closed = True
        for query in list(self._queries):
            if not query.done():
                query.set_result(None)
        ended = asyncio.Event()

        def end() -> None:
            self._close_session()
            try:
                self._loop.call_soon_threadsafe(ended.set)
            except RuntimeError:
                log.debug("the loop ended before the link")

        # a thread of its own that may be left behind: closing has been seen to hang on a dead link
        threading.Thread(target=end, name="mcclient-close", daemon=True).start()
        try:
            async with asyncio.timeout(CLOSE_LIMIT_S):
                await ended.wait()
        except TimeoutError:
            log.warning("Zenoh did not close within %s s", CLOSE_LIMIT_S)
        atexit.unregister(self._close_at_exit)

    def _close_session(self) -> None:
        try:
            self._session.close()  # type: ignore[no-untyped-call]
        except zenoh.ZError as error:
            log.debug("closing: %s", error)

    def _close_at_exit(self) -> None:
        """Close what nobody has closed: a thread of Zenoh that calls back while Python ends aborts it."""
        self.closed = True
        closing = threading.Thread(target=self._close_session, name="mcclient-close", daemon=True)
        # without a thread it might never return; some versions of Python start none so late
        with contextlib.suppress(RuntimeError):
            closing.start()
            closing.join(CLOSE_LIMIT_S)


def user_of(config_file: Path | None) -> str:
    """Who the access rules know this client as: ``metadata.user`` of a Zenoh configuration; empty: nobody.

    Raises:
        ConfigurationError: MC537 the file is no Zenoh configuration, or the name cannot be part of a key.
    """
    if config_file is None:
        return ""
    try:
        written = zenoh.Config.from_file(config_file).get_json("metadata")
    except (zenoh.ZError, OSError) as error:
        raise refused_configuration(error) from error
    metadata = json.loads(written)
    user = metadata.get("user", "") if isinstance(metadata, dict) else ""
    if user and not (isinstance(user, str) and is_name(user) and "." not in user):
        raise ConfigurationError(
            "MC537",
            f"{config_file}: {user!r} is no name of a user",
            "metadata.user has letters, digits, '-' and '_'",
        )
    return str(user)


def refused_configuration(error: Exception) -> ConfigurationError:
    """Zenoh's refusal, without the places in its own sources."""
    return ConfigurationError(
        "MC537", f"Zenoh refuses the configuration: {plain(error)}", "endpoints look like tcp/127.0.0.1:7447"
    )


def plain(error: Exception) -> str:
    """Return what an error of Zenoh says, without paths of its sources."""
    return _SOURCE_PLACE.sub("", str(error)).strip().rstrip(".")


def _source(sample: zenoh.Sample) -> str | None:
    return None if sample.timestamp is None else str(sample.timestamp.get_id())


def _replier(reply: zenoh.Reply) -> str | None:
    return None if reply.replier_id is None else str(reply.replier_id.zid)


def _samples(inbox: Inbox[Arrived], trust: _Trusted) -> zenoh.handlers.Callback[zenoh.Sample]:
    """Return a callback for what only the server says; it holds no session, which Zenoh would keep open for
    it.
    """

    def on_sample(sample: zenoh.Sample) -> None:
        if trust.accepts(_source(sample)):
            inbox.push(Arrived(str(sample.key_expr), sample.payload.to_bytes(), False))

    return zenoh.handlers.Callback(on_sample, indirect=False)


def _tokens(inbox: Inbox[Arrived]) -> zenoh.handlers.Callback[zenoh.Sample]:
    def on_sample(sample: zenoh.Sample) -> None:
        inbox.push(Arrived(str(sample.key_expr), b"", sample.kind == zenoh.SampleKind.DELETE))

    return zenoh.handlers.Callback(on_sample, indirect=False)
