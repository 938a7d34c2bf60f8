"""The CAN buses of one machine file: their load, and whether this computer has them."""

from __future__ import annotations

import msgspec

from mcserver.can.address import Transport, parse_address
from mcserver.can.open import open_port
from mcserver.doctor.can import CanFacts
from mcserver.doctor.finding import Finding, advice, good, missing
from mcserver.errors import RuntimeFault
from mcserver.ethercat.tap import frames_heard
from mcserver.machine.bus_load import CEILING, BusLoad, bus_loads
from mcserver.machine.machine_file import Machine

AREA = "buses"
# A load from which on little is left for SDO and repetitions.
TIGHT = 0.9 * CEILING


class BusFacts(msgspec.Struct, frozen=True):
    """One bus of the machine: its address, and why it cannot be opened (empty: it can)."""

    name: str
    address: str
    bitrate: int
    refusal: str = ""
    kind: str = "can"


def probe_buses(machine: Machine) -> list[BusFacts]:
    """Open every bus once, and send nothing."""
    facts = []
    for bus in machine.buses:
        refusal = ""
        try:
            if bus.kind == "ethercat":
                frames_heard(bus.address, 0.0)
            else:
                open_port(bus.address).close()
        except RuntimeFault as error:
            refusal = error.message
        facts.append(BusFacts(bus.name, bus.address, bus.bitrate, refusal, bus.kind))
    return facts


def judge_buses(machine: Machine, buses: list[BusFacts], can: CanFacts) -> list[Finding]:
    """Findings about the machine's buses; nothing where it has none."""
    loads = {load.bus: load for load in bus_loads(machine)}
    findings: list[Finding] = []
    for bus in buses:
        if bus.name in loads:
            findings.append(_judge_load(loads[bus.name]))
        findings.append(_judge_connection(bus, can))
    return findings


def _judge_load(load: BusLoad) -> Finding:
    title = f"{load.bus}: load"
    shown = f"{100.0 * load.share:.0f} % with {load.axes} axes at {load.cycle_hz:g} Hz: {load.arithmetic()}"
    if load.share < TIGHT:
        return good(AREA, title, shown)
    return advice(
        AREA,
        title,
        shown,
        f"{100.0 * CEILING:.0f} % is the most, {load.greatest_cycle_hz} Hz would still fit: take another bus "
        "or a lower cycle_hz before drives are added",
    )


def _judge_connection(bus: BusFacts, can: CanFacts) -> Finding:
    title = f"{bus.name}: {bus.address}"
    if bus.kind == "ethercat":
        if bus.refusal:
            return missing(AREA, title, bus.refusal, f"ip link set {bus.address} up; root or CAP_NET_RAW")
        return good(AREA, title, "can be opened for EtherCAT")
    address = parse_address(bus.address)
    if bus.refusal:
        fix = "start the socketcand server, and check host, port and channel"
        if address.transport is Transport.SOCKETCAN:
            fix = (
                f"ip link set {address.channel} up type can bitrate {bus.bitrate}; without hardware: "
                f"modprobe vcan; ip link add {address.channel} type vcan; ip link set {address.channel} up"
            )
        elif address.transport is Transport.UDP:
            fix = "check that this computer's network carries multicast"
        return missing(AREA, title, bus.refusal, fix)
    for interface in can.interfaces:
        same = interface.name == address.channel and address.transport is Transport.SOCKETCAN
        if same and interface.bitrate not in (None, bus.bitrate):
            return missing(
                AREA,
                title,
                f"has {interface.bitrate} bit/s, the machine file says {bus.bitrate}",
                f"ip link set {interface.name} down; ip link set {interface.name} up type can bitrate "
                f"{bus.bitrate}; or set bitrate in [[bus]]",
            )
    return good(AREA, title, "can be opened")
