"""Simulated drives that run in a thread, on the buses that a machine file names."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Iterator

from mcserver.drive_sim.control import ControlServer
from mcserver.drive_sim.from_machine import Choice, build_buses
from mcserver.drive_sim.simulation import DriveSimulation
from mcserver.machine.machine_file import Machine
from tests.can.hubs import LIMIT_S


@contextlib.contextmanager
def simulated(described: Machine) -> Iterator[tuple[DriveSimulation, ControlServer]]:
    """The booted simulation of a machine's nodes, and what is asked of it over a socket."""
    simulation = DriveSimulation(build_buses(described, Choice()))
    server = ControlServer("127.0.0.1", 0, simulation.answer)
    booted = threading.Event()
    waking, bell = socket.socketpair()

    def serve() -> None:
        simulation.switch_on()
        simulation.run(server, booted.set, waking.fileno())

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        assert booted.wait(LIMIT_S)
        yield simulation, server
    finally:
        simulation.stop()
        bell.send(b".")
        thread.join(LIMIT_S)
        server.close()
        for bus in simulation.buses:
            bus.port.close()
        waking.close()
        bell.close()
