"""A server on a fake executor and a client of it, over Zenoh on the loopback."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from mcserver.canopen.booted_drives import CanDrives
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.net.configuration import NetworkOptions
from mcserver.net.publishing import PublishingThread
from mcserver.net.replies import ReplySender
from mcserver.server import ServerOptions, running
from mcserver.service.service import MachineService
from tests.net.approval_site import MILL, Site
from tests.net.client import WireClient
from tests.service.fakes import FakePipelines, FakePort, three_axes


class Rig:
    """A running server and what is behind it."""

    def __init__(
        self, service: MachineService, port: FakePort, pipelines: FakePipelines, endpoint: str
    ) -> None:
        self.service = service
        self.port = port
        self.pipelines = pipelines
        self.endpoint = endpoint
        # of rigs whose tests look behind the server's face
        self.replies: ReplySender
        self.publishing: PublishingThread


@asynccontextmanager
async def running_rig(
    folder: Path, drives: CanDrives | None = None, machine: Machine | None = None
) -> AsyncIterator[Rig]:
    """A server with its journal in a folder."""
    machine = machine or three_axes()
    port = FakePort(machine)
    pipelines = FakePipelines(port)
    options = ServerOptions(
        network=NetworkOptions(listen=("tcp/127.0.0.1:0",)), journal=folder / "journal.db"
    )
    async with running(machine, options, port, pipelines, drives) as (service, face):
        made = Rig(service, port, pipelines, (await face.endpoints())[0])
        made.replies, made.publishing = face._replies, face._publishing
        yield made


@pytest.fixture
async def rig(tmp_path: Path) -> AsyncIterator[Rig]:
    async with running_rig(tmp_path) as made:
        yield made


@pytest.fixture
async def client(rig: Rig) -> AsyncIterator[WireClient]:
    made = WireClient(rig.endpoint, "bench")
    yield made
    await made.close()


@pytest.fixture
async def site(tmp_path: Path) -> AsyncIterator[Site]:
    """A mill, an agent, and a person who arms."""
    made = Site(parse_machine(MILL), tmp_path)
    yield made
    await made.cell.stop()
