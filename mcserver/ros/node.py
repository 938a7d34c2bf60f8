"""Nodes of ROS 2 on a session of Zenoh: publishers, subscriptions and services, as rmw_zenoh makes them."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import logging
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import zenoh
from mcclient.inbox import Inbox
from mcclient.transport import configuration
from zenoh.ext import CacheConfig, MissDetectionConfig, declare_advanced_publisher

from mcserver.ros.graph import DEFAULT_QOS, Attachment, Entity, Kind, NodeName, Qos, gid_of, read_attachment
from mcserver.ros.interfaces import MalformedPayload, interfaces

log = logging.getLogger(__name__)

# Requests of one service under way: a client asks for the result of each of its goals as it sends it.
REQUESTS_AT_ONCE = 64
WAITING = 128
# It takes some milliseconds to read.
LARGE_BYTES = 64 * 1024

Answer = Callable[[Any], Awaitable[Any]]


class RosSession:
    """A session of Zenoh for any number of nodes; used from the loop that opened it."""

    def __init__(self, session: zenoh.Session, domain: int) -> None:
        self.zenoh = session
        self.domain = domain
        self.numbers = itertools.count()

    @classmethod
    async def open(
        cls, endpoints: tuple[str, ...], domain: int, *, timeout_s: float, config_file: Path | None
    ) -> RosSession:
        """Connect as a client of Zenoh.

        Raises:
            mcclient.ConfigurationError: MC537. zenoh.ZError: nothing listens at the endpoints.
        """
        config = configuration(endpoints, timeout_s, config_file)
        # transient local publishers number their messages by time
        config.insert_json5("timestamping/enabled", json.dumps(True))
        return cls(await asyncio.to_thread(zenoh.open, config), domain)

    async def close(self) -> None:
        with contextlib.suppress(zenoh.ZError):
            await asyncio.to_thread(self.zenoh.close)

    def node(self, namespace: str, name: str) -> Node:
        """Return a new node."""
        zid = str(self.zenoh.info.zid())
        return Node(self, NodeName(self.domain, zid, next(self.numbers), namespace, name))


class Publisher:
    """Messages of one type on one topic."""

    def __init__(self, publisher: Any, kind: str, gid: bytes) -> None:
        self._publisher = publisher
        self._kind = kind
        self._gid = gid
        self._number = 0

    def publish(self, message: Any) -> None:
        """Send a message; where the network does not take it, it is lost."""
        self.publish_payload(interfaces().encode(self._kind, message))

    def publish_payload(self, payload: bytes) -> None:
        """Send a message that is encoded already."""
        self._number += 1
        attachment = Attachment(self._number, time.time_ns(), self._gid)
        try:
            self._publisher.put(payload, attachment=attachment.encoded())
        except zenoh.ZError as error:
            log.debug("a message of %s was not sent: %s", self._kind, error)


class Node:
    """A node, in the graph from its making to `close`."""

    def __init__(self, session: RosSession, name: NodeName) -> None:
        self._session = session
        self._loop = asyncio.get_running_loop()
        self.name = name
        self._declared: list[Any] = [session.zenoh.liveliness().declare_token(name.token())]
        # under way, a set for each service: those who wait for results keep nobody from cancelling
        self._answers: list[set[asyncio.Task[None]]] = []

    def publisher(self, topic: str, kind: str, qos: Qos = DEFAULT_QOS) -> Publisher:
        """Declare a publisher; a relative topic is below the node's namespace."""
        entity, gid = self._entity(Kind.PUBLISHER, topic, kind, qos)
        reliability = zenoh.Reliability.RELIABLE if qos.reliable else zenoh.Reliability.BEST_EFFORT
        options: dict[str, Any] = {
            "congestion_control": zenoh.CongestionControl.DROP,
            "reliability": reliability,
        }
        key = self.name.key_of(entity)
        made: Any
        if qos.transient_local:
            made = declare_advanced_publisher(
                self._session.zenoh,
                key,
                cache=CacheConfig(max_samples=qos.depth),
                publisher_detection=True,
                sample_miss_detection=MissDetectionConfig(heartbeat=None, sporadic_heartbeat=None),
                **options,
            )
        else:
            made = self._session.zenoh.declare_publisher(key, **options)
        self._declared.append(made)
        return Publisher(made, kind, gid)

    def subscribe(
        self, topic: str, kind: str, deliver: Callable[[bytes, bytes], None], qos: Qos = DEFAULT_QOS
    ) -> None:
        """Call ``deliver`` in the loop with each payload and its publisher's gid, which is empty if it has
        none; of those that wait the newest are kept.
        """
        entity, _ = self._entity(Kind.SUBSCRIPTION, topic, kind, qos)
        inbox: Inbox[tuple[bytes, bytes]] = Inbox(self._loop, lambda each: deliver(*each), limit=qos.depth)

        def on_sample(sample: zenoh.Sample) -> None:
            sent = None if sample.attachment is None else read_attachment(sample.attachment.to_bytes())
            inbox.push((sample.payload.to_bytes(), b"" if sent is None else sent.gid))

        callback = zenoh.handlers.Callback(on_sample, indirect=False)
        self._declared.append(self._session.zenoh.declare_subscriber(self.name.key_of(entity), callback))

    def serve(self, service: str, kind: str, answer: Answer) -> None:
        """Answer requests with what ``answer`` returns; what it raises is the reply of an error."""
        entity, _ = self._entity(Kind.SERVICE, service, kind, DEFAULT_QOS)
        under_way: set[asyncio.Task[None]] = set()
        self._answers.append(under_way)

        def begin(query: zenoh.Query) -> None:
            if len(under_way) >= REQUESTS_AT_ONCE:
                with query:
                    query.reply_err("too many requests wait")
                return
            task = self._loop.create_task(self._answer(query, kind, answer))
            under_way.add(task)
            task.add_done_callback(under_way.discard)

        inbox: Inbox[zenoh.Query] = Inbox(self._loop, begin, limit=WAITING)
        callback = zenoh.handlers.Callback(inbox.push, indirect=False)
        key = self.name.key_of(entity)
        self._declared.append(self._session.zenoh.declare_queryable(key, callback, complete=True))

    async def close(self) -> None:
        """Leave the graph; answers that are due within a moment are still given."""
        answers = [task for each in self._answers for task in each]
        if answers:
            await asyncio.wait(answers, timeout=0.2)
        for task in answers:
            task.cancel()
        await asyncio.gather(*answers, return_exceptions=True)
        for each in reversed(self._declared):
            with contextlib.suppress(zenoh.ZError):
                each.undeclare()
        self._declared.clear()

    def _entity(self, which: Kind, name: str, kind: str, qos: Qos) -> tuple[Entity, bytes]:
        absolute = name if name.startswith("/") else f"{self.name.namespace}/{name}"
        entity = Entity(which, absolute, kind, interfaces().type_hash(kind), qos)
        token = self.name.token_of(entity, next(self._session.numbers))
        self._declared.append(self._session.zenoh.liveliness().declare_token(token))
        return entity, gid_of(token)

    async def _answer(self, query: zenoh.Query, kind: str, answer: Answer) -> None:
        with query:
            try:
                payload = b"" if query.payload is None else query.payload.to_bytes()
                request = await decoded(f"{kind}_Request", payload)
                reply = interfaces().encode(f"{kind}_Response", await answer(request))
            except MalformedPayload as error:
                query.reply_err(f"no request of {kind}: {error}")
                return
            except Exception:
                log.exception("a request of %s failed", kind)
                query.reply_err(f"{kind} failed")
                return
            asked = None if query.attachment is None else read_attachment(query.attachment.to_bytes())
            number, gid = (0, bytes(16)) if asked is None else (asked.number, asked.gid)
            with contextlib.suppress(zenoh.ZError):
                query.reply(
                    query.key_expr, reply, attachment=Attachment(number, time.time_ns(), gid).encoded()
                )


async def decoded(kind: str, payload: bytes) -> Any:
    """Read a payload, a large one beside the loop: trajectories that are under way need it.

    Raises:
        MalformedPayload: it is none of this type.
    """
    if len(payload) < LARGE_BYTES:
        return interfaces().decode(kind, payload)
    return await asyncio.to_thread(interfaces().decode, kind, payload)
