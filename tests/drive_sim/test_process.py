"""``mcserver drive-sim`` as a process, with the canopen package as its master."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import can
import canopen
import pytest

from mcserver.cli.app import run_command_line
from mcserver.drive_sim.control import Control
from tests.bench.server import free_port
from tests.can.hubs import LIMIT_S, wait_until
from tests.can.python_can import python_can_bus
from tests.e2e_can.processes import ReadyProcess
from tests.machine_text import axes_text

EDS = Path(__file__).resolve().parents[2] / "mcserver" / "drive_sim" / "cia402.eds"


def machine_file(folder: Path, port: int, nodes: int = 3) -> Path:
    text = '[machine]\nname = "bench"\ncycle_hz = 100\n'
    text += f'[[bus]]\nname = "can0"\naddress = "socketcand:127.0.0.1:{port}/can0"\n'
    for node in range(1, nodes + 1):
        keys = f'bus = "can0"\nnode = {node}\ncounts_per_motor_rev = 65536'
        text += axes_text([node - 1], rotary=True, drive="cia402", drive_keys=keys)
    path = folder / "bench.toml"
    path.write_text(text)
    return path


def drive_sim(*arguments: str) -> contextlib.closing[ReadyProcess]:
    """The command as a process."""
    return contextlib.closing(ReadyProcess(["mcserver", "drive-sim", *arguments]))


@contextlib.contextmanager
def master(port: int) -> Iterator[canopen.Network]:
    network = canopen.Network()
    address = f"socketcand:127.0.0.1:{port}/can0"
    network.bus = python_can_bus(address)
    network.notifier = can.Notifier(network.bus, network.listeners, 0.1)
    try:
        yield network
    finally:
        network.disconnect()


def test_drives_in_a_process_are_nodes_that_canopen_can_master(tmp_path: Path) -> None:
    port = free_port()
    path = machine_file(tmp_path, port)
    with (
        drive_sim("-m", str(path), "--hub", f"127.0.0.1:{port}", "--control", "127.0.0.1:0") as drives,
        master(port) as network,
    ):
        assert drives.ready.startswith("3 drives on can0, control 127.0.0.1:")
        network.scanner.search(8)
        wait_until(lambda: sorted(network.scanner.nodes) == [1, 2, 3], "three nodes answer")
        node = canopen.BaseNode402(2, str(EDS))
        # the package's own patience is too short for a computer that does much else
        node.sdo.RESPONSE_TIMEOUT = LIMIT_S
        node.TIMEOUT_SWITCH_STATE_SINGLE = node.TIMEOUT_SWITCH_STATE_FINAL = LIMIT_S
        network.add_node(node)
        node.nmt.state = "RESET"
        node.nmt.wait_for_bootup(LIMIT_S)
        assert node.sdo["Manufacturer device name"].raw == "Simulated servo drive"
        node.sdo["Producer heartbeat time"].raw = 50
        assert node.nmt.wait_for_heartbeat(LIMIT_S) == "PRE-OPERATIONAL"
        node.tpdo.read()
        node.rpdo.read()
        pdo = node.tpdo[3]
        pdo.clear()
        pdo.add_variable("Position actual value")
        pdo.trans_type = 1
        pdo.enabled = True
        pdo.save()
        node.setup_402_state_machine()
        node.nmt.state = "OPERATIONAL"
        node.state = "OPERATION ENABLED"
        assert node.state == "OPERATION ENABLED"
        came: list[int] = []
        pdo.add_callback(lambda variables: came.append(variables["Position actual value"].raw))
        network.sync.transmit()
        wait_until(lambda: came, "the mapped TPDO answers the SYNC")
        (number,) = re.findall(r"control 127\.0\.0\.1:(\d+)", drives.ready)
        with Control("127.0.0.1", int(number)) as control:
            assert control.state(2)["power"] == "OPERATION_ENABLED"
            control.fault(2, "emcy", code=0x4310)
            wait_until(lambda: [each.code for each in node.emcy.log] == [0x4310], "the emergency came")
            wait_until(lambda: control.state(2)["power"] == "FAULT", "the drive is in fault")


def test_each_drive_can_be_a_process_of_its_own(tmp_path: Path) -> None:
    port = free_port()
    path = str(machine_file(tmp_path, port, nodes=2))
    with (
        drive_sim("-m", path, "--hub", f"127.0.0.1:{port}", "--node", "1") as first,
        drive_sim("-m", path, "--node", "2") as second,
        master(port) as network,
    ):
        assert first.ready.startswith("1 drives")
        assert second.ready.startswith("1 drives")
        network.scanner.search(8)
        wait_until(lambda: sorted(network.scanner.nodes) == [1, 2], "both nodes answer")
        second.kill()
        network.scanner.reset()
        network.scanner.search(8)
        wait_until(lambda: network.scanner.nodes == [1], "the other one goes on")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_with_exit_code_0_and_its_hub_with_it(tmp_path: Path, number: int) -> None:
    port = free_port()
    path = machine_file(tmp_path, port)
    with drive_sim("-m", str(path), "--hub", f"127.0.0.1:{port}") as drives:
        assert drives.ready.startswith("3 drives")
        assert drives.end(number) == 0
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", port))


def test_a_bus_that_nobody_serves_gives_exit_code_5(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = machine_file(tmp_path, free_port())
    assert run_command_line(["drive-sim", "-m", str(path), "--wait", "0"]) == 5
    assert "error[MC424]" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "code", "exit_code"),
    [
        (["-m", "cartesian"], "MC540", 3),
        (["--node", "77"], "MC541", 2),
        (["--bus", "can9"], "MC541", 2),
        (["--hub", "nowhere"], "MC542", 2),
        (["--control", "127.0.0.1:x"], "MC542", 2),
        (["-m", "no-such-file.toml"], "MC001", 3),
    ],
)
def test_what_cannot_be_meant_has_a_code_and_an_exit_code(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], code: str, exit_code: int
) -> None:
    path = machine_file(tmp_path, 1)
    given = arguments if "-m" in arguments else ["-m", str(path), *arguments]
    assert run_command_line(["drive-sim", *given]) == exit_code
    assert f"error[{code}]" in capfd.readouterr().err


def test_realtime_priority_that_is_not_allowed_is_said(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    path = str(machine_file(tmp_path, free_port()))
    assert run_command_line(["drive-sim", "-m", path, "--realtime", "30"]) == 1
    assert "error[MC545]" in capfd.readouterr().err


def test_addresses_that_are_taken_are_said(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        where = f"127.0.0.1:{taken.getsockname()[1]}"
        path = str(machine_file(tmp_path, free_port()))
        assert run_command_line(["drive-sim", "-m", path, "--hub", where]) == 1
        assert "error[MC543]" in capfd.readouterr().err
        port = free_port()
        path = str(machine_file(tmp_path, port))
        hub = f"127.0.0.1:{port}"
        assert run_command_line(["drive-sim", "-m", path, "--hub", hub, "--control", where]) == 1
        assert "error[MC544]" in capfd.readouterr().err
