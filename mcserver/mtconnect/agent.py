"""The agent: its devices, what they observed, and what a request asks of that (Part 1, section 8)."""

from __future__ import annotations

import asyncio
import re
import time
import xml.etree.ElementTree as ElementTree
from collections.abc import AsyncIterator, Callable, Mapping, Sequence

from mcclient import Info, MachineStatus

from mcserver.mtconnect.buffer import SIZE, Buffer, flat
from mcserver.mtconnect.device import Device
from mcserver.mtconnect.documents import (
    Header,
    Place,
    assets_document,
    devices_document,
    error_document,
    streams_document,
    utc,
)

MOST_DEVICES = 1000
MOST_PATH = 1000
COUNT, HEARTBEAT_MS = 100, 10_000
# of a document, whatever ``count`` asks for: half a megabyte, made in some 30 ms of the agent
MOST_OBSERVATIONS = 4096


class Refusal(Exception):
    """A request that an Error document answers.

    Attributes:
        code: of the standard's table of errors. status: of HTTP.
    """

    def __init__(self, code: str, text: str, status: int = 400) -> None:
        super().__init__(text)
        self.code, self.text, self.status = code, text, status


class Agent:
    """Devices and their observations.

    Args:
        sender: the computer's name. clock: Unix time [s].
    """

    def __init__(self, sender: str, clock: Callable[[], float] = time.time, size: int = SIZE) -> None:
        self.buffer = Buffer(size)
        self.devices: dict[str, Device] = {}
        self._sender = sender
        self._clock = clock
        self._devices_wall = clock()
        self._instance = int(self._devices_wall)
        self._changed = asyncio.Event()

    def wants(self, machine: str, instance: str) -> bool:
        """Return whether a machine is to be added: there is room for it, or its server has started anew.

        Another start may have another machine file.
        """
        device = self.devices.get(machine)
        return len(self.devices) < MOST_DEVICES if device is None else device.instance != instance

    def add(self, info: Info) -> None:
        """Add a machine, or take its new axes."""
        self.devices[info.machine] = Device(info)
        self._devices_wall = self._clock()

    def see(self, machine: str, status: MachineStatus | None) -> None:
        """Take a state of a machine that was added; None: it does not answer."""
        device = self.devices[machine]
        wall = self._clock() if status is None else status.wall
        if self.buffer.observe(utc(wall), device.read(status)):
            self._changed.set()
            self._changed = asyncio.Event()

    def header(self) -> Header:
        """Return what every document says of the agent now."""
        return Header(self._sender, self._instance, self.buffer.size, self._clock(), self._devices_wall)

    def probe(self, device: str | None) -> bytes:
        """Return the Devices document."""
        return devices_document(self.header(), self._chosen(device))

    def assets(self) -> bytes:
        """Return the Assets document."""
        return assets_document(self.header())

    def refusal(self, refused: Refusal) -> bytes:
        """Return the Error document."""
        return error_document(self.header(), refused.code, refused.text)

    def current(self, device: str | None, query: Mapping[str, str]) -> bytes:
        """Return the newest value of every data item, or as they were ``at`` a number.

        Raises:
            Refusal: NO_DEVICE, INVALID_XPATH, INVALID_REQUEST, OUT_OF_RANGE.
        """
        devices = self._chosen(device)
        items = self._items(devices, query)
        at = _number(query, "at", None)
        if at is not None:
            self._require("at", at)
        found = flat(self.buffer.state(at), items)
        return streams_document(self.header(), self._place(self.buffer.next), devices, found)

    def sample(self, device: str | None, query: Mapping[str, str]) -> tuple[bytes, int]:
        """Return what was observed ``from`` a number on, at most ``count``, and the number that follows.

        A document has `MOST_OBSERVATIONS` at most, as `count` says how many it may have.

        Raises:
            Refusal: as `current`.
        """
        devices = self._chosen(device)
        items = self._items(devices, query)
        start = _number(query, "from", None)
        count = _number(query, "count", COUNT)
        assert count is not None
        if not 0 < count <= self.buffer.size:
            raise Refusal("OUT_OF_RANGE", f"count: 1 to {self.buffer.size}")
        if start is None:
            start = self.buffer.first
        elif start != self.buffer.next:
            self._require("from", start)
        window = self.buffer.window(start, min(count, MOST_OBSERVATIONS), set(items))
        place = self._place(window.next_sequence)
        return streams_document(self.header(), place, devices, window.observations), place.next

    async def stream(
        self, method: str, device: str | None, query: Mapping[str, str], interval_ms: int
    ) -> AsyncIterator[bytes]:
        """Yield documents of ``sample`` or ``current`` when there is something new.

        At most one an interval, at least one a heartbeat.
        """
        heartbeat = (_number(query, "heartbeat", HEARTBEAT_MS) or HEARTBEAT_MS) / 1000.0
        asked = dict(query)
        while True:
            changed = self._changed
            before = self.buffer.next
            if method == "current":
                yield self.current(device, asked)
            else:
                try:
                    document, following = self.sample(device, asked)
                except Refusal as refused:
                    # so slow a reader that the buffer has gone on without it
                    yield self.refusal(refused)
                    return
                yield document
                asked["from"] = str(following)
                if following < self.buffer.next:
                    continue
            await asyncio.sleep(interval_ms / 1000.0)
            if self.buffer.next == before:
                try:
                    await asyncio.wait_for(changed.wait(), heartbeat)
                except TimeoutError:
                    continue

    def _chosen(self, name: str | None) -> list[Device]:
        found = [each for each in self.devices.values() if name in (None, each.name, each.uuid)]
        if name is not None and not found:
            raise Refusal("NO_DEVICE", f"no device {name} is known", 404)
        return found

    def _items(self, devices: Sequence[Device], query: Mapping[str, str]) -> list[str]:
        """Return the ids of data items that ``path`` chooses."""
        items = [item for device in devices for item in device.items]
        path = query.get("path")
        if path is None:
            return items
        root = ElementTree.Element("MTConnectDevices")
        ElementTree.SubElement(root, "Devices").extend(each.element for each in devices)
        chosen = {each.attrib["id"] for found in _select(root, path) for each in found.iter("DataItem")}
        return [item for item in items if item in chosen]

    def _require(self, name: str, sequence: int) -> None:
        buffer = self.buffer
        if not buffer.first <= sequence < buffer.next:
            raise Refusal("OUT_OF_RANGE", f"{name}: {buffer.first} to {buffer.next - 1}")

    def _place(self, following: int) -> Place:
        return Place(self.buffer.first, self.buffer.next - 1, following)


