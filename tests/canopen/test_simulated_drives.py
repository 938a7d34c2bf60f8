"""The service path and ``mcserver drive-sim``: nodes that follow the standards, in a process of their own."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from mcclient.sync import Machine as Client

from mcserver.canopen.service import CanopenService
from mcserver.drive_sim.control import Control
from mcserver.machine.machine_file import load_machine
from tests.canopen.rig import RunningHub, Watched, wait_until
from tests.e2e.servers import ServerProcess, environment
from tests.e2e_can.processes import ReadyProcess
from tests.machine_text import axes_text

ROOT = Path(__file__).resolve().parents[2]
EDS = ROOT / "mcserver" / "drive_sim" / "cia402.eds"
NODES = (1, 2, 3)
KEYS = f'bus = "can"\neds = "{EDS}"\nencoder = [65536, 1]\nproduct_code = 0x402\nnode = '


@dataclass
class Simulation:
    """A machine file, its drives in a process, and their control."""

    file: Path
    control: Control
    process: ReadyProcess

    def nmt(self, node: int) -> object:
        return self.control.state(node)["nmt"]


@contextlib.contextmanager
def simulated(folder: Path) -> Iterator[Simulation]:
    """A hub and a process of simulated drives on it."""
    hub = RunningHub()
    file = folder / "machine.toml"
    head = f'[machine]\nname = "cell"\ncycle_hz = 100\n[[bus]]\nname = "can"\naddress = "{hub.address()}"\n'
    units = "units_per_motor_rev = 10"
    for node in NODES:
        head += axes_text(
            [node - 1],
            velocity=100.0,
            acceleration=1000.0,
            keys=units,
            drive="cia402",
            drive_keys=KEYS + str(node),
        )
    file.write_text(head)
    process = ReadyProcess(["mcserver", "drive-sim", "-m", str(file), "--control", "127.0.0.1:0"])
    try:
        with Control(*process.endpoint) as control:
            yield Simulation(file, control, process)
    finally:
        process.close()
        hub.stop()


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Simulation]:
    with simulated(tmp_path_factory.mktemp("drives")) as found:
        yield found


@pytest.fixture
def simulation(shared: Simulation) -> Iterator[Simulation]:
    yield shared
    shared.control.clear()
    for node in NODES:
        shared.control.fault(node, "reboot")
    wait_until(lambda: {shared.nmt(node) for node in NODES} == {"PRE_OPERATIONAL"}, "drives as new")


@pytest.fixture
def start(simulation: Simulation, watched: Watched) -> Callable[..., CanopenService]:
    def begin() -> CanopenService:
        return watched.start(load_machine(str(simulation.file)))

    return begin


Start = Callable[..., CanopenService]


def test_all_nodes_are_operational_without_energy(simulation: Simulation, start: Start) -> None:
    service = start()
    states = simulation.control.states()
    assert {state["nmt"] for state in states} == {"OPERATIONAL"}
    assert {state["power"] for state in states} == {"SWITCH_ON_DISABLED"}
    assert [node.remarks for node in service.nodes] == [()] * len(NODES)
    assert [node.identity.product_code for node in service.nodes] == [0x402] * len(NODES)
    service.close()
    wait_until(lambda: simulation.nmt(1) == "PRE_OPERATIONAL", "pre-operational after the end")


def test_a_second_server_after_the_first_finds_them_as_new(simulation: Simulation, start: Start) -> None:
    start().close()
    start()
    assert simulation.nmt(2) == "OPERATIONAL"


def test_a_rebooted_drive_comes_back_without_energy(
    simulation: Simulation, start: Start, watched: Watched
) -> None:
    start()
    simulation.control.fault(2, "reboot")
    assert watched.expect("drive.rebooted").axis == 1
    assert watched.expect("drive.started").axis == 1
    state = simulation.control.state(2)
    assert (state["nmt"], state["power"]) == ("OPERATIONAL", "SWITCH_ON_DISABLED")


def test_answers_that_are_slow_are_waited_for(simulation: Simulation, start: Start) -> None:
    simulation.control.fault(2, "sdo_delay", seconds=0.02)
    start()
    assert simulation.nmt(2) == "OPERATIONAL"


def test_a_killed_drive_process_is_noticed_for_every_node(watched: Watched, tmp_path: Path) -> None:
    with simulated(tmp_path) as victim:
        watched.start(load_machine(str(victim.file)))
        victim.process.kill()
        assert {watched.expect("drive.lost").axis for _ in NODES} == {0, 1, 2}


def test_a_server_shows_its_drives_and_their_objects(simulation: Simulation, tmp_path: Path) -> None:
    server = ServerProcess(tmp_path, str(simulation.file), "cell-can")
    server.start()
    try:
        assert any("3 drives are up" in line for line in server.said)
        with Client.connect("cell-can", server.endpoint) as client:
            drives = client.drives()
            assert [(drive.axis, drive.node, drive.state) for drive in drives] == [
                (0, 1, "operational"),
                (1, 2, "operational"),
                (2, 3, "operational"),
            ]
            assert {drive.status for drive in drives} == {"switch on disabled"}
            assert client.sdo_read(0x1008, axis=1).value == "Simulated servo drive"
            assert client.sdo_write(0x6065, 777, axis=1).value == 777
            assert client.sdo_read(0x6065, node=2).value == 777
        assert server.end(signal.SIGTERM) == 0
    finally:
        server.close()
    wait_until(lambda: simulation.nmt(1) == "PRE_OPERATIONAL", "pre-operational after the end")


def test_a_server_with_a_drive_that_refuses_does_not_start(simulation: Simulation) -> None:
    simulation.control.fault(2, "sdo_abort", index=0x6060, code=0x0609_0030)
    done = subprocess.run(
        [sys.executable, "-m", "mcserver", "run", "-m", str(simulation.file), "--listen", "tcp/127.0.0.1:0"],
        capture_output=True,
        text=True,
        env=environment(),
        cwd=ROOT,
        timeout=100,
        check=False,
    )
    assert done.returncode == 1
    assert "error[MC553]: axis 1, node 2 on can: 6060h:00" in done.stderr
    assert "help" in done.stderr
