"""The EDS file of the simulated drive: complete by CiA 306, and what the node really has."""

from __future__ import annotations

from configparser import RawConfigParser
from importlib import resources

import canopen
import pytest

from mcserver.can.pdo_layout import RPDO1, RPDO2, TPDO1, TPDO2
from mcserver.drive_sim.dictionary import EDS, ObjectStore


@pytest.fixture(scope="module")
def sections() -> RawConfigParser:
    parser = RawConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(resources.files("mcserver.drive_sim").joinpath(EDS).read_text("ascii"))
    return parser


def test_canopen_loads_it() -> None:
    with resources.as_file(resources.files("mcserver.drive_sim").joinpath(EDS)) as path:
        described = canopen.import_od(str(path), 5)
    assert described[0x1400][1].default == 0x205
    assert described[0x6502].default & 0x381 == 0x381


def test_every_object_is_listed_once_and_every_subindex_is_there(sections: RawConfigParser) -> None:
    listed = []
    for name in ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects"):
        count = sections.getint(name, "SupportedObjects")
        listed += [int(sections.get(name, str(number)), 16) for number in range(1, count + 1)]
        assert len(sections.options(name)) == count + 1
    described = [int(name, 16) for name in sections.sections() if len(name) == 4]
    assert sorted(listed) == sorted(described)
    for index in described:
        name = f"{index:04X}"
        if not sections.has_option(name, "SubNumber"):
            continue
        subindices = [each for each in sections.sections() if each.startswith(f"{name}sub")]
        assert len(subindices) == sections.getint(name, "SubNumber")


def test_numbers_of_pdos_are_those_of_the_device_information(sections: RawConfigParser) -> None:
    for option, first in (("NrOfRXPDO", 0x1400), ("NrOfTXPDO", 0x1800)):
        count = sections.getint("DeviceInfo", option)
        assert all(sections.has_section(f"{first + number:04X}") for number in range(count))
        assert not sections.has_section(f"{first + count:04X}")


def test_defaults_are_within_their_limits_and_types() -> None:
    store = ObjectStore(5)
    for entry in store._entries.values():
        if entry.packing:
            assert entry.least <= entry.value <= entry.greatest, f"{entry.index:04X}:{entry.subindex}"


def test_the_process_data_of_the_master_can_be_mapped() -> None:
    store = ObjectStore(5)
    for pdos, incoming in (((RPDO1, RPDO2), True), ((TPDO1, TPDO2), False)):
        for pdo in pdos:
            for wanted in pdo.objects:
                entry = store.entry(wanted.index, wanted.subindex)
                assert entry.bits == wanted.bits
                assert entry.mappable_in if incoming else entry.mappable_out
