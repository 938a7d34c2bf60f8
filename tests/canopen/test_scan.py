"""Looking who is on a bus, without a machine file."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path

import pytest

from mcserver.can.cob import Function, NmtState
from mcserver.can.open import open_port
from mcserver.canopen.access import OperatorAccess
from mcserver.canopen.bus_scan import with_eds
from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.eds_text import device_of
from mcserver.canopen.scan import machine_file, scan
from mcserver.canopen.views import ScannedNode
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
    assert nodes[1].modes == ["pp", "pv", "tq", "hm", "ip", "csp", "csv", "cst"]
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


def test_the_machine_file_has_what_the_drive_says_of_its_mechanics_and_limits(
    hub: RunningHub, make_drives: Make
) -> None:
    drives = make_drives(3)
    for place, value in {
        (0x608F, 1): 4096,
        (0x608F, 2): 1,
        (0x6091, 1): 50,
        (0x6091, 2): 1,
        (0x6092, 1): 36000,
        (0x6092, 2): 1,
        (0x607D, 1): (-9000) & 0xFFFFFFFF,
        (0x607D, 2): 18000,
        (0x6076, 0): 640,
        (0x6080, 0): 3000,
    }.items():
        drives[3].objects[place] = value.to_bytes(4, "little")
    port = open_port(hub.address())
    nodes = scan(port)
    port.close()
    (axis,) = parse_machine(machine_file("cell", hub.address(), nodes)).axes
    degree = axis.type.si_per_unit
    assert (axis.drive.encoder, axis.drive.gear, axis.drive.rated_torque) == ((4096, 1), (50, 1), 0.64)
    assert axis.max_velocity == pytest.approx(3000 * 6 / 50 * degree)
    assert axis.min_position == pytest.approx(-90 * degree)
    assert axis.max_position == pytest.approx(180 * degree)


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


def eds_of(vendor: int, product: int) -> str:
    return (
        f"[FileInfo]\nFileName=x\n[ DeviceInfo ]\nVendorNumber=0x{vendor:X}\nProductNumber={product} ; it\n"
    )


def test_a_running_machine_sees_its_own_drives_and_strangers_and_leaves_both_alone(
    hub: RunningHub, make_drives: Make, watched: Watched
) -> None:
    drives = make_drives(1, 9)
    service = watched.start(machine_on(hub.address(), [1]))
    drives[1].objects[0x6502, 0] = (1 << 7).to_bytes(4, "little")
    resets, written = drives[1].resets, list(drives[1].written)
    access = OperatorAccess(service)
    try:
        [found] = asyncio.run(access.scan(""))
        with pytest.raises(DriveError, match="there is no bus"):
            asyncio.run(access.scan("right"))
    finally:
        access.close()
    assert [(node.node, node.axis) for node in found.nodes] == [(1, 0), (9, None)]
    assert found.nodes[0].modes == ["csp"]
    assert (drives[1].resets, drives[1].written) == (resets, written)
    assert (drives[9].resets, drives[9].written) == (0, [])
    assert [axis.drive.node for axis in parse_machine(found.machine_file).axes] == [1, 9]


def test_an_eds_file_is_suggested_by_vendor_and_product_and_odd_files_are_passed_over(tmp_path: Path) -> None:
    (tmp_path / "a.eds").write_text("[DeviceInfo]\nVendorNumber=much\nProductNumber=5\n")
    (tmp_path / "b.eds").write_bytes(b"\xff\xfe\x00garbage\x00" * 50)
    (tmp_path / "c.EDS").write_text(eds_of(0x11, 34))
    (tmp_path / "d.eds").write_text(eds_of(0x11, 35))
    (tmp_path / "e.eds").mkdir()
    nodes = [ScannedNode(1, 402, "drive", 0x11, 34), ScannedNode(2, 402, "drive", 0x11, 36)]
    nodes.append(ScannedNode(3, 402, "drive"))
    found = with_eds(nodes, [tmp_path, tmp_path / "nowhere"])
    assert [Path(node.eds).name for node in found] == ["c.EDS", "", ""]
    assert f'eds = "{tmp_path / "c.EDS"}"' in machine_file("cell", "can0", found)


@pytest.mark.parametrize("text", ["", "[DeviceInfo]\nVendorNumber=0\nProductNumber=0\n", "VendorNumber=1\n"])
def test_a_file_without_an_identity_is_nobodys(text: str) -> None:
    assert device_of(text.encode()) is None
