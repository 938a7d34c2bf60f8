"""``mcserver machine check``, ``doctor --machine`` and ``run`` on machines with drives on CAN buses."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from mcserver.canopen.booted_drives import booted
from mcserver.canopen.drive_faults import find_drive_faults
from mcserver.cli.app import run_command_line
from mcserver.doctor import State
from mcserver.doctor.can import CanFacts, CanInterface
from mcserver.doctor.machine import BusFacts, judge_buses
from mcserver.errors import ConfigurationError
from mcserver.machine.machine_file import Machine, load_machine, parse_machine
from tests.canopen.rig import RunningHub, machine_on
from tests.cli.command import ROOT
from tests.ethercat.rig import line_of
from tests.machine_text import axes_text

Capture = pytest.CaptureFixture[str]
NO_CAN = CanFacts(sockets=False, virtual=False, interfaces=())
NOWHERE = "socketcand:127.0.0.1:9/can0"


def rotary_axis_on(bus: str) -> str:
    """The machine file of one axis, whose drive's section ends it."""
    keys = f'bus = "{bus}"\nnode = 1\ncounts_per_motor_rev = 1000'
    return '[machine]\nname = "m"\ncycle_hz = 100\n' + axes_text(rotary=True, drive="cia402", drive_keys=keys)


def codes(machine: Machine) -> list[tuple[str, str]]:
    return [(found.code, found.severity) for found in find_drive_faults(machine)]


def test_drives_without_eds_are_beyond_doubt() -> None:
    assert codes(machine_on(NOWHERE, [1, 2])) == []


def test_a_machine_without_can_has_nothing_to_check() -> None:
    assert codes(load_machine("cartesian")) == []


def test_a_faulty_eds_is_an_error_with_its_place(tmp_path: Path) -> None:
    file = tmp_path / "bad.eds"
    text = (ROOT / "mcserver" / "drive_sim" / "cia402.eds").read_text()
    file.write_text(text.replace("DataType=0x0006", "DataType=four"))
    (found,) = find_drive_faults(machine_on(NOWHERE, [1], f'eds = "{file}"'))
    assert (found.code, found.severity, found.axis) == ("MC008", "error", 0)
    assert "bad.eds, section [6040], DataType: 'four' is no number" in found.message


def test_an_eds_that_is_not_there_is_an_error() -> None:
    assert codes(machine_on(NOWHERE, [1], 'eds = "/no/such.eds"')) == [("MC008", "error")]


def test_an_eds_without_a_needed_object_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "short.eds"
    file.write_text("[1000]\nParameterName=Device type\nDataType=7\nAccessType=ro\n")
    assert codes(machine_on(NOWHERE, [1], f'eds = "{file}"')) == [("MC552", "error")]


def test_a_cycle_that_drives_cannot_be_given_is_an_error() -> None:
    machine = msgspec.structs.replace(machine_on(NOWHERE, [1]), cycle_hz=240.0)
    assert codes(machine) == [("MC552", "error")]


def test_a_drive_that_watches_nobody_earns_a_warning() -> None:
    assert codes(machine_on(NOWHERE, [1], "heartbeat_ms = 0")) == [("MC022", "warning")]


@pytest.mark.parametrize(
    ("cycle_hz", "in_position", "severity"),
    [
        (50.0, 0.01, "error"),
        (50.0, 25.0, "warning"),
        (100.0, 0.01, "error"),
        (1000.0, 0.01, None),
    ],
)
def test_a_torque_loop_that_the_bus_makes_too_soft_for_its_own_tolerance_is_refused(
    cycle_hz: float, in_position: float, severity: str | None
) -> None:
    keys = 'mode = "cst"\nrated_torque = 1.0\ninertia = 1e-3'
    axis_keys = f"max_following_error = 50.0\nin_position = {in_position}"
    machine = machine_on(NOWHERE, [1], keys, axis_keys=axis_keys, cycle_hz=cycle_hz)
    found = [each for each in find_drive_faults(machine) if "soft" in each.message]
    assert [each.severity for each in found] == ([] if severity is None else [severity])
    # 0.1 / T · 0.2 · 0.1 / T = 5 /s² at 50 Hz
    assert cycle_hz > 50.0 or "100 mm/s² holds the axis 20 mm off" in found[0].message


@pytest.mark.parametrize("kind", ["can", "ethercat"])
def test_a_server_does_not_start_with_a_torque_loop_that_is_too_soft(kind: str) -> None:
    keys = 'mode = "cst"\nrated_torque = 1.0\ninertia = 1e-3'
    machine = machine_on(NOWHERE, [1], keys, axis_keys="max_following_error = 50.0", cycle_hz=50.0)
    if kind == "ethercat":
        machine = msgspec.structs.replace(parse_machine(line_of(1, drive=keys)), cycle_hz=50.0)

    async def start() -> None:
        async with booted(machine, print, lambda: False):
            pass

    with pytest.raises(ConfigurationError, match=r"MC552.*torque loop is soft at 50 Hz"):
        asyncio.run(start())


@pytest.mark.parametrize(
    ("before", "after", "shown"),
    [
        ("DefaultValue=0x00020192", "DefaultValue=0x00000191", "a CiA 401 module (inputs and outputs)"),
        ("DefaultValue=0x00020192", "", "does not say what the device is"),
        ("DefaultValue=0x00020192", "DefaultValue=a servo drive", "does not say what the device is"),
        ("[6065]\n", "[6065]\nHighLimit=0x1FFFFFFFF\n", "has entries that cannot be read"),
        ("[6502]", "[6503]", "which modes the drive has (6502h:00)"),
    ],
)
def test_what_an_eds_leaves_open_or_says_of_another_device_is_a_warning(
    tmp_path: Path, before: str, after: str, shown: str
) -> None:
    text = (ROOT / "mcserver" / "drive_sim" / "cia402.eds").read_text()
    assert before in text
    eds = tmp_path / "drive.eds"
    eds.write_text(text.replace(before, after, 1))
    found = find_drive_faults(machine_on(NOWHERE, [1], f'eds = "{eds}"'))
    assert {(each.code, each.severity) for each in found} == {("MC022", "warning")}
    assert shown in found[0].message


