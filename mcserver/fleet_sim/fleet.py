"""Many light machines behind one Zenoh session; a process has one of these."""

from __future__ import annotations

import json
import logging
import secrets
import threading
import time
from collections.abc import Callable
from functools import partial

import msgspec
import zenoh

from mcserver.errors import McError, ServiceError
from mcserver.fleet_sim.light_machine import LightMachine
from mcserver.net import qos
from mcserver.net.configuration import NetworkOptions, main_configuration, plain, reach
from mcserver.net.decoding import MessageDecoder
from mcserver.net.defects import DefectLog
from mcserver.net.keys import Keys
from mcserver.net.messages import EstopRequest, StreamLines
from mcserver.net.replies import ReplySender
from mcserver.net.rpc import RpcServer
from mcserver.net.session import CLOSE_LIMIT_S, ZenohSession
from mcserver.service.reports import Ack, Event

log = logging.getLogger(__name__)

# a program that runs says how far it has come so often [s]
PROGRESS_S = 0.1


class FleetOptions(msgspec.Struct, frozen=True):
    """What a process simulates.

    Attributes:
        first, machines: numbers of its machines, from ``first`` on. prefix: of their names.
        axes: of each. state_hz: how often each publishes its state while someone subscribes.
        line_s: how long a line of a program takes.
        connect, listen: endpoints. config_file: a Zenoh configuration.
    """

    machines: int
    first: int = 1
    prefix: str = "sim"
    axes: int = 6
    state_hz: float = 5.0
    line_s: float = 0.1
    network: NetworkOptions = NetworkOptions()


class LightFleet:
    """The machines of one process.

    Args:
        instance: of each, its present start.
    """

    def __init__(self, session: zenoh.Session, instance: str, options: FleetOptions) -> None:
        self._session = session
        self._wrapped = ZenohSession(session)
        self._options = options
        self._instance = instance
        self._encode = msgspec.msgpack.Encoder().encode
        self._failed = DefectLog(log)
        # all machines of the process: each is used by one thread at a time
        self._lock = threading.Lock()
        self._ending = threading.Event()
        self._machines: list[LightMachine] = []
        self._states: list[Callable[[], None]] = []
        self._replies = ReplySender()

    def start(self) -> None:
        """Declare every machine, its token last."""
        for number in range(self._options.first, self._options.first + self._options.machines):
            self._add(f"{self._options.prefix}-{number:05d}")

    def run(self) -> None:
        """Let time pass and publish states until `stop`; the machines take turns within each period."""
        period = 1.0 / self._options.state_hz
        start, turn = time.monotonic(), 0
        count = len(self._machines)
        progressed = 0.0
        while not self._ending.wait(max(0.0, start + turn * period / count - time.monotonic())):
            # after a pause of the whole computer it goes on from now
            turn = max(turn + 1, int((time.monotonic() - start - 1.0) * count / period))
            self._states[turn % count]()
            now = time.monotonic()
            if now - progressed >= PROGRESS_S:
                progressed = now
                with self._lock:
                    for machine in self._machines:
                        machine.advance()

    def stop(self) -> None:
        self._ending.set()

    def close(self) -> None:
        """End the threads that send replies, once the session is closed."""
        self._replies.close()
        self._replies.join(CLOSE_LIMIT_S)

    def _add(self, name: str) -> None:
        keys = Keys(name)
        session = self._wrapped
        publish = partial(self._publish, keys)
        machine = LightMachine(
            name,
            self._instance,
            axes=self._options.axes,
            line_s=self._options.line_s,
            clock=time.time,
            on_ack=lambda ack: publish(keys.ack(ack.program), ack, qos.ACK),
            on_event=lambda event: publish(keys.event, event, qos.EVENT),
        )
        rpc = RpcServer(keys, machine.handlers(), self._replies)
        states = session.matched_publisher(keys.telemetry_state, qos.STATE)
        decode_lines, decode_stop = MessageDecoder(StreamLines), MessageDecoder(EstopRequest)

        def on_query(query: zenoh.Query) -> None:
            with self._lock:
                rpc.on_query(query)

        def on_lines(sample: zenoh.Sample) -> None:
            stream = keys.stream_of(str(sample.key_expr))
            if stream is None:
                return
            try:
                message = decode_lines(sample.payload.to_bytes())
            except ServiceError as error:
                self._failed.add(f"{name}: {error.message}")
                return
            with self._lock:
                machine.stream(*stream, message.first, message.lines)

        def on_stop(sample: zenoh.Sample) -> None:
            if not keys.is_stop(str(sample.key_expr)):
                return
            request = EstopRequest()
            payload = sample.payload.to_bytes()
            if payload:
                try:
                    request = decode_stop(payload)
                except McError as error:
                    self._failed.add(f"{name}: {error.message}")
            with self._lock:
                machine.emergency_stop(request.client, request.reason)

        def put_state() -> None:
            if states.wanted:
                with self._lock:
                    payload = self._encode(machine.status())
                states.put(payload)

        session.subscribe(keys.emergency_stop, on_stop)
        session.subscribe(keys.lines_in("*", "*"), on_lines)
        session.queryable(keys.rpc("*", "*"), on_query)
        session.queryable(keys.info, on_query)
        session.token(keys.live(self._instance, session.zenoh_id))
        self._machines.append(machine)
        self._states.append(put_state)

    def _publish(self, keys: Keys, key: str, message: Ack | Event, how: qos.Qos) -> None:
        try:
            self._session.put(
                key,
                self._encode(message),
                priority=how.priority,
                congestion_control=how.congestion,
                express=how.express,
            )
        except zenoh.ZError as error:
            self._failed.add(f"{keys.machine}: nothing could be published: {error}")


def open_fleet(options: FleetOptions) -> tuple[zenoh.Session, LightFleet]:
    """Open a session and declare its machines.

    Raises:
        ServiceError: MC075 the session cannot be opened. ConfigurationError: MC521.
    """
    instance = f"{int(time.time()):x}{secrets.token_hex(3)}"
    where = reach(options.network)
    config = main_configuration(options.network, where)
    # whoever asks for a fleet wants it at that router, not some day
    config.insert_json5("connect/timeout_ms", json.dumps(10_000))
    config.insert_json5("connect/exit_on_failure", json.dumps(True))
    try:
        session = zenoh.open(config)
    except zenoh.ZError as error:
        raise ServiceError(
            "MC075",
            f"the fleet cannot reach its network: {plain(error)}",
            "is the router there? see --connect and --listen",
        ) from error
    fleet = LightFleet(session, instance, options)
    fleet.start()
    return session, fleet
