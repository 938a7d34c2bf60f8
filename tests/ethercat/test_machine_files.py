"""Machine files with drives on EtherCAT."""

from __future__ import annotations

import pytest

from mcserver.canopen.machine_file_check import check_drives
from mcserver.canopen.settings import settings_of, uses_can
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.errors import ConfigurationError
from mcserver.machine.bus_load import bus_loads
from mcserver.machine.machine_file import parse_machine
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.ethercat.rig import line_of


def test_a_drive_is_named_by_its_position() -> None:
    machine = parse_machine(line_of(3))
    assert [cia402_drive(axis).position for axis in machine.axes] == [0, 1, 2]
    assert settings_of(machine)[2].name == "axis 2, position 2 on line"
    assert not uses_can(machine)
    assert bus_loads(machine) == ()
    assert check_drives(machine) == []


def test_without_hardware_its_drives_are_simulated() -> None:
    VirtualExecutor(parse_machine(line_of(2))).close()


@pytest.mark.parametrize(
    ("was", "now", "said"),
    [
        ("position = 0", "node = 1", "position"),
        ("position = 0", "position = 0\nnode = 1", "node"),
        ("position = 1", "position = 0", "both have node 1"),
        ("position = 0", "position = 127", "position"),
        ("position = 0", 'position = 0\nmode = "ip"', "mode"),
        ("position = 0", "position = 0\nlss = [1, 2, 3, 4]", "lss"),
        ("position = 0", 'position = 0\nmonitor = ["6079h:00 voltage"]', "monitor"),
        ('kind = "ethercat"', 'kind = "ethercat"\nbitrate = 500000', "bitrate"),
        ('kind = "ethercat"', 'kind = "ethercat"\nsync = "foreign"', "sync"),
        ('kind = "ethercat"\n', "", "interface"),
        ('kind = "ethercat"', 'kind = "ethercat"\nredundant_interface = "ec0"', "redundant_interface"),
    ],
)
def test_what_does_not_fit_the_bus_is_refused(was: str, now: str, said: str) -> None:
    text = line_of(2)
    assert was in text
    with pytest.raises(ConfigurationError) as refused:
        parse_machine(text.replace(was, now, 1))
    assert said in str(refused.value)