def test_an_io_module_s_eds_that_lacks_a_drive_s_objects_is_named_as_one(tmp_path: Path) -> None:
    eds = tmp_path / "io.eds"
    eds.write_text("[1000]\nParameterName=Device type\nDataType=0x0007\nDefaultValue=0x000F0191\n")
    (found,) = find_drive_faults(machine_on(NOWHERE, [1], f'eds = "{eds}"'))
    assert found.code == "MC552"
    assert "it is of a CiA 401 module (inputs and outputs), not of a drive" in found.message


def test_an_object_that_cannot_be_read_and_is_not_used_refuses_no_eds(tmp_path: Path) -> None:
    text = (ROOT / "mcserver" / "drive_sim" / "cia402.eds").read_text()
    eds = tmp_path / "drive.eds"
    eds.write_text(text + "\n[5FFF]\nParameterName=Odd\nDataType=0x0006\nDefaultValue=65536\n")
    assert codes(machine_on(NOWHERE, [1], f'eds = "{eds}"')) == [("MC022", "warning")]


def test_the_simulated_drive_s_eds_is_beyond_doubt_and_a_dcf_of_another_node_is_not(tmp_path: Path) -> None:
    eds = ROOT / "mcserver" / "drive_sim" / "cia402.eds"
    assert codes(machine_on(NOWHERE, [1], f'eds = "{eds}"')) == []
    dcf = tmp_path / "drive.dcf"
    text = eds.read_text().replace("[6065]\n", "[6065]\nParameterValue=7\n")
    dcf.write_text(text + "\n[DeviceComissioning]\nNodeID=9\n")
    assert codes(machine_on(NOWHERE, [1], f'eds = "{dcf}"')) == [("MC022", "warning")]


def test_machine_check_exits_3_for_an_eds_that_cannot_be_read(tmp_path: Path, capfd: Capture) -> None:
    file = tmp_path / "machine.toml"
    file.write_text(rotary_axis_on("can0") + 'eds = "none.eds"\n')
    assert run_command_line(["machine", "check", str(file)]) == 3
    shown = capfd.readouterr()
    assert "error[MC008]" in shown.err
    assert f"{tmp_path}/none.eds" in shown.err


def test_the_load_of_each_bus_is_shown_with_its_arithmetic() -> None:
    machine = machine_on(NOWHERE, [1, 2, 3])
    load, connection = judge_buses(machine, [BusFacts("left", NOWHERE, 1_000_000)], NO_CAN)
    assert (load.state, load.title) == (State.OK, "left: load")
    assert "3 axes at 100 Hz" in load.found
    assert "× 135" in load.found
    assert connection.state is State.OK


def test_a_bus_that_is_nearly_full_is_advised_against() -> None:
    machine = msgspec.structs.replace(machine_on("can0", [1, 2, 3, 4, 5, 6]), cycle_hz=440.0)
    load, _ = judge_buses(machine, [BusFacts("left", "can0", 1_000_000)], NO_CAN)
    assert load.state is State.ADVICE
    assert "would still fit" in load.fix


@pytest.mark.parametrize(
    ("address", "fix"),
    [
        ("can0", "ip link set can0 up type can bitrate 500000"),
        (NOWHERE, "socketcand server"),
        ("udp:239.1.2.3:4000", "multicast"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_missing_with_its_mend(address: str, fix: str) -> None:
    machine = machine_on(address, [1])
    _, connection = judge_buses(machine, [BusFacts("left", address, 500_000, "refused")], NO_CAN)
    assert connection.state is State.MISSING
    assert fix in connection.fix


def test_another_bit_rate_than_the_machine_file_s_is_missing() -> None:
    interface = CanInterface("can0", True, 1000, "ERROR-ACTIVE", 0, 0, 500_000)
    can = CanFacts(sockets=True, virtual=False, interfaces=(interface,))
    _, connection = judge_buses(machine_on("can0", [1]), [BusFacts("left", "can0", 1_000_000)], can)
    assert connection.state is State.MISSING
    assert "bitrate 1000000" in connection.fix


def test_doctor_looks_at_the_buses_of_a_machine(hub: RunningHub, tmp_path: Path, capfd: Capture) -> None:
    file = tmp_path / "machine.toml"
    file.write_text(rotary_axis_on(hub.address()))
    run_command_line(["doctor", "--json", "--machine", str(file)])
    found = [each for each in json.loads(capfd.readouterr().out)["findings"] if each["area"] == "buses"]
    assert [each["state"] for each in found] == ["ok", "ok"]
    hub.stop()
    assert run_command_line(["doctor", "--json", "--machine", str(file)]) == 1
    found = [each for each in json.loads(capfd.readouterr().out)["findings"] if each["area"] == "buses"]
    assert [each["state"] for each in found] == ["ok", "missing"]


def test_doctor_refuses_a_machine_that_is_none(capfd: Capture) -> None:
    assert run_command_line(["doctor", "--machine", "none.toml"]) == 3
    assert "error[MC001]" in capfd.readouterr().err


def test_a_machine_without_can_needs_none_of_its_packages() -> None:
    looked = "import sys, mcserver.server, mcserver.cli.run; print({'can', 'canopen'} & set(sys.modules))"
    done = subprocess.run(
        [sys.executable, "-c", looked], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "set()\n"
