"""The bridge at a real broker (mosquitto): what arrives, over a kill of the broker, and at the end."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path

import aiomqtt
import pytest

from mcserver.mqtt.bridge import Bridge, Broker
from mcserver.mqtt.payload import BOOLEAN, Metric, decoded, encoded
from mcserver.mqtt.publishers import REBIRTH, PlainTopics, Publisher, SparkplugNode
from tests.bench.server import free_port

LIMIT_S = 60.0
VALUES = {"state": "ready", "axes/X/position": 1.0}


class Mosquitto:
    """A broker that a test may end and start, always at one port."""

    def __init__(self, folder: Path) -> None:
        self.port = free_port()
        self._config = folder / "mosquitto.conf"
        self._config.write_text(f"listener {self.port} 127.0.0.1\nallow_anonymous true\n")
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        self._process = subprocess.Popen(["mosquitto", "-c", str(self._config)], stderr=subprocess.DEVNULL)
        for _ in range(600):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1.0):
                return
            assert self._process.poll() is None
            threading.Event().wait(0.05)

    def kill(self) -> None:
        assert self._process is not None
        self._process.kill()
        self._process.wait()


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[Mosquitto]:
    if shutil.which("mosquitto") is None:
        pytest.skip("mosquitto is not installed")
    broker = Mosquitto(tmp_path)
    broker.start()
    yield broker
    broker.kill()


@asynccontextmanager
async def bridged(mosquitto: Mosquitto, publisher: Publisher) -> AsyncIterator[Bridge]:
    """A bridge without machines, which the test shows it."""
    bridge = Bridge(publisher, 1.0)
    running = asyncio.ensure_future(bridge.keep_connected(Broker("127.0.0.1", mosquitto.port)))
    yield bridge
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def heard(mosquitto: Mosquitto, topic: str, count: int) -> list[tuple[str, bytes]]:
    """The next messages; a broker that is not there yet is asked again."""
    found: list[tuple[str, bytes]] = []
    async with asyncio.timeout(LIMIT_S):
        while True:
            try:
                async with aiomqtt.Client("127.0.0.1", mosquitto.port) as client:
                    await client.subscribe(topic, qos=1)
                    async for message in client.messages:
                        assert isinstance(message.payload, bytes)
                        found.append((str(message.topic), message.payload))
                        if len(found) == count:
                            return found
            except aiomqtt.MqttError:
                await asyncio.sleep(0.1)


async def test_states_are_there_for_who_comes_later_and_after_a_kill_of_the_broker(
    mosquitto: Mosquitto,
) -> None:
    async with bridged(mosquitto, PlainTopics("mc")) as bridge:
        await bridge.see({"cell-1": VALUES})
        assert dict(await heard(mosquitto, "mc/status", 1)) == {"mc/status": b"online"}
        assert (await heard(mosquitto, "mc/cell-1/availability", 1))[0][1] == b"online"
        mosquitto.kill()
        await bridge.see({"cell-1": {**VALUES, "axes/X/position": 2.0}})
        mosquitto.start()
        ((_, state),) = await heard(mosquitto, "mc/cell-1/state", 1)
        assert state == b'{"state":"ready","axes":{"X":{"position":2.0}}}'
        await bridge.see({})
        assert (await heard(mosquitto, "mc/cell-1/availability", 1))[0][1] == b"offline"
    assert (await heard(mosquitto, "mc/status", 1))[0][1] == b"offline"


async def test_a_host_that_asks_for_a_rebirth_gets_it_in_order(mosquitto: Mosquitto) -> None:
    async with bridged(mosquitto, SparkplugNode("site", "cell", time.time)) as bridge:
        await bridge.see({"cell-1": VALUES})
        hearing = asyncio.ensure_future(heard(mosquitto, "spBv1.0/site/+/cell/cell-1", 1))
        rebirth = _rebirth()
        async with asyncio.timeout(LIMIT_S), aiomqtt.Client("127.0.0.1", mosquitto.port) as host:
            while not hearing.done():
                await host.publish("spBv1.0/site/NCMD/cell", rebirth)
                await asyncio.wait([hearing], timeout=0.3)
    ((topic, payload),) = hearing.result()
    assert topic == "spBv1.0/site/DBIRTH/cell/cell-1"
    birth = decoded(payload)
    assert birth.seq == 1
    assert [each.name for each in birth.metrics] == list(VALUES)


def _rebirth() -> bytes:
    return encoded([Metric(REBIRTH, 0, BOOLEAN, True, time.time())], wall=time.time(), seq=None)
