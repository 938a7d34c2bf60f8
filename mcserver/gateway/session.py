"""One client of the gateway, with a Zenoh session of its own: leases and access rules see it as a client.

It outlives its connection by `GRACE_S`, or by the longest grace of its programs: who comes back within it
takes it up again. Its liveliness token goes with the connection and comes back with it, so that how long a
program waits for its client is the program's own grace, as for clients without a gateway.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import secrets
import time
from collections import deque
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import msgspec
import zenoh
from mcclient.calls import ATTEMPT_S, Caller
from mcclient.discovery import machines, new_client_id
from mcclient.errors import MotionError, RequestRefused
from mcclient.estop import send_until_confirmed
from mcclient.keys import Keys, is_name, live_key, server_of
from mcclient.presence import Presence
from mcclient.transport import Arrived, Link, Subscription, endpoints_of

from mcserver.gateway import frames
from mcserver.gateway.tokens import Principal
from mcserver.net.method_table import BY_NAME, PROMPT_S
from mcserver.net.roles import ASKERS, roles_named

log = logging.getLogger(__name__)

GRACE_S = 10.0
LONGEST_GRACE_S = 600.0
LEAVE_S = 1.0
# the client's own request numbers, apart from those that the gateway gives
CLIENT_NUMBERS = 2**54
CONNECT_S = 3.0
LOOK_S = 1.0
# of one client; what is more is refused with MC071
CALLS_A_SECOND = 200.0
CALLS_AT_ONCE = 400.0
CALLS_UNDER_WAY = 64
STOPS_UNDER_WAY = 16
# messages of targets, apart from calls; what is more is dropped, as on a link that is full
TARGETS_A_SECOND = 2000.0
TARGETS_AT_ONCE = 400.0
SUBSCRIPTIONS = 64
MACHINES = 16
# of messages that wait for a slow reader; the oldest of a topic that may be lost goes first
WAITING_MESSAGES = 256
WAITING_BYTES = 4 * 1024 * 1024
LOSSY = frozenset({"state", "samples"})


class SlowReader(Exception):
    """What must not be lost cannot be delivered: the connection is closed, and the client asks again."""


class Outbox:
    """Frames that wait for the connection: bounded in number and bytes.

    A message of a lossy topic makes room by being dropped, and the next one of its subscription says how many
    were; for all others a full outbox is the end of the connection.
    """

    def __init__(self) -> None:
        self._frames: deque[tuple[int | None, bytes]] = deque()
        self._bytes = 0
        self._missed: dict[int, int] = {}
        self._arrived = asyncio.Event()
        self._taken = asyncio.Event()
        self.overrun = False

    def put(self, frame: object) -> None:
        """A reply, or a message that may not be lost."""
        self._append(None, msgspec.msgpack.encode(frame))

    def put_message(self, subscription: int, payload: bytes, *, lossy: bool) -> None:
        if lossy and self._is_full:
            self._drop_oldest(subscription)
        missed = self._missed.pop(subscription, 0) if lossy else 0
        frame = frames.Message(subscription, msgspec.Raw(payload), missed)
        self._append(subscription if lossy else None, msgspec.msgpack.encode(frame))

    async def take(self) -> bytes:
        """Return the next frame. Raises SlowReader once something was lost that may not be."""
        while not self._frames:
            if self.overrun:
                raise SlowReader
            self._arrived.clear()
            await self._arrived.wait()
        if self.overrun:
            raise SlowReader
        _, frame = self._frames.popleft()
        self._bytes -= len(frame)
        self._taken.set()
        return frame

    async def room(self) -> None:
        """Wait until replies fit: who does not read them is not read from."""
        while self._is_full and not self.overrun:
            self._taken.clear()
            await self._taken.wait()

    def clear(self) -> None:
        """Forget what waited for a connection that is gone."""
        self._frames.clear()
        self._missed.clear()
        self._bytes, self.overrun = 0, False
        self._taken.set()

    @property
    def _is_full(self) -> bool:
        return len(self._frames) >= WAITING_MESSAGES or self._bytes >= WAITING_BYTES

    def _append(self, subscription: int | None, frame: bytes) -> None:
        if subscription is None and (
            len(self._frames) >= 2 * WAITING_MESSAGES or self._bytes >= 2 * WAITING_BYTES
        ):
            self.overrun = True
        else:
            self._frames.append((subscription, frame))
            self._bytes += len(frame)
        self._arrived.set()

    def _drop_oldest(self, subscription: int) -> None:
        for index, (owner, frame) in enumerate(self._frames):
            if owner is not None:
                del self._frames[index]
                self._bytes -= len(frame)
                self._missed[owner] = self._missed.get(owner, 0) + 1
                return
        self._missed[subscription] = self._missed.get(subscription, 0) + 1


class Budget:
    """A token bucket: so many a second in the long run, so many at once in a burst."""

    def __init__(self, a_second: float, at_once: float) -> None:
        self._a_second, self._at_once = a_second, at_once
        self._tokens = at_once
        self._at = time.monotonic()

    def take(self) -> bool:
        now = time.monotonic()
        self._tokens = min(self._at_once, self._tokens + (now - self._at) * self._a_second)
        self._at = now
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True


class Peer:
    """One machine as a session uses it."""

    def __init__(self, link: Link, name: str, client: str) -> None:
        self.presence = Presence(name)
        self.keys = Keys(name, client)
        self.caller = Caller(link, self.keys, self.presence)
        # it has opened something that ends with it; and what takes its token away, while that is there
        self.held = False
        self.drop_token: Callable[[], None] | None = None
        self.watch: Subscription | None = None


class GatewaySession:
    """A client's link, subscriptions and outbox.

    Attributes:
        client: its id in the key space. secret: takes the session up again.
        outbox: what waits for the connection.
    """

    def __init__(self, link: Link, client: str, principal: Principal) -> None:
        self.client = client
        self.secret = secrets.token_urlsafe(24)
        self.principal = principal
        self.outbox = Outbox()
        self.connection: object | None = None
        # calls by HTTP, which has no frames
        self.requests_under_way = 0
        # how long it may be taken up again after its connection
        self.grace_s = GRACE_S
        self._link = link
        self._peers: dict[str, Peer] = {}
        self._subscriptions: dict[int, Subscription] = {}
        self._budget = Budget(CALLS_A_SECOND, CALLS_AT_ONCE)
        self._targets_budget = Budget(TARGETS_A_SECOND, TARGETS_AT_ONCE)
        self._tasks: set[asyncio.Task[None]] = set()
        # messages of targets on their way
        self._puts: set[asyncio.Task[None]] = set()
        link.believe(lambda source: any(peer.presence.is_server(source) for peer in self._peers.values()))

    @classmethod
    async def open(
        cls, connect: tuple[str, ...], config_file: Path | None, principal: Principal
    ) -> GatewaySession:
        """Connect to the motion servers.

        Raises:
            MotionError: MC530 nothing answers there.
        """
        link = await Link.open(endpoints_of(connect or None), timeout_s=CONNECT_S, config_file=config_file)
        return cls(link, new_client_id(f"gw-{principal.name}"), principal)

    @property
    def has_opened(self) -> bool:
        """Whether it has opened a program, which would end with it."""
        return any(peer.held for peer in self._peers.values())

    def away(self) -> None:
        """The client's connection is gone: its programs' graces begin."""
        for peer in self._peers.values():
            if peer.drop_token is not None:
                peer.drop_token()
                peer.drop_token = None

    def back(self) -> None:
        """The client is connected again."""
        for peer in self._peers.values():
            if peer.held:
                self._declare(peer)

    async def leave(self) -> None:
        """The client has closed its connection on purpose: what it has opened ends as it chose."""
        for peer in self._peers.values():
            if peer.held:
                with contextlib.suppress(MotionError):
                    await peer.caller.call("leave", deadline_s=LEAVE_S)

    def _declare(self, peer: Peer) -> None:
        if peer.drop_token is None:
            peer.drop_token = self._link.declare_token(peer.keys.token)

    async def close(self) -> None:
        """End the link; the client's token goes with it."""
        tasks = [*self._tasks, *self._puts]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await self._link.close()

    # ------------------------------------------------------------ frames in

    def handle(self, request: frames.Request) -> None:
        """One frame of the client; whatever is wrong with it is answered."""
        if isinstance(request, frames.Unsubscribe):
            self._unsubscribe(request.id)
            return
        if isinstance(request, frames.Targets):
            if self._targets_budget.take() and len(self._puts) < CALLS_UNDER_WAY:
                _track(self._put_targets(request), self._puts)
            return
        try:
            self.admit(len(self._tasks), stop=isinstance(request, frames.Estop))
        except RequestRefused as refusal:
            self._refuse(request.id, refusal)
            return
        _track(self._answer(request), self._tasks)

    async def _put_targets(self, request: frames.Targets) -> None:
        # whoever opened the program has called this machine before
        peer = self._peers.get(request.machine)
        if peer is None or not is_name(request.program) or self.principal.role not in ASKERS:
            return
        await self._link.put(
            peer.keys.lines_in(request.program),
            bytes(request.message),
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
            drop=True,
        )

    def admit(self, under_way: int, *, stop: bool = False) -> None:
        """See whether one more call may be made; emergency stops have places of their own.

        Raises:
            RequestRefused: MC071 too many at once, or in a second.
        """
        places = CALLS_UNDER_WAY + (STOPS_UNDER_WAY if stop else 0)
        if under_way >= places or not (self._budget.take() or stop):
            raise RequestRefused(
                "MC071", "too many calls at once", "wait for the replies", details={"limit": CALLS_A_SECOND}
            )

    async def _answer(self, request: frames.Call | frames.Subscribe | frames.Estop | frames.Machines) -> None:
        try:
            value = await self._carry_out(request)
        except MotionError as error:
            self._refuse(request.id, error)
        except Exception as error:
            log.exception("a frame could not be handled")
            self._refuse(
                request.id, MotionError("MC516", f"the gateway made a mistake: {error}", "see its log")
            )
        else:
            self.outbox.put(frames.Reply(request.id, True, value))

    async def _carry_out(
        self, request: frames.Call | frames.Subscribe | frames.Estop | frames.Machines
    ) -> Any:
        if isinstance(request, frames.Machines):
            return await self.machine_names()
        if isinstance(request, frames.Estop):
            await self.emergency_stop(request.machine, request.reason, request.request)
            return None
        if isinstance(request, frames.Subscribe):
            await self._subscribe(request)
            return None
        payload = await self.call(request.machine, request.method, request.params, request.request)
        return msgspec.Raw(payload)

    async def call(
        self, machine: str, method: str, params: dict[str, Any], request: int | None = None
    ) -> bytes:
        """Return a method's reply, as it came.

        Raises:
            MotionError: MC501 no such method, MC072 the role does not allow it; what `Caller.call` raises.
        """
        described = BY_NAME.get(method)
        if described is None:
            raise RequestRefused("MC501", f"there is no method {method!r}", "see `info`")
        if self.principal.role not in described.roles:
            raise RequestRefused(
                "MC072",
                f"{method} needs the role {roles_named(described.roles)}, {self.principal.name} is "
                f"{self.principal.role.value}",
                "use a token that has it",
            )
        peer = await self.peer(machine)
        if described.held:
            # before the first program or request: the server ends those whose token has gone
            peer.held = True
            self._declare(peer)
            grace_s = params.get("grace_s")
            if isinstance(grace_s, int | float) and math.isfinite(grace_s):
                self.grace_s = max(self.grace_s, min(float(grace_s), LONGEST_GRACE_S))
        limit = described.deadline_s
        fields = {key: value for key, value in params.items() if key not in ("client", "request")}
        if request is not None:
            fields["request"] = CLIENT_NUMBERS + request
        return await peer.caller.call(
            method, fields, deadline_s=limit, attempt_s=ATTEMPT_S if limit == PROMPT_S else limit
        )

    async def machine_names(self) -> list[str]:
        """Return the machines that are there."""
        return await machines(self._link, timeout_s=CONNECT_S)

    async def emergency_stop(self, machine: str, reason: str, number: int | None = None) -> None:
        """Stop a machine; return once it has confirmed. Whoever may look may stop.

        Args:
            number: that all copies of this stop have.
        """
        peer = await self.peer(machine)
        await send_until_confirmed(self._link, peer.keys, reason=reason, timeout_s=PROMPT_S, number=number)

    async def peer(self, name: str) -> Peer:
        """One machine, looked for on first use.

        Raises:
            MotionError: MC530 it is not there, MC537 it is no name, MC071 too many machines.
        """
        peer = self._peers.get(name)
        if peer is None:
            key = live_key(name)
            if len(self._peers) >= MACHINES:
                raise RequestRefused("MC071", f"{MACHINES} machines are in use", "use another connection")
            peer = self._peers[name] = Peer(self._link, name, self.client)
            peer.watch = self._link.watch_tokens(key, peer.presence.on_token)
        if not await peer.presence.wait_online(LOOK_S):
            raise MotionError(
                "MC530", f"no machine {name!r} is there", "the frame `machines` lists those that are"
            )
        return peer

    # ------------------------------------------------------------ subscriptions

    async def _subscribe(self, request: frames.Subscribe) -> None:
        if len(self._subscriptions) >= SUBSCRIPTIONS:
            raise RequestRefused("MC071", f"{SUBSCRIPTIONS} subscriptions are open", "end some of them")
        peer = await self.peer(request.machine)
        keys, topic = peer.keys, request.topic
        lossy = topic in LOSSY

        def deliver(arrived: Arrived) -> None:
            self.outbox.put_message(request.id, arrived.payload, lossy=lossy)

        def deliver_presence(arrived: Arrived) -> None:
            instance = server_of(arrived.key).instance
            payload = msgspec.msgpack.encode({"online": not arrived.gone, "instance": instance})
            self.outbox.put_message(request.id, payload, lossy=False)

        self._unsubscribe(request.id)
        kind, _, program = topic.partition("/")
        if topic == "presence":
            subscription = self._link.watch_tokens(keys.live, deliver_presence)
        elif topic == "events":
            subscription = self._link.subscribe_recovering(keys.event, deliver, limit=4096)
        elif kind == "ack" and is_name(program):
            subscription = self._link.subscribe(keys.ack(program), deliver, limit=64)
        elif topic in LOSSY:
            subscription = self._link.subscribe(
                keys.state if topic == "state" else keys.samples, deliver, limit=256
            )
        else:
            raise RequestRefused(
                "MC073", f"there is no topic {topic!r}", "state, samples, events, presence or ack/{program}"
            )
        self._subscriptions[request.id] = subscription

    def _unsubscribe(self, number: int) -> None:
        subscription = self._subscriptions.pop(number, None)
        if subscription is not None:
            subscription.close()

    def end_subscriptions(self) -> None:
        """End all of them: their connection is gone, and a new one subscribes anew."""
        for number in list(self._subscriptions):
            self._unsubscribe(number)
        self.outbox.clear()

    def _refuse(self, number: int, error: MotionError) -> None:
        self.outbox.put(frames.Reply(number, False, None, error_map(error)))


def _track(work: Coroutine[Any, Any, None], tasks: set[asyncio.Task[None]]) -> None:
    """Carry on beside the connection; it is one of the tasks until it is done."""
    task = asyncio.ensure_future(work)
    tasks.add(task)
    task.add_done_callback(tasks.discard)


def error_map(error: MotionError) -> dict[str, Any]:
    """Return an error as the `ErrorReply` of the key space."""
    return {
        "code": error.code,
        "message": error.message,
        "hint": error.hint,
        "details": dict(error.details),
        "diagnostics": [msgspec.to_builtins(each) for each in error.diagnostics],
    }
