"""The bridge at a real broker (mosquitto): what arrives, over a kill of the broker, and at the end."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import importlib
import itertools
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import aiomqtt
import pytest

from mcserver.mqtt.bridge import Bridge, Broker
from mcserver.mqtt.publishers import PlainTopics, Publisher, SparkplugNode
from tests.bench.server import free_port
from tests.peers import python_peers

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


@pytest.fixture
def sparkplug(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A library of another make, which writes and reads what a host does."""
    monkeypatch.setattr(sys, "path", [*sys.path, str(python_peers())])
    return importlib.import_module("pysparkplug")


class Host:
    """A host application: names of metrics from the births that it hears, by the library's own reading."""

    def __init__(self, library: Any, mosquitto: Mosquitto) -> None:
        self._library = library
        self._mosquitto = mosquitto
        self.birth: Any = None

    def values(self, topic: str, payload: bytes) -> dict[str, Any]:
        kind = self._library.Topic.from_str(topic).message_type
        if kind is self._library.MessageType.DBIRTH:
            self.birth = found = self._library.DBirth.decode(payload)
            assert found.seq == 1
        else:
            assert kind is self._library.MessageType.DDATA
            found = self._library.DData.decode(payload, birth=self.birth)
        return {each.name: each.value for each in found.metrics}

    async def ask_for_births(self) -> dict[str, Any]:
        """The values of the first birth that follows; a broker that is not there yet is asked again."""
        rebirth = self._library.Metric(
            timestamp=0, name="Node Control/Rebirth", datatype=self._library.DataType.BOOLEAN, value=True
        )
        command = self._library.NCmd(timestamp=0, metrics=(rebirth,)).encode(include_dtypes=True)
        hearing = asyncio.ensure_future(heard(self._mosquitto, "spBv1.0/site/DBIRTH/cell/cell-1", 1))
        async with asyncio.timeout(LIMIT_S):
            while not hearing.done():
                with contextlib.suppress(aiomqtt.MqttError):
                    async with aiomqtt.Client("127.0.0.1", self._mosquitto.port) as client:
                        await client.publish("spBv1.0/site/NCMD/cell", command)
                await asyncio.wait([hearing], timeout=0.3)
        ((topic, payload),) = hearing.result()
        return self.values(topic, payload)


async def test_a_host_of_another_make_reads_births_and_data_and_again_after_a_kill_of_the_broker(
    mosquitto: Mosquitto, sparkplug: Any
) -> None:
    host = Host(sparkplug, mosquitto)
    async with bridged(mosquitto, SparkplugNode("site", "cell", time.time)) as bridge:
        await bridge.see({"cell-1": VALUES})
        assert await host.ask_for_births() == VALUES
        async with aiomqtt.Client("127.0.0.1", mosquitto.port) as client:
            await client.subscribe("spBv1.0/site/DDATA/#", qos=1)
            await bridge.see({"cell-1": {**VALUES, "axes/X/position": 2.0}})
            async with asyncio.timeout(LIMIT_S):
                message = await anext(aiter(client.messages))
        assert isinstance(message.payload, bytes)
        assert host.values(str(message.topic), message.payload) == {"axes/X/position": 2.0}
        mosquitto.kill()
        await bridge.see({"cell-1": {**VALUES, "axes/X/position": -3.0}})
        mosquitto.start()
        assert await host.ask_for_births() == {**VALUES, "axes/X/position": -3.0}


async def test_a_bridge_ends_with_its_broker_at_once_and_leaves_no_exception_behind(
    mosquitto: Mosquitto, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mcserver.mqtt.bridge.SEND_S", 10 * LIMIT_S)
    left: list[str] = []
    asyncio.get_running_loop().set_exception_handler(lambda _, context: left.append(context["message"]))
    for publisher in (PlainTopics("mc"), SparkplugNode("site", "cell", time.time)):
        async with asyncio.timeout(LIMIT_S), bridged(mosquitto, publisher) as bridge:
            hearing = asyncio.ensure_future(heard(mosquitto, "#", 1))
            positions = itertools.count(1.0)
            while not hearing.done():
                await bridge.see({"cell-1": {**VALUES, "axes/X/position": next(positions)}})
                await asyncio.wait([hearing], timeout=0.1)
            await bridge.see({"cell-1": VALUES})
            mosquitto.kill()
        mosquitto.start()
    gc.collect()
    assert not [message for message in left if "never retrieved" in message]


async def test_a_host_hears_the_death_of_a_bridge_that_is_killed_and_its_birth_when_it_is_back(
    mosquitto: Mosquitto, sparkplug: Any
) -> None:
    command = [sys.executable, "-m", "mcserver", "mqtt", f"mqtt://127.0.0.1:{mosquitto.port}"]
    command += ["--sparkplug", "site/cell", "--connect", f"tcp/127.0.0.1:{free_port()}"]
    async with aiomqtt.Client("127.0.0.1", mosquitto.port) as client, asyncio.timeout(LIMIT_S):
        await client.subscribe("spBv1.0/site/+/cell", qos=1)
        messages = aiter(client.messages)

        async def birth_or_death(kind: Any) -> int:
            """Its number, by the library's own reading."""
            message = await anext(messages)
            assert sparkplug.Topic.from_str(str(message.topic)).message_type.name == kind.__name__.upper()
            said = kind.decode(message.payload)
            number = said.bd_seq_metric if kind is sparkplug.NDeath else said.metrics[0]
            assert number.name == "bdSeq"
            return int(number.value)

        for _ in range(2):
            bridge = subprocess.Popen(command, stdout=subprocess.DEVNULL)
            try:
                born = await birth_or_death(sparkplug.NBirth)
            finally:
                bridge.kill()
                bridge.wait()
            assert await birth_or_death(sparkplug.NDeath) == born


@pytest.mark.parametrize("options", [["--sparkplug", "site/cell"], ["--prefix", "mc"]])
async def test_the_death_of_a_bridge_that_hangs_comes_before_the_next_one_is_there(
    mosquitto: Mosquitto, options: list[str]
) -> None:
    command = [sys.executable, "-m", "mcserver", "mqtt", f"mqtt://127.0.0.1:{mosquitto.port}", *options]
    command += ["--connect", f"tcp/127.0.0.1:{free_port()}"]
    async with aiomqtt.Client("127.0.0.1", mosquitto.port) as client, asyncio.timeout(LIMIT_S):
        await client.subscribe([("spBv1.0/site/+/cell", 1), ("mc/status", 1)])
        messages = aiter(client.messages)

        async def said() -> str:
            """Which birth or death it is."""
            message = await anext(messages)
            assert isinstance(message.payload, bytes)
            topic = str(message.topic)
            return message.payload.decode() if topic == "mc/status" else topic.split("/")[2]

        first = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        bridges = [first]
        try:
            born = await said()
            # its connection stays as it is where a computer has lost its power, or a cable is out
            first.send_signal(signal.SIGSTOP)
            bridges.append(subprocess.Popen(command, stdout=subprocess.DEVNULL))
            died = await said()
            assert died == {"online": "offline", "NBIRTH": "NDEATH"}[born]
            assert await said() == born
            first.kill()
            first.wait()
            await client.publish("mc/status", "last")
            assert await said() == "last"
        finally:
            for bridge in bridges:
                bridge.kill()
                bridge.wait()
