"""Drives on EtherCAT as operators of a running machine reach them."""

from __future__ import annotations

import socket

from mcserver.canopen.access import LineDrive
from mcserver.canopen.coe import configure_coe
from mcserver.canopen.cycle_samples import Signal, signals_of
from mcserver.canopen.description import dictionary_of
from mcserver.canopen.settings import settings_of
from mcserver.canopen.views import BusHealth
from mcserver.ethercat.line_health import bus_health
from mcserver.ethercat.mailbox_relay import MailboxRelay, RelayedSdo
from mcserver.machine.machine_file import Machine


class OperatorLine:
    """As `mcserver.canopen.access.LineAccess`.

    Args:
        machine: as its file describes it. end: the server's, of `socket_pair`.

    Raises:
        ConfigurationError: MC008 a file of a drive.
    """

    def __init__(self, machine: Machine, end: socket.socket) -> None:
        relay = MailboxRelay(end)
        self._machine = machine
        self.drives = [
            LineDrive(drive, RelayedSdo(relay, drive), dictionary_of(drive))
            for drive in settings_of(machine)
            if drive.fieldbus == "ethercat"
        ]
        self.buses = sorted({each.settings.bus for each in self.drives})

    def health(self, bus: str, seconds: float) -> BusHealth:
        axes = {axis.index: axis for axis in self._machine.axes}
        own = [each for each in self.drives if each.settings.bus == bus]
        data = {
            each.settings.axis: configure_coe(each.settings, self._machine.cycle_s)[1].process_data
            for each in own
        }
        signals: list[Signal] = [
            signal
            for each in own
            for signal in signals_of(
                axes[each.settings.axis],
                data[each.settings.axis],
                each.dictionary,
                each.settings.node_axis,
            )
        ]
        return bus_health(self._machine, bus, seconds, data, signals)
