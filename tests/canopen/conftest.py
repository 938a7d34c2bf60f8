"""A hub, simple nodes on it, and the service path that boots them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mcserver.can.open import open_port
from mcserver.canopen.network import PortNetwork
from tests.canopen.fake_drives import FakeDrives
from tests.canopen.rig import BusCell, Desk, RunningHub, Watched, machine_file


@pytest.fixture
def hub() -> Iterator[RunningHub]:
    running = RunningHub()
    yield running
    running.stop()


@pytest.fixture
def watched() -> Iterator[Watched]:
    found = Watched()
    yield found
    for service in found.services:
        service.close()


@pytest.fixture
def make_drives(hub: RunningHub) -> Iterator[Callable[..., FakeDrives]]:
    made: list[FakeDrives] = []

    def make(*nodes: int, channel: str = "can0") -> FakeDrives:
        made.append(FakeDrives(hub.address(channel), nodes))
        return made[-1]

    yield make
    for drives in made:
        drives.close()


@pytest.fixture
def cell(hub: RunningHub, make_drives: Callable[..., FakeDrives], watched: Watched) -> BusCell:
    return BusCell(hub, make_drives, watched)


@pytest.fixture
def desk(
    hub: RunningHub,
    make_drives: Callable[..., FakeDrives],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> Desk:
    """Of one axis, node 3."""
    return Desk(machine_file(tmp_path, hub), hub, make_drives, capsys)


@pytest.fixture
def network(hub: RunningHub) -> Iterator[PortNetwork]:
    """What a master sends and hears on the hub's bus; a thread receives."""
    made = PortNetwork(open_port(hub.address()))
    stopping = threading.Event()

    def receive() -> None:
        while not stopping.wait(0.001):
            made.receive()

    thread = threading.Thread(target=receive, daemon=True)
    thread.start()
    yield made
    stopping.set()
    thread.join(5.0)
    made.disconnect()
