"""A machine on the network: its sessions, keys and traffic."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import msgspec
import zenoh

from mcserver.errors import ServiceError
from mcserver.net import qos
from mcserver.net.configuration import (
    NetworkOptions,
    Reach,
    emergency_configuration,
    has_free_port,
    main_configuration,
    reach,
)
from mcserver.net.decoding import MessageDecoder
from mcserver.net.defects import DefectLog
from mcserver.net.inbox import Inbox
from mcserver.net.keys import Keys, instance_of
from mcserver.net.link_watch import LinkWatch, accepts_connections
from mcserver.net.messages import EstopRequest, StreamLines
from mcserver.net.methods import machine_methods
from mcserver.net.publishing import PublishingThread
from mcserver.net.replies import ReplySender
from mcserver.net.rpc import RpcServer
from mcserver.net.servo_messages import StreamTargets
from mcserver.net.servo_methods import targets_in_si
from mcserver.net.session import CLOSE_LIMIT_S, Publication, ZenohSession, is_zenoh_fault
from mcserver.net.stop_copies import StopCopies
from mcserver.net.telemetry import CycleTelemetry, StateTelemetry
from mcserver.recorder.client import RecorderClient
from mcserver.service.jog import Jogging
from mcserver.service.reports import ENDED, Ack, Event
from mcserver.service.service import MachineService
from mcserver.service.servo import put_targets
from mcserver.simulation.program_checker import ProgramChecker

if TYPE_CHECKING:
    # needs the packages of CANopen
    from mcserver.canopen.access import OperatorAccess

log = logging.getLogger(__name__)

QUERIES = 2048
STREAMED_MESSAGES = 8192
TOKENS = 4096
CONFIRMATIONS = 64
# time for clients on the listening port to return with their tokens, after a new session was opened [s]
CLIENTS_RETURN_S = 5.0
# interval of checks that the sessions still receive
HEARING_LOOK_S = 0.5
# Largest payload of a stop that is decoded in Zenoh's thread; a larger one stops without it [bytes].
STOP_SIZE = 4096
# Looks for another server's token: a killed server's remains until its link's lease ends
# (`mcserver.net.configuration.LEASE_MS`).
TOKEN_LOOKS = 10
# Pause between these looks [s].
TOKEN_PAUSE_S = 0.5
NAME_REMEDY = "give one of them another name: they share the calls, and neither knows of the other's programs"


class Stop(NamedTuple):
    """A received emergency stop.

    Attributes:
        copy: whether it is a copy of a recent one.
    """

    request: EstopRequest
    copy: bool


class ClientTokens:
    """Tokens of living clients, tracked across changes of the session."""

    def __init__(self) -> None:
        self._alive: set[str] = set()
        self._expected: set[str] = set()

    def hear(self, client: str, *, gone: bool) -> None:
        """Note that a token has appeared or disappeared."""
        if gone:
            self._alive.discard(client)
        else:
            self._alive.add(client)

    def expect_again(self) -> None:
        """Expect all tokens again from another session."""
        self._expected |= self._alive
        self._alive = set()

    def missing(self) -> set[str]:
        """Return the clients whose tokens have not reappeared."""
        missing, self._expected = self._expected - self._alive, set()
        return missing


class MachineEndpoint:
    """Connects one `MachineService` to Zenoh. Runs in the loop, except callbacks in Zenoh's threads.

    Args:
        keys: of this machine.
        options, where: endpoints as requested, and as combined with the file.
        session: for everything but emergency stops from routers.
        emergency: session for those; None if nothing is connected to.
    """

    def __init__(
        self,
        keys: Keys,
        options: NetworkOptions,
        where: Reach,
        session: ZenohSession,
        emergency: ZenohSession | None,
    ) -> None:
        self.keys = keys
        self._options = options
        self._where = where
        self._session = session
        self._emergency = emergency
        self._loop = asyncio.get_running_loop()
        self._encode = msgspec.msgpack.Encoder().encode
        self._decode_lines = MessageDecoder(StreamLines)
        self._decode_targets = MessageDecoder(StreamTargets)
        self._decode_stop = MessageDecoder(EstopRequest)
        self._refused = DefectLog(log)
        self._events: Publication
        self._confirmations: Publication
        self._acks: dict[str, zenoh.Publisher]
        self._speak_through(session)
        self._rpc: RpcServer | None = None
        self._replies = ReplySender()
        self._publishing = PublishingThread("publishing")
        # a separate thread, so that the confirmation of a stop waits for nothing
        self._confirming = PublishingThread("confirming", CONFIRMATIONS)
        self._cycles: CycleTelemetry | None = None
        self._states: asyncio.Task[None] | None = None
        self._declare: Callable[[ZenohSession], None] = lambda _: None
        self._hear_stops: Callable[[ZenohSession], None] = lambda _: None
        self._watching: asyncio.Task[None] | None = None
        self._returning: asyncio.Task[None] | None = None
        self._reopening = asyncio.Lock()
        self._clients = ClientTokens()

    @classmethod
    async def open(cls, machine: str, options: NetworkOptions) -> MachineEndpoint:
        """Open the sessions; requests are not answered before `serve`.

        Raises:
            ServiceError: MC521, MC522.
        """
        where = reach(options)
        main = main_configuration(options, where)
        beside = emergency_configuration(options, where)
        session = await ZenohSession.open(main)
        try:
            emergency = await ZenohSession.open(beside) if beside is not None else None
        except BaseException:
            await session.close()
            raise
        endpoint = cls(Keys(machine), options, where, session, emergency)
        try:
            await endpoint._refuse_a_second_server()
        except BaseException:
            await endpoint.close()
            raise
        return endpoint

    async def _refuse_a_second_server(self) -> None:
        """Refuse if another server has this name; a killed one is known until its lease ends.

        Raises:
            ServiceError: MC528.
        """
        for pause_s in (*[TOKEN_PAUSE_S] * TOKEN_LOOKS, 0.0):
            others = await self._session.tokens(self.keys.servers)
            if not others:
                return
            await asyncio.sleep(pause_s)
        raise ServiceError("MC528", _second_server(self.keys, others[0]), NAME_REMEDY)

    async def endpoints(self) -> list[str]:
        """Return the endpoints that it listens on, with actual ports; a description if it only connects."""
        if any(has_free_port(endpoint) for endpoint in self._where.listen):
            return await self._session.endpoints()
        return list(self._where.listen) or [f"nothing, connecting to {', '.join(self._where.connect)}"]

    # ------------------------------------------------------------ out

    def publish_ack(self, ack: Ack) -> None:
        """Publish on the program's own key, with a publisher that lasts as long as the program."""
        try:
            publisher = self._acks.get(ack.program)
            if publisher is None:
                publisher = self._acks[ack.program] = self._session.publisher(
                    self.keys.ack(ack.program), qos.ACK
                )
            publisher.put(self._encode(ack))
            if ack.state in ENDED:
                del self._acks[ack.program]
                self._session.end(publisher)
        except BaseException as error:
            if not is_zenoh_fault(error):
                raise
            log.warning("an acknowledgement could not be published: %s", error)

    def publish_event(self, event: Event) -> None:
        payload = self._encode(event)
        if event.kind == "estop":
            # a stop's confirmation must not be dropped: send it also with blocking
            self._confirming.put(self._confirmations.put, payload)
        self._publishing.put(self._events.put, payload)

    # ------------------------------------------------------------ in

    def serve(
        self,
        service: MachineService,
        jogging: Jogging,
        checker: ProgramChecker,
        drives: OperatorAccess | None = None,
        recorder: RecorderClient | None = None,
    ) -> None:
        """Declare everything for clients, the liveliness token last."""
        keys, loop = self.keys, self._loop
        self._rpc = RpcServer(
            keys,
            machine_methods(service, jogging, checker, drives, recorder),
            self._replies,
        )
        rpc = self._rpc
        queries: Inbox[zenoh.Query] = Inbox(loop, rpc.on_query, limit=QUERIES, refuse=rpc.refuse)
        lines: Inbox[zenoh.Sample] = Inbox(loop, partial(self._on_lines, service), limit=STREAMED_MESSAGES)
        tokens: Inbox[zenoh.Sample] = Inbox(loop, partial(self._on_token, service), limit=TOKENS)
        stops: Inbox[Stop] = Inbox(loop, partial(self._on_stop, service), limit=64)
        servers: Inbox[zenoh.Sample] = Inbox(loop, partial(self._on_server, service), limit=TOKENS)
        strays: Inbox[zenoh.Sample] = Inbox(loop, partial(self._on_stray, service), limit=64)

        copies = StopCopies(time.monotonic)

        def stop(sample: zenoh.Sample) -> None:
            # in Zenoh's thread: the executor gets the stop before the loop's next turn
            if keys.is_stop(str(sample.key_expr)):
                request = self._stop_request(sample.payload.to_bytes())
                copy = copies.is_copy(request.request)
                if not copy:
                    service.port.orders.emergency_stop()
                stops.push(Stop(request, copy))
            else:
                strays.push(sample)

        def declare(session: ZenohSession) -> None:
            session.subscribe(keys.emergency_stop, stop)
            session.watch_tokens(keys.client("*"), tokens.push)
            session.subscribe(keys.lines_in("*", "*"), lines.push)
            session.queryable(keys.rpc("*", "*"), queries.push)
            session.queryable(keys.info, queries.push)
            self._cycles = CycleTelemetry(session, keys, service)
            states = StateTelemetry(session, keys, service, self._publishing)
            self._states = asyncio.ensure_future(states.run())
            session.token(keys.live(service.options.instance, session.zenoh_id))
            session.watch_tokens(keys.servers, servers.push)

        self._declare = declare
        self._hear_stops = lambda session: session.subscribe(keys.emergency_stop, stop)
        declare(self._session)
        if self._emergency is not None:
            self._hear_stops(self._emergency)
        self._watching = asyncio.ensure_future(self._watch(service))

    async def _watch(self, service: MachineService) -> None:
        # links on its listening ports were opened by others, who open them again with another session
        listened = await self.endpoints() if self._where.listen else []
        if listened:
            self._where = msgspec.structs.replace(self._where, listen=tuple(listened))
        links = LinkWatch(
            self._where.connect,
            lambda: self._session.link_sources(),
            listened,
            lambda: self._replace_session(service),
            accepts_connections,
        )
        async with asyncio.TaskGroup() as watches:
            watches.create_task(self._watch_sessions(service))
            if self._where.connect:
                watches.create_task(links.run())

    async def _watch_sessions(self, service: MachineService) -> None:
        """Replace sessions that Zenoh has made deaf; hold programs meanwhile, as nobody could stop them."""
        while True:
            await asyncio.sleep(HEARING_LOOK_S)
            main = await self._session.is_deaf()
            if not main and (self._emergency is None or not await self._emergency.is_deaf()):
                continue
            held = [program.program for program in service.hold(None)]
            if main:
                await self._replace_session(service)
            else:
                await self._replace_emergency_session()
            message = "a malformed message made a Zenoh session deaf; another one was opened in its place" + (
                f", and held are {', '.join(held)}: see that all is well, and resume" if held else ""
            )
            service.record_command("", "hold", detail=f"MC525: {message}")
            service.events.warn("MC525", message, level=logging.ERROR)

    async def _replace_emergency_session(self) -> None:
        assert self._emergency is not None
        await self._emergency.close()
        self._emergency = await self._opened_again(emergency_configuration)
        self._hear_stops(self._emergency)

    async def _replace_session(self, service: MachineService) -> None:
        """Replace the main session by one with another Zenoh id."""
        async with self._reopening:
            await self._stop_publishing()
            self._clients.expect_again()
            if self._where.listen:
                # only one session can have the port
                await self._session.close()
            former = self._session
            while True:
                self._session = await self._opened_again(main_configuration)
                try:
                    self._speak_through(self._session)
                    self._declare(self._session)
                    break
                except BaseException as error:
                    if not is_zenoh_fault(error):
                        raise
                    # made deaf again at once
                    log.warning("nothing can be declared: %s", error)
                    await self._stop_publishing()
                    await self._session.close()
                    await asyncio.sleep(TOKEN_PAUSE_S)
            if not self._where.listen:
                await former.close()
            if self._returning is not None:
                self._returning.cancel()
            self._returning = asyncio.ensure_future(self._forsake_missing(service))

    async def _forsake_missing(self, service: MachineService) -> None:
        await asyncio.sleep(CLIENTS_RETURN_S)
        for client in self._clients.missing():
            service.absences.gone(client)

    async def _opened_again(
        self, configuration: Callable[[NetworkOptions, Reach], zenoh.Config | None]
    ) -> ZenohSession:
        while True:
            try:
                config = configuration(self._options, self._where)
                assert config is not None
                return await ZenohSession.open(config)
            except ServiceError as error:
                # the system may keep the port in use for a moment
                log.error("%s: %s", error.code, error.message)
                await asyncio.sleep(TOKEN_PAUSE_S)

    def _speak_through(self, session: ZenohSession) -> None:
        self._events = session.recoverable_publisher(self.keys.event, qos.EVENT)
        self._confirmations = session.publisher(self.keys.event, qos.EMERGENCY_STOP)
        self._acks = {}

    async def _stop_publishing(self) -> None:
        """Stop what publishes on its own."""
        if self._states is not None:
            self._states.cancel()
            await asyncio.gather(self._states, return_exceptions=True)
        if self._cycles is not None:
            await asyncio.to_thread(self._cycles.close)

    async def close(self) -> None:
        """End everything, within a time limit."""
        for task in filter(None, (self._watching, self._returning)):
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        await self._stop_publishing()
        for thread in (self._publishing, self._confirming):
            await asyncio.to_thread(thread.close)
        if self._rpc is not None:
            await self._rpc.close()
        self._replies.close()
        if self._emergency is not None:
            await self._emergency.close()
        await self._session.close()
        await asyncio.to_thread(self._replies.join, CLOSE_LIMIT_S)

    def _on_lines(self, service: MachineService, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        stream = self.keys.stream_of(key)
        if stream is None:
            self._on_stray(service, sample)
            return
        client, program = stream
        payload = sample.payload.to_bytes()
        try:
            found = service.program(program)
            if found.client != client:
                raise ServiceError(
                    "MC504", f"{program} belongs to {found.client}", "open a program of your own"
                )
            if found.targets is not None:
                put_targets(service, found, targets_in_si(found, self._decode_targets(payload)))
                return
            message = self._decode_lines(payload)
        except ServiceError as error:
            if error.code != "MC503":
                self._warn(service, error.code, f"in/{client}/{program}: {error.message}")
            return
        service.lines.stream(program, message.first, message.lines, message.rejections)

    def _on_stray(self, service: MachineService, sample: zenoh.Sample) -> None:
        """Drop a put on a wildcard, such as ``mc/@v1/**``: it matches every key, so none is meant."""
        self._warn(service, "MC502", f"a put on {sample.key_expr} was ignored: it names no one key")

    def _warn(self, service: MachineService, code: str, message: str) -> None:
        # log-limited, since an event each would let a flood push all other events out of the event log
        if self._refused.add(message):
            service.events.publish("warning", reason=code, message=message)

    def _on_token(self, service: MachineService, sample: zenoh.Sample) -> None:
        client = str(sample.key_expr).rpartition("/")[2]
        gone = sample.kind == zenoh.SampleKind.DELETE
        self._clients.hear(client, gone=gone)
        if gone:
            service.absences.gone(client)
        else:
            service.absences.back(client)

    def _on_server(self, service: MachineService, sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT and instance_of(key) != service.options.instance:
            message = f"{_second_server(self.keys, key)}: {NAME_REMEDY}"
            service.events.warn("MC528", message, level=logging.ERROR)

    def _stop_request(self, payload: bytes) -> EstopRequest:
        """Decode a stop; whatever the payload is, it stops the machine."""
        if 0 < len(payload) <= STOP_SIZE:
            try:
                return self._decode_stop(payload)
            except ServiceError as error:
                self._refused.add(f"estop: {error.message}")
        return EstopRequest()

    def _on_stop(self, service: MachineService, stop: Stop) -> None:
        if stop.copy:
            service.latch.confirm_copy()
        else:
            service.latch.emergency_stop(stop.request.client, stop.request.reason)


def _second_server(keys: Keys, token: str) -> str:
    return f"another server of {keys.machine} is on the network, instance {instance_of(token)}"
