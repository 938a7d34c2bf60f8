"""A bus (or several), simulated drives and a server, each a process of its own."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mcserver.drive_sim.control import Control
from tests.e2e.servers import ServerProcess
from tests.e2e_can.machines import AXES, Raw, write
from tests.e2e_can.processes import ReadyProcess

LOOPBACK = "127.0.0.1"
FREE = f"{LOOPBACK}:0"
HUB = "mcserver.can.hub"
Build = Callable[[Sequence[str]], Raw]


@dataclass
class Drives:
    """Simulated drives of some nodes, in one process."""

    nodes: tuple[int, ...]
    process: ReadyProcess
    control: Control


@dataclass
class Cell:
    """What runs; made by `running`.

    Attributes:
        raw: the machine file. addresses: of its buses. hubs: none on interfaces of this computer.
    """

    folder: Path
    raw: Raw
    addresses: tuple[str, ...]
    machine: str
    server: ServerProcess
    hubs: list[ReadyProcess] = field(default_factory=list)
    drives: list[Drives] = field(default_factory=list)

    def drives_of(self, node: int) -> Drives:
        """The process that a node lives in."""
        (found,) = [each for each in self.drives if node in each.nodes]
        return found

    def start_drives(self, nodes: Sequence[int]) -> Drives:
        """A process with these nodes."""
        chosen = [argument for node in nodes for argument in ("--node", str(node))]
        process = ReadyProcess(
            ["mcserver", "drive-sim", "--machine", self.machine, "--control", FREE, *chosen]
        )
        started = Drives(tuple(nodes), process, Control(*process.endpoint))
        self.drives.append(started)
        return started

    def kill_drives(self, node: int) -> tuple[int, ...]:
        """Kills the process of a node; gives the nodes that were in it."""
        killed = self.drives_of(node)
        killed.control.close()
        killed.process.kill()
        self.drives.remove(killed)
        return killed.nodes

    def stop_hub(self, number: int) -> None:
        """Its buses go away."""
        self.hubs[number].kill()

    def start_hub(self, number: int) -> None:
        """It comes back where it was."""
        host, port = self.hubs[number].endpoint
        self.hubs[number] = ReadyProcess([HUB, f"{host}:{port}"])

    def close(self) -> None:
        self.server.close()
        for each in self.drives:
            each.control.close()
            each.process.close()
        for hub in self.hubs:
            hub.close()

    def said(self) -> str:
        """What all processes have said, for a look at a failure."""
        parts = {"server": self.server.said}
        parts |= {f"drives {each.nodes}": each.process.said for each in self.drives}
        parts |= {f"hub {number}": hub.said for number, hub in enumerate(self.hubs)}
        return "".join(f"--- {name}\n{''.join(lines)}" for name, lines in parts.items())


@contextlib.contextmanager
def running(
    folder: Path,
    build: Build,
    *,
    interfaces: Sequence[str] = (),
    channels: int = 4,
    hubs: int = 1,
    processes: Sequence[Sequence[int]] = (range(1, AXES + 1),),
) -> Iterator[Cell]:
    """A machine on a hub's channels, or on interfaces of this computer; ready for clients inside the block.

    Args:
        build: makes the machine file of the buses' addresses.
        channels, hubs: buses, and processes that they are spread over.
        processes: nodes of each process of drives.
    """
    started = [] if interfaces else [ReadyProcess([HUB, FREE]) for _ in range(hubs)]
    addresses = tuple(interfaces)
    if started:
        served = [started[channel * hubs // channels].endpoint for channel in range(channels)]
        addresses = tuple(f"socketcand:{host}:{port}/can{n}" for n, (host, port) in enumerate(served))
    raw = build(addresses)
    machine = write(raw, folder / "machine.toml")
    cell = Cell(
        folder, raw, addresses, machine, ServerProcess(folder, machine, raw["machine"]["name"]), started
    )
    try:
        for nodes in processes:
            cell.start_drives(nodes)
        cell.server.start()
        yield cell
    finally:
        cell.close()
        # pytest shows it where a test failed
        sys.stderr.write(cell.said())
