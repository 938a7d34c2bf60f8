"""How a bus is, of either kind, listened to beside whoever is its master."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from mcserver.can.open import open_port
from mcserver.can.pdo import ProcessData
from mcserver.can.port import ListeningPort
from mcserver.canopen.bus_report import bus_report
from mcserver.canopen.coe import configure_coe
from mcserver.canopen.cycle_samples import Signal
from mcserver.canopen.settings import settings_of
from mcserver.canopen.views import BusHealth
from mcserver.ethercat.line_tap import LineTap
from mcserver.machine.machine_file import Machine

# Of EtherCAT [bit/s].
LINE_BITRATE = 100e6


def listen(machine: Machine, bus: str) -> ListeningPort:
    """Open a bus for listening beside its master.

    Raises:
        ConfigurationError: MC008, MC552 drives on EtherCAT. RuntimeFault: MC424.
    """
    drives = [drive for drive in settings_of(machine) if drive.bus == bus]
    if drives[0].fieldbus != "ethercat":
        return open_port(drives[0].address)
    ends = [each for each in (drives[0].address, drives[0].redundant_interface) if each]
    line = sorted(drives, key=lambda drive: drive.node)
    return LineTap(ends, [configure_coe(drive, machine.cycle_s)[1].process_data for drive in line])


def bus_health(
    machine: Machine,
    bus: str,
    seconds: float,
    data: Mapping[int, ProcessData],
    signals: Sequence[Signal],
    check: Callable[[], None] = lambda: None,
) -> BusHealth:
    """Listen on a bus and count; nothing is sent.

    Args:
        data, signals, check: as `bus_report`.

    Raises:
        ConfigurationError, RuntimeFault: as `listen`.
    """
    port = listen(machine, bus)
    try:
        found = bus_report(machine, bus, port, seconds, data, signals, check)
    finally:
        port.close()
    if isinstance(port, LineTap):
        counts = found.counts
        counts.frames, counts.load = port.counters.sent, port.bits / counts.duration_s / LINE_BITRATE
        found.master = "frames of EtherCAT" if port.counters.sent else ""
        for node in counts.nodes:
            # on the line, as the machine file counts
            node.node, node.state = node.node - 1, "–"
    return found
