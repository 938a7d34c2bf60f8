"""``[[bus]]`` of the machine file: CAN and EtherCAT buses, and the drives on them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal

import msgspec

from mcserver.can.address import parse_address
from mcserver.errors import ConfigurationError
from mcserver.machine.drive import CanDrive, Drive
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.sections import BusSection
from mcserver.machine.toml_positions import Path


class BusConfig(msgspec.Struct, frozen=True):
    """One bus.

    Attributes:
        name: as in drives. address: see `mcserver.can.address`; for EtherCAT the network interface.
        redundant_interface: also connected to the last slave of EtherCAT; empty: none.
        bitrate: [bit/s]. distributed_clocks: EtherCAT slaves that support them act at SYNC0.
        silence_cycles: cycles without an answer that are a fault of the drive.
        sync: who sends SYNC; "foreign": another node on the bus. listen_ms: time to listen for another master
            before anything is sent [ms]. appear_timeout_s: of a node, from its first reset.
    """

    name: str
    address: str
    bitrate: int = 1_000_000
    silence_cycles: int = 3
    sync: Literal["own", "foreign"] = "own"
    listen_ms: int = 250
    appear_timeout_s: float = 10.0
    kind: Literal["can", "ethercat"] = "can"
    distributed_clocks: bool = True
    redundant_interface: str = ""


def _check_ethercat(section: BusSection, path: Path, mistakes: Mistakes) -> None:
    """Report keys that EtherCAT does not use."""
    usual = BusSection(section.name)
    for key, instead in (
        ("address", "give interface, a network interface of this computer"),
        ("bitrate", "EtherCAT has 100 Mbit/s: leave it out"),
        ("sync", "the drives act at the frame, or by their distributed clocks: leave it out"),
    ):
        if getattr(section, key) != getattr(usual, key):
            mistakes.add((*path, key), 'belongs to kind = "can"', instead)


def read_buses(
    sections: Iterable[BusSection | None], drives: Iterable[tuple[Path, int, Drive]], mistakes: Mistakes
) -> list[BusConfig]:
    """Return the buses of ``[[bus]]``, and those that drives name by address.

    Args:
        sections: None for one with a mistake.
        drives: path of the section, number of the axis, drive.
    """
    buses: dict[str, BusConfig] = {}
    names: dict[str, str] = {}  # by address

    def add(bus: BusConfig, path: Path, who: str) -> None:
        try:
            address = bus.address if bus.kind == "ethercat" else str(parse_address(bus.address))
        except ConfigurationError as error:
            mistakes.add(path, f"{who}{error.message}", error.hint, error.code)
            return
        if address in names:
            mistakes.add(path, f"{bus.address!r} is the address of bus {names[address]!r}", "use its name")
        names.setdefault(address, bus.name)
        buses[bus.name] = bus

    for position, section in enumerate(sections):
        if section is None:
            continue
        if section.name in buses:
            mistakes.add(("bus", position, "name"), f"{section.name!r} is there twice", "name each bus once")
            continue
        if section.kind == "ethercat":
            _check_ethercat(section, ("bus", position), mistakes)
        for named in ("interface", "redundant_interface"):
            if section.kind == "can" and getattr(section, named):
                mistakes.add(
                    ("bus", position, named), 'belongs to kind = "ethercat"', "give address, or that kind"
                )
        address = section.interface if section.kind == "ethercat" else section.address
        if section.redundant_interface == (address or section.name):
            mistakes.add(
                ("bus", position, "redundant_interface"),
                f"{section.redundant_interface!r} is where the line begins",
                "give the interface to which its last slave is connected",
            )
        bus = BusConfig(
            section.name,
            address or section.name,
            section.bitrate,
            section.silence_cycles,
            section.sync,
            section.listen_ms,
            section.appear_timeout_s,
            section.kind,
            section.distributed_clocks,
            section.redundant_interface,
        )
        add(bus, ("bus", position, "address"), "")
    owners: dict[tuple[str, int, int], int] = {}
    for path, axis, drive in drives:
        if not isinstance(drive, CanDrive) or not drive.bus:
            continue
        if drive.bus not in buses:
            add(BusConfig(drive.bus, drive.bus), (*path, "bus"), f"node {drive.node}: ")
        if drive.bus in buses:
            for named, what, hint in drive.misplaced(buses[drive.bus].kind):
                mistakes.add((*path, named), what, hint)
        owner = owners.setdefault((drive.bus, *drive.place), axis)
        if owner != axis and drive.node:
            mistakes.add(
                (*path, "node"),
                f"axes {owner} and {axis} both have node {drive.node} on bus {drive.bus}",
                "give each drive of a bus a node number of its own, or node_axis where it has several axes",
            )
    nodes = {(bus, node) for bus, node, _ in owners}
    borrowed: dict[tuple[str, int], int] = {}
    for path, axis, drive in drives:
        if not isinstance(drive, CanDrive) or drive.borrowed_node in (0, drive.node):
            continue
        key = (drive.bus, drive.borrowed_node)
        other = borrowed.setdefault(key, axis)
        if key in nodes or other != axis:
            mistakes.add(
                (*path, drive.borrowed_key),
                f"the COB-IDs of node {drive.borrowed_node} on bus {drive.bus} are in use",
                f"give the number of no node and of no other {drive.borrowed_key}",
            )
    return list(buses.values())
