"""Looking who is on a bus, without a machine file."""

from __future__ import annotations

import json
from collections.abc import Callable

import pytest

from mcserver.can.cob import Function, NmtState
from mcserver.can.open import open_port
from mcserver.canopen.scan import machine_file, scan
from mcserver.cli.app import run_command_line
from mcserver.machine.machine_file import parse_machine
from tests.canopen.fake_drives import PRODUCT, VENDOR, FakeDrives
from tests.canopen.rig import RunningHub, Watched, machine_on

Make = Callable[..., FakeDrives]


def test_every_node_is_found_with_its_identity_and_nothing_is_done_to_it(
    hub: RunningHub, make_drives: Make
) -> None:
    drives = make_drives(1, 7, 127)
    drives[7].objects[0x6502, 0] = (0x3ED).to_bytes(4, "little")
    drives[127].aborts[0x1018, 4] = 0x0609_0011
    drives[7].state = NmtState.OPERATIONAL
    port = open_port(hub.address())
    nodes = scan(port)
    port.close()
    assert [node.node for node in nodes] == [1, 7, 127]
    assert {(node.vendor_id, node.product_code) for node in nodes} == {(VENDOR, PRODUCT)}
    assert nodes[1].modes == ("pp", "pv", "tq", "hm", "ip", "csp", "csv", "cst")
    assert nodes[2].serial is None
    assert drives[7].resets == 0
    assert drives[7].written == []
    assert drives[7].state is NmtState.OPERATIONAL


def test_the_machine_file_to_start_from_can_be_read(hub: RunningHub, make_drives: Make) -> None:
    make_drives(3, 4)
    port = open_port(hub.address())
    nodes = scan(port)
    port.close()
    described = parse_machine(machine_file("cell", hub.address(), nodes))
    assert [axis.drive.node for axis in described.axes] == [3, 4]
    assert described.axes[0].drive.vendor_id == VENDOR


def test_the_command_prints_json_and_refuses_beside_another_master(
    hub: RunningHub, make_drives: Make, watched: Watched, capfd: pytest.CaptureFixture[str]
) -> None:
    drives = make_drives(1)
    assert run_command_line(["scan", hub.address(), "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["nodes"][0]["node"] == 1
    assert run_command_line(["scan", hub.address()]) == 0
    assert "0x00001234" in capfd.readouterr().out
    watched.start(machine_on(hub.address(), [1]))
    heard = drives.heard.get(Function.SDO_REQUEST + 1, 0)
    assert run_command_line(["scan", hub.address()]) == 1
    assert "MC560" in capfd.readouterr().err
    assert drives.heard.get(Function.SDO_REQUEST + 1, 0) == heard
