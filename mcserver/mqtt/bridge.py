"""The bridge's process: states of all machines to a broker, again whenever it or the machines were away."""

from __future__ import annotations

import asyncio
import logging
import ssl
from collections.abc import Iterable, Mapping
from pathlib import Path

import aiomqtt
import msgspec
from mcclient import MachineStatus
from mcclient.fleet import FleetLink, keep_states

from mcserver.mqtt.metrics import Value, metrics_of
from mcserver.mqtt.publishers import Message, Publisher

log = logging.getLogger(__name__)

RETRY_S = 2.0
SEND_S = 10.0
# between two births that the other side asks for
REBIRTH_S = 1.0


class Broker(msgspec.Struct, frozen=True):
    """Where the broker is. ``tls``: whose certificates it may show; None: it is reached without."""

    host: str
    port: int
    tls: ssl.SSLContext | None = None
    user: str | None = None
    password: str | None = None


class Bridge:
    """Values of the machines as they were last seen, and the connection to the broker while there is one."""

    def __init__(self, publisher: Publisher, period_s: float) -> None:
        self._publisher = publisher
        self._period_s = period_s
        self._machines: dict[str, dict[str, Value]] = {}
        self._client: aiomqtt.Client | None = None
        self._broken = asyncio.Event()
        # a state and a birth are not sent in between each other
        self._order = asyncio.Lock()

    async def run(self, broker: Broker, connect: tuple[str, ...], config_file: Path | None) -> None:
        """Run until it is cancelled."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self.keep_connected(broker))
            watching = keep_states(
                self._look, period_s=self._period_s, connect=connect, config_file=config_file
            )
            group.create_task(watching)

    async def see(self, states: Mapping[str, Mapping[str, Value]]) -> None:
        """Publish what is other than before."""
        async with self._order:
            for machine in [name for name in self._machines if name not in states]:
                del self._machines[machine]
                await self._send(self._publisher.gone(machine))
            for machine, values in states.items():
                before = self._machines.get(machine)
                self._machines[machine] = dict(values)
                if before is None:
                    await self._send(self._publisher.appeared(machine, values))
                    continue
                changed = {name: value for name, value in values.items() if before.get(name) != value}
                if changed and self._client is None:
                    self._publisher.missed(machine, changed)
                elif changed:
                    await self._send(self._publisher.changed(machine, changed))

    async def _look(self, _: FleetLink, states: Mapping[str, MachineStatus]) -> None:
        await self.see({name: metrics_of(status) for name, status in states.items()})

    async def _send(self, messages: Iterable[Message]) -> None:
        client = self._client
        if client is None:
            return
        sending = asyncio.ensure_future(self._publish(client, messages))
        broken = asyncio.ensure_future(self._broken.wait())
        try:
            # a broker that has gone acknowledges nothing
            await asyncio.wait([sending, broken], return_when=asyncio.FIRST_COMPLETED)
        finally:
            broken.cancel()
            sending.cancel()
            (error,) = await asyncio.gather(sending, return_exceptions=True)
        if isinstance(error, (aiomqtt.MqttError, asyncio.CancelledError)):
            # what is not sent is said at the beginning of the next connection
            log.info("the broker does not take messages: %s", error)
            self._client = None
            self._broken.set()
        elif error is not None:
            raise error

    async def _publish(self, client: aiomqtt.Client, messages: Iterable[Message]) -> None:
        for each in messages:
            await client.publish(each.topic, each.payload, each.qos, each.retain, timeout=SEND_S)

    async def keep_connected(self, broker: Broker) -> None:
        said = ""
        while True:
            will = self._publisher.will()
            client = aiomqtt.Client(
                broker.host,
                broker.port,
                # a broker ends what it still has of a killed process, with its will, before it takes this one
                identifier=will.topic,
                username=broker.user,
                password=broker.password,
                will=aiomqtt.Will(will.topic, will.payload, will.qos, will.retain),
                tls_context=broker.tls,
                max_queued_incoming_messages=16,
                max_queued_outgoing_messages=1000,
            )
            try:
                async with client:
                    said = ""
                    await self._serve(client)
            except aiomqtt.MqttError as error:
                if str(error) != said:
                    said = str(error)
                    log.warning("no broker at %s:%d: %s; trying again", broker.host, broker.port, said)
            self._client = None
            await asyncio.sleep(RETRY_S)

    async def _serve(self, client: aiomqtt.Client) -> None:
        """Publish over a connection until it breaks."""
        self._broken.clear()
        reading = asyncio.ensure_future(self._obey(client))
        reading.add_done_callback(self._lose)
        try:
            if self._publisher.commands:
                await client.subscribe(self._publisher.commands)
            await self._begin(client)
            await self._broken.wait()
        finally:
            async with self._order:
                await self._send([self._publisher.end()])
                self._client = None
            reading.cancel()
        if reading.done():
            reading.result()

    def _lose(self, reading: asyncio.Task[None]) -> None:
        """Take why a connection has ended: only who reads is told."""
        self._broken.set()
        if not reading.cancelled():
            reading.exception()

    async def _obey(self, client: aiomqtt.Client) -> None:
        async for message in client.messages:
            payload = message.payload
            if isinstance(payload, bytes) and self._publisher.asks_for_rebirth(payload):
                await self._begin(client)
                await asyncio.sleep(REBIRTH_S)

    async def _begin(self, client: aiomqtt.Client) -> None:
        async with self._order:
            self._client = client
            await self._send(self._publisher.begin(self._machines))
