"""Simulated drives on their buses, in one thread that waits for frames, requests and the next due time."""

from __future__ import annotations

import math
import select
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from mcserver.can.port import CanPort, Frame, recipient
from mcserver.drive_sim.control import ControlServer
from mcserver.drive_sim.ethercat.segment import EthercatSegment
from mcserver.drive_sim.fault_injection import BadRequest

# A bus that is away is asked so often whether it has come back [s].
AWAY_S = 0.05
LONGEST_WAIT_S = 1.0
# Within a backlog what is due is done after so many frames: about a millisecond of work.
FRAMES_BETWEEN_POLLS = 32


class Node(Protocol):
    """A simulated drive, or a node with inputs and outputs."""

    @property
    def node(self) -> int:
        """Its number."""

    @property
    def wake(self) -> float:
        """When it wants to be polled next."""

    @property
    def booted(self) -> bool:
        """Whether it can be spoken to."""

    def switch_on(self, now: float) -> None: ...

    def poll(self, now: float) -> None: ...

    def request(self, fault: str, request: Mapping[str, object], now: float) -> None: ...

    def describe(self) -> dict[str, object]: ...


class CanNode(Node, Protocol):
    """One on a CAN bus; `Cia402Node`, `Cia401Node` and `ServosilaNode`."""

    @property
    def routes(self) -> int:
        """Goes up when its identifiers have changed."""

    def identifiers(self) -> set[int]:
        """Return what it listens to, as `mcserver.can.port.recipient` has it."""

    def receive(self, identifier: int, payload: bytes, now: float) -> None: ...


class SimulatedBusSegment:
    """The nodes of one bus behind one port.

    Attributes:
        name: as the machine file has it. nodes: in the order of the machine's axes.
    """

    def __init__(self, name: str, port: CanPort, clock: Callable[[], float] = time.monotonic) -> None:
        self.name = name
        self._clock = clock
        self.port = port
        self.nodes: list[CanNode] = []
        self._listeners: dict[int, list[CanNode]] = {}
        self._routes = -1

    def transmit(self, identifier: int, payload: bytes) -> None:
        """Put a frame on the bus; where it finds no room it is gone."""
        self.port.send(identifier, payload)

    @property
    def wake(self) -> float:
        """When a node wants to be polled next."""
        return min((node.wake for node in self.nodes), default=math.inf)

    def take(self, frames: Sequence[Frame], now: float) -> None:
        """Give frames to the nodes that listen to them."""
        if sum(node.routes for node in self.nodes) != self._routes:
            self._reroute()
        nothing: list[CanNode] = []
        for identifier, payload in frames:
            for node in self._listeners.get(recipient(identifier), nothing):
                node.receive(identifier, payload, now)
            if sum(node.routes for node in self.nodes) != self._routes:
                self._reroute()

    def poll(self, now: float) -> None:
        """Let nodes do what is due."""
        for node in self.nodes:
            if node.wake <= now:
                node.poll(now)

    def serve(self, frames: Sequence[Frame]) -> None:
        """Take frames and let nodes do what is due, heartbeats also in the midst of a backlog of frames."""
        for first in range(0, max(1, len(frames)), FRAMES_BETWEEN_POLLS):
            now = self._clock()
            self.poll(now)
            self.take(frames[first : first + FRAMES_BETWEEN_POLLS], now)
        self.poll(self._clock())

    def _reroute(self) -> None:
        self._routes = sum(node.routes for node in self.nodes)
        self._listeners.clear()
        for node in self.nodes:
            for identifier in node.identifiers():
                self._listeners.setdefault(identifier, []).append(node)


Segment = SimulatedBusSegment | EthercatSegment


class DriveSimulation:
    """All buses of a process; `run` until `stop`."""

    def __init__(self, buses: Sequence[Segment]) -> None:
        self.buses = tuple(buses)
        self._stopping = False

    @property
    def booted(self) -> bool:
        """Whether every node can be spoken to."""
        return all(node.booted for bus in self.buses for node in bus.nodes)

    def switch_on(self) -> None:
        """Power comes to every node."""
        now = time.monotonic()
        for bus in self.buses:
            for node in bus.nodes:
                node.switch_on(now)

    def stop(self) -> None:
        """End `run` within `LONGEST_WAIT_S`; from a signal handler or another thread."""
        self._stopping = True

    def run(
        self,
        requests: ControlServer | None = None,
        on_booted: Callable[[], None] | None = None,
        bell: int | None = None,
    ) -> None:
        """Serve until `stop`. ``bell``: a descriptor whose input wakes the loop."""
        while not self._stopping:
            others = requests.descriptors() if requests is not None else []
            ready = self._wait([*others, *([bell] if bell is not None else [])])
            for bus in self.buses:
                descriptor = bus.port.fileno()
                frames = bus.port.drain() if descriptor in ready or descriptor < 0 else []
                bus.serve(frames)
            if requests is not None:
                requests.serve(ready)
            if on_booted is not None and self.booted:
                on_booted()
                on_booted = None

    def _wait(self, others: Sequence[int]) -> set[int]:
        poller = select.poll()
        timeout = LONGEST_WAIT_S
        for bus in self.buses:
            descriptor = bus.port.fileno()
            if descriptor >= 0:
                poller.register(descriptor, select.POLLIN)
            if descriptor < 0 or bus.port.counters.down:
                timeout = min(timeout, AWAY_S)
            timeout = min(timeout, bus.wake - time.monotonic())
        for descriptor in others:
            poller.register(descriptor, select.POLLIN)
        events = poller.poll(max(0.0, timeout) * 1000.0)
        return {descriptor for descriptor, _ in events}

    # ------------------------------------------------------------------ requests

    def answer(self, request: Mapping[str, object]) -> dict[str, object]:
        """Obey one request.

        Raises:
            BadRequest: it cannot be meant.
        """
        nodes = self._nodes(request)
        fault = request.get("fault")
        if "state" in request:
            return {"ok": True, "nodes": [{"bus": bus.name, **node.describe()} for bus, node in nodes]}
        if not isinstance(fault, str):
            raise BadRequest('a request has "fault" or "state"')
        if "node" not in request and fault != "clear":
            raise BadRequest(f'{fault} needs "node"')
        now = time.monotonic()
        for _, node in nodes:
            node.request(fault, request, now)
        return {"ok": True}

    def _nodes(self, request: Mapping[str, object]) -> Sequence[tuple[Segment, Node]]:
        number, name = request.get("node"), request.get("bus")
        everyone = [(bus, node) for bus in self.buses for node in bus.nodes]
        found = [
            (bus, node)
            for bus, node in everyone
            if (number is None or node.node == number) and (name is None or bus.name == name)
        ]
        if not found:
            there = ", ".join(f"{node.node} on {bus.name}" for bus, node in everyone)
            raise BadRequest(f"there is no node {number}; there are {there}")
        if number is not None and len(found) > 1:
            raise BadRequest(f'node {number} is on several buses: give "bus", too')
        return found
