"""A hub, simple nodes on it, and the service path that boots them."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.canopen.fake_drives import FakeDrives
from tests.canopen.rig import RunningHub, Watched


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
