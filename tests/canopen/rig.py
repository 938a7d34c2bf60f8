"""What tests of the service path stand on: a hub, events, machines."""

from __future__ import annotations

import json
import queue
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from mcserver.can.hub import Hub
from mcserver.canopen.drive_events import CanopenEvent
from mcserver.canopen.service import CanopenService
from mcserver.cli.app import run_command_line
from mcserver.machine.machine_file import Machine, parse_machine
from tests.can.hubs import LIMIT_S
from tests.can.hubs import wait_until as wait_until
from tests.canopen.fake_drives import FakeDrives
from tests.machine_text import axes_text

# Answers on the loopback take a millisecond; a test that waits for none should not wait long.
IMPATIENT = {"listen_ms": 0, "appear_timeout_s": 3.0}


class RunningHub:
    """A hub in a thread; it can be stopped and started again on the same port."""

    def __init__(self) -> None:
        self.port = 0
        self._hub: Hub | None = None
        self._thread: threading.Thread | None = None
        self.start()

    def start(self) -> None:
        self._hub = Hub("127.0.0.1", self.port)
        self.port = self._hub.port
        self._thread = threading.Thread(target=self._hub.run, name="hub", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        if self._hub is not None and self._thread is not None:
            self._hub.stop()
            self._thread.join(5.0)
            self._hub = None

    def address(self, channel: str = "can0") -> str:
        return f"socketcand:127.0.0.1:{self.port}/{channel}"


@dataclass
class Watched:
    """A service with its events and its sentences."""

    events: queue.Queue[CanopenEvent] = field(default_factory=queue.Queue)
    sentences: list[str] = field(default_factory=list)
    services: list[CanopenService] = field(default_factory=list)

    def start(
        self,
        machine: Machine,
        stopping: Callable[[], bool] = lambda: False,
        *,
        take_over: bool = False,
        **keys: Any,
    ) -> CanopenService:
        """Boot a machine's drives; ``keys``: of its buses, in the place of those that do not wait long."""
        buses = tuple(replace(bus, **(IMPATIENT | keys)) for bus in machine.buses)
        service = CanopenService.start(
            replace(machine, buses=buses),
            self.events.put,
            self.sentences.append,
            stopping=stopping,
            take_over=take_over,
        )
        self.services.append(service)
        return service

    def expect(self, kind: str) -> CanopenEvent:
        """The next event of that kind; others before it are passed over."""
        deadline = time.monotonic() + LIMIT_S
        seen = []
        while True:
            try:
                event = self.events.get(timeout=max(0.01, deadline - time.monotonic()))
            except queue.Empty:
                raise AssertionError(f"no {kind} came; these did: {seen}") from None
            if event.kind == kind:
                return event
            seen.append(event)


@dataclass
class BusCell:
    """A hub, simple nodes on it, and the service path that boots them."""

    hub: RunningHub
    make_drives: Callable[..., FakeDrives]
    watched: Watched

    def machine(self, *nodes: int, **on: Any) -> Machine:
        """A machine whose axes have these nodes."""
        return machine_on(self.hub.address(), nodes, **on)

    def start(self, *nodes: int, **on: Any) -> CanopenService:
        """Boot such a machine."""
        return self.watched.start(self.machine(*nodes, **on))

    def booted(self, *nodes: int, **on: Any) -> tuple[FakeDrives, CanopenService]:
        """Make these nodes, and boot a machine that has them."""
        return self.make_drives(*nodes), self.start(*nodes, **on)


def axis_on(index: int, node: int, keys: str = "", kind: str = "cia402", axis_keys: str = "") -> str:
    """An axis of 10 mm and 4096 counts a motor turn, on the bus ``left``."""
    return axes_text(
        [index],
        velocity=100.0,
        acceleration=1000.0,
        keys=f"units_per_motor_rev = 10\n{axis_keys}",
        drive=kind,
        drive_keys=f'bus = "left"\nnode = {node}\ncounts_per_motor_rev = 4096\n{keys}',
    )


def machine_on(
    address: str,
    nodes: Sequence[int],
    keys: str = "",
    kind: str = "cia402",
    bus: str = "",
    own_keys: Sequence[str] = (),
    axis_keys: str = "",
    cycle_hz: float = 100.0,
) -> Machine:
    """Axis i has the i-th node; ``keys`` go into every drive's section, ``own_keys`` into one each,
    ``axis_keys`` into every axis's."""
    axes = "".join(
        axis_on(axis, node, f"{own_keys[axis] if own_keys else ''}\n{keys}", kind, axis_keys)
        for axis, node in enumerate(nodes)
    )
    return parse_machine(
        f'[machine]\nname = "m"\ncycle_hz = {cycle_hz}\n'
        f'[[bus]]\nname = "left"\naddress = "{address}"\n{bus}\n{axes}'
    )


def machine_file(folder: Path, hub: RunningHub, nodes: Sequence[int] = (3,), keys: str = "") -> str:
    """Write a machine whose axes have these nodes on the hub's bus."""
    file = folder / "machine.toml"
    axes = "".join(axis_on(axis, node, keys) for axis, node in enumerate(nodes))
    file.write_text(
        f'[machine]\nname = "m"\ncycle_hz = 100\n[[bus]]\nname = "left"\naddress = "{hub.address()}"\n{axes}'
    )
    return str(file)


@dataclass
class Desk:
    """``mcserver drives``, on a machine whose drives are simple nodes."""

    file: str
    hub: RunningHub
    make_drives: Callable[..., FakeDrives]
    capsys: pytest.CaptureFixture[str]

    @property
    def folder(self) -> Path:
        return Path(self.file).parent

    def describe(self, nodes: Sequence[int] = (3,), keys: str = "") -> None:
        """Write another machine in the place of that of one axis, node 3."""
        machine_file(self.folder, self.hub, nodes, keys)

    def __call__(self, *arguments: str, file: str = "") -> tuple[int, Any]:
        """Return the exit code and the answer as JSON."""
        self.capsys.readouterr()
        code = run_command_line(["drives", *arguments, "-m", file or self.file, "--json"])
        return code, json.loads(self.capsys.readouterr().out)

    def refusal(self, *arguments: str, file: str = "") -> tuple[int, str]:
        """Return the exit code and the code of the one diagnostic."""
        code, said = self(*arguments, file=file)
        return code, said["diagnostics"][0]["code"]
