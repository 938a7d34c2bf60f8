"""What a broker is sent: plain topics, or an edge node of Sparkplug B with a device for each machine."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple, Protocol

import msgspec
from google.protobuf.message import DecodeError

from mcserver.mqtt.metrics import Value
from mcserver.mqtt.payload import BOOLEAN, INT64, Metric, datatype_of, decoded, encoded

# changes that wait for a broker which is away; the oldest go first
MOST_KEPT = 10_000
BIRTH_DEATH, REBIRTH = "bdSeq", "Node Control/Rebirth"


class Message(NamedTuple):
    """What is published; also what the broker publishes by itself when this client is lost (the will)."""

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False


class Publisher(Protocol):
    """Makes messages of what changes; the bridge sends them in order."""

    commands: str

    def will(self) -> Message:
        """Begin a connection: what the broker is to say when it is lost."""

    def begin(self, machines: Mapping[str, Mapping[str, Value]]) -> Iterable[Message]:
        """Say what there is, at the beginning of a connection."""

    def end(self) -> Message:
        """Say that this client goes."""

    def appeared(self, machine: str, values: Mapping[str, Value]) -> Iterable[Message]:
        """Say that a machine is there."""

    def changed(self, machine: str, values: Mapping[str, Value]) -> Iterable[Message]:
        """Say what has changed."""

    def gone(self, machine: str) -> Iterable[Message]:
        """Say that a machine does not answer."""

    def missed(self, machine: str, values: Mapping[str, Value]) -> None:
        """Keep what has changed while there is no connection."""

    def asks_for_rebirth(self, payload: bytes, /) -> bool:
        """Return whether a command asks for everything anew."""


class PlainTopics:
    """``PREFIX/status``, ``PREFIX/MACHINE/availability``, ``PREFIX/MACHINE/state``, all of them retained.

    A state is one JSON object.
    """

    commands = ""

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._values: dict[str, dict[str, Value]] = {}

    def will(self) -> Message:
        return self.end()

    def begin(self, machines: Mapping[str, Mapping[str, Value]]) -> Iterable[Message]:
        yield self._said("status", b"online")
        for machine, values in machines.items():
            yield from self.appeared(machine, values)

    def end(self) -> Message:
        return self._said("status", b"offline")

    def appeared(self, machine: str, values: Mapping[str, Value]) -> Iterable[Message]:
        self._values[machine] = {}
        yield self._said(f"{topic_level(machine)}/availability", b"online")
        yield from self.changed(machine, values)

    def changed(self, machine: str, values: Mapping[str, Value]) -> Iterable[Message]:
        self._values.setdefault(machine, {}).update(values)
        nested: dict[str, object] = {}
        for name, value in self._values[machine].items():
            *folders, last = name.split("/")
            place = nested
            for folder in folders:
                inner = place.setdefault(folder, {})
                assert isinstance(inner, dict)
                place = inner
            place[last] = value
        yield self._said(f"{topic_level(machine)}/state", msgspec.json.encode(nested))

    def gone(self, machine: str) -> Iterable[Message]:
        yield self._said(f"{topic_level(machine)}/availability", b"offline")

    def missed(self, machine: str, values: Mapping[str, Value]) -> None:
        """A state that nobody heard is of no use to who hears the next one."""

    def asks_for_rebirth(self, _payload: bytes, /) -> bool:
        return False

    def _said(self, topic: str, payload: bytes) -> Message:
        return Message(f"{self._prefix}/{topic}", payload, qos=1, retain=True)


class SparkplugNode:
    """An edge node (version 3.0): births with every metric, data with what has changed, deaths.

    Messages are numbered from birth to birth. What changes while the broker is away is kept, and sent
    as historical.
    """

    def __init__(self, group: str, node: str, clock: Callable[[], float]) -> None:
        self._group, self._node = group, node
        self._clock = clock
        self._births = -1
        self._seq = 0
        # aliases are of the whole node
        self._aliases: dict[tuple[str, str], int] = {}
        self._kept: deque[tuple[str, float, dict[str, Value]]] = deque(maxlen=MOST_KEPT)
        self.commands = self._topic("NCMD")

    def will(self) -> Message:
        self._births = (self._births + 1) % 256
        return self.end()

    def begin(self, machines: Mapping[str, Mapping[str, Value]]) -> Iterable[Message]:
        wall = self._clock()
        self._seq = -1
        self._aliases.clear()
        metrics = [
            Metric(BIRTH_DEATH, 0, INT64, self._births, wall),
            Metric(REBIRTH, 0, BOOLEAN, False, wall),
        ]
        yield self._numbered("NBIRTH", "", metrics)
        for machine, values in machines.items():
            yield from self.appeared(machine, values)
        kept, self._kept = self._kept, deque(maxlen=MOST_KEPT)
        for machine, then, values in kept:
            if any(each == machine for each, _ in self._aliases):
                yield self._numbered("DDATA", machine, self._metrics(machine, values, then, historical=True))

    def end(self) -> Message:
        wall = self._clock()
        payload = encoded([Metric(BIRTH_DEATH, 0, INT64, self._births, wall)], wall=wall, seq=None)
        return Message(self._topic("NDEATH"), payload, qos=1)

    def appeared(self, machine: str, values: Mapping[str, Value]) -> Iterable[Message]:
        wall = self._clock()
        metrics = []
        for name, value in values.items():
            alias = self._aliases.setdefault((machine, name), len(self._aliases) + 1)
            metrics.append(Metric(name, alias, datatype_of(value), value, wall))
        yield self._numbered("DBIRTH", machine, metrics)

    def changed(self, machine: str, values: Mapping[str, Value]) -> Iterable[Message]:
        if not all((machine, name) in self._aliases for name in values):
            # another machine file: what a device has is said by a birth
            yield from self.appeared(machine, values)
            return
        yield self._numbered("DDATA", machine, self._metrics(machine, values, self._clock()))

    def gone(self, machine: str) -> Iterable[Message]:
        yield self._numbered("DDEATH", machine, ())

    def missed(self, machine: str, values: Mapping[str, Value]) -> None:
        self._kept.append((machine, self._clock(), dict(values)))

    def asks_for_rebirth(self, payload: bytes) -> bool:
        try:
            metrics = decoded(payload).metrics
        except DecodeError:
            return False
        return any(each.name == REBIRTH and each.boolean_value for each in metrics)

    def _metrics(
        self, machine: str, values: Mapping[str, Value], wall: float, *, historical: bool = False
    ) -> list[Metric]:
        return [
            Metric("", self._aliases[machine, name], datatype_of(value), value, wall, historical)
            for name, value in values.items()
            if (machine, name) in self._aliases
        ]

    def _numbered(self, kind: str, machine: str, metrics: Iterable[Metric]) -> Message:
        self._seq = (self._seq + 1) % 256
        return Message(self._topic(kind, machine), encoded(metrics, wall=self._clock(), seq=self._seq))

    def _topic(self, kind: str, machine: str = "") -> str:
        device = f"/{topic_level(machine)}" if machine else ""
        return f"spBv1.0/{self._group}/{kind}/{self._node}{device}"


def topic_level(name: str) -> str:
    """Return a name as a level of a topic: wildcards and separators of MQTT are replaced."""
    return re.sub(r"[+#/\0]", "_", name)