def interval_of(query: Mapping[str, str]) -> int | None:
    """Return the interval of a stream [ms]; None: one document is asked for.

    Raises:
        Refusal: INVALID_REQUEST it is no whole number; OUT_OF_RANGE.
    """
    interval = _number(query, "interval", None)
    heartbeat = _number(query, "heartbeat", HEARTBEAT_MS)
    for name, value in (("interval", interval), ("heartbeat", heartbeat)):
        if value is not None and not 0 <= value <= 2**31:
            raise Refusal("OUT_OF_RANGE", f"{name}: 0 to {2**31}")
    return interval


def _number(query: Mapping[str, str], name: str, otherwise: int | None) -> int | None:
    text = query.get(name)
    if text is None:
        return otherwise
    if not re.fullmatch(r"-?\d{1,18}", text):
        raise Refusal("INVALID_REQUEST", f"{name}: a whole number")
    return int(text)


def _select(root: ElementTree.Element, path: str) -> list[ElementTree.Element]:
    """Return what an XPath of the standard's examples chooses: steps, ``//``, attributes, ``and``, ``|``.

    Raises:
        Refusal: INVALID_XPATH it is none, or one of another form.
    """
    found: list[ElementTree.Element] = []
    try:
        if len(path) > MOST_PATH:
            raise SyntaxError("it is too long")
        for one in path.split("|"):
            # ElementTree has a predicate for each attribute, and starts at an element
            steps = re.sub(r"\s+and\s+@", "][@", one.strip())
            if not steps.startswith("/") or ".." in steps:
                # a step back, then on to all children, over and over, would take for ever
                raise SyntaxError("it does not begin with /, or has a step back")
            found += root.findall("." + steps.removeprefix("/MTConnectDevices"))
    except (SyntaxError, KeyError, ValueError, TypeError) as error:
        raise Refusal("INVALID_XPATH", f"the path cannot be read: {error}") from None
    return found
