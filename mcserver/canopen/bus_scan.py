"""Who is on the buses of a running machine: its own nodes by their own transfers, the others as `scan`."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

import msgspec

from mcserver.can.open import open_port
from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.eds_text import device_of
from mcserver.canopen.node import Node
from mcserver.canopen.node_configuration import SdoClient
from mcserver.canopen.profiles import profile_text
from mcserver.canopen.scan import DRIVE_OBJECTS, machine_file, modes_of, object_key, scan
from mcserver.canopen.service_bus import CanopenBus
from mcserver.canopen.settings import NO_AXIS, DriveSettings
from mcserver.canopen.views import BusScan, ScannedNode

# Of each folder so many EDS files are looked into, of each so many bytes: its identity stands at the top.
MOST_FILES = 500
MOST_BYTES = 65_536


def scan_bus(bus: CanopenBus, name: str) -> BusScan:
    """Ask every node number of a bus; takes about two seconds. Nothing is configured, reset or started.

    Args:
        name: of the machine, for the file to start from.

    Raises:
        RuntimeFault: MC424 the bus cannot be opened.
    """
    own = {node.settings.node: node for node in bus.nodes}
    address = bus.nodes[0].settings.address
    port = open_port(address)
    try:
        others = scan(port, without=own)
    finally:
        port.close()
    folders = {Path(node.settings.eds).parent for node in bus.nodes if node.settings.eds}
    nodes = sorted([*others, *(_own(node) for node in bus.nodes)], key=lambda each: each.node)
    nodes = with_eds(nodes, folders)
    return BusScan(bus.name, address, nodes, machine_file(name, address, nodes))


def with_eds(nodes: Iterable[ScannedNode], folders: Collection[Path]) -> list[ScannedNode]:
    """Return the nodes, each with the first EDS file of the folders that has its vendor and product."""
    files = [path for folder in sorted(folders) for path in _files_of(folder)]
    by_device: dict[tuple[int, int], str] = {}
    for path in files:
        try:
            with path.open("rb") as file:
                device = device_of(file.read(MOST_BYTES))
        except OSError:
            continue
        if device is not None:
            by_device.setdefault(device, str(path))
    found = []
    for node in nodes:
        file_name = by_device.get((node.vendor_id or 0, node.product_code or 0), "")
        found.append(node if node.eds or not file_name else msgspec.structs.replace(node, eds=file_name))
    return found


def _files_of(folder: Path) -> list[Path]:
    try:
        names = sorted(path for path in folder.iterdir() if path.suffix.lower() in (".eds", ".dcf"))
    except OSError:
        return []
    return names[:MOST_FILES]


def _own(node: Node) -> ScannedNode:
    """Return a node of the machine: identity from its boot-up, modes by one transfer."""
    settings, identity = node.settings, node.identity
    profile = (identity.device_type or 0) & 0xFFFF
    supported = 0
    objects: dict[str, int] = {}
    if settings.kind == "cia402":
        supported, objects = said_by(node.sdo, settings)
    return ScannedNode(
        settings.node,
        profile,
        profile_text(profile) if identity.device_type is not None else settings.kind,
        identity.vendor_id,
        identity.product_code,
        modes=modes_of(supported),
        axis=None if settings.axis == NO_AXIS else settings.axis,
        eds=settings.eds,
        objects=objects,
    )


def said_by(sdo: SdoClient, settings: DriveSettings) -> tuple[int, dict[str, int]]:
    """Return 6502h (0: it is not there) and what else a drive says of itself, as `ScannedNode.objects`."""
    found = {object_key(*place): _read(sdo, settings, *place) for place in DRIVE_OBJECTS}
    supported = _read(sdo, settings, 0x6502, 0) or 0
    return supported, {key: value for key, value in found.items() if value is not None}


def _read(sdo: SdoClient, settings: DriveSettings, index: int, subindex: int) -> int | None:
    """Return an object of a drive's axis; None where it is lost, or has no such object."""
    try:
        payload = sdo.upload(index + settings.offset, subindex, attempts=1)
    except DriveError:
        return None
    return int.from_bytes(payload[:4], "little")
