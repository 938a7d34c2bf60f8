"""Drives on EtherCAT as operators of a running machine reach them."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Mapping, Sequence
from typing import cast

import msgspec

from mcserver.can.pdo import ProcessData
from mcserver.can.port import ListeningPort
from mcserver.canopen.bus_scan import said_by
from mcserver.canopen.coe import configure_coe
from mcserver.canopen.cycle_samples import Signal
from mcserver.canopen.description import dictionary_of
from mcserver.canopen.profiles import profile_text
from mcserver.canopen.reachable_drives import LineDrive
from mcserver.canopen.scan import machine_file, modes_of
from mcserver.canopen.settings import settings_of
from mcserver.canopen.views import BusHealth, BusScan, DriveInfo, DrivePhase, ScannedNode
from mcserver.drives.cia402.emergency_codes import emergency_text, is_error
from mcserver.drives.cia402.state import power_text
from mcserver.ethercat.line_health import bus_health, listen
from mcserver.ethercat.mailbox_relay import MailboxRelay, RelayedSdo, SlaveState
from mcserver.ethercat.slave import AlState
from mcserver.machine.machine_file import Machine

# A transfer under way may take longer than whoever asks for states waits: then the last ones are shown [s].
PATIENCE_S = 1.0


class OperatorLine:
    """As `mcserver.canopen.reachable_drives.LineAccess`.

    Args:
        machine: as its file describes it. end: the server's, of `socket_pair`.

    Raises:
        ConfigurationError: MC008 a file of a drive, MC552.
    """

    def __init__(self, machine: Machine, end: socket.socket) -> None:
        self.machine = machine
        self._relay = MailboxRelay(end)
        self._states: tuple[SlaveState, ...] = ()
        self._seen_at = time.monotonic()
        self.drives = [
            LineDrive(drive, RelayedSdo(self._relay, drive), dictionary_of(drive))
            for drive in settings_of(machine)
            if drive.fieldbus == "ethercat"
        ]
        self.buses = sorted({each.settings.bus for each in self.drives})

    def process_data(self) -> dict[int, ProcessData]:
        """Return what the cycle exchanges with the drives, by axis."""
        return {
            each.settings.axis: configure_coe(each.settings, self.machine.cycle_s)[1].process_data
            for each in self.drives
        }

    def infos(self) -> list[DriveInfo]:
        """Return the drives as they are; waits `PATIENCE_S` at most for its turn, then says how old it is."""
        slaves, kinds = self._looked(), {each.settings.axis: each.settings.kind for each in self.drives}
        age_s = time.monotonic() - self._seen_at
        return [_info(each, kinds[each.axis], age_s) for each in slaves if each.axis is not None]

    def scan(self, bus: str) -> BusScan:
        """Return who was found on a line at its start; its drives are asked by their mailboxes."""
        own = {each.settings.axis: each for each in self.drives if each.settings.bus == bus}
        address = next(each.settings.address for each in own.values())
        nodes = []
        for slave in self._looked():
            if slave.bus != bus:
                continue
            profile, known = (slave.device_type or 0) & 0xFFFF, slave.device_type is not None
            what = profile_text(profile) if known else slave.name
            identity = (slave.vendor, slave.product, slave.revision)
            node = ScannedNode(slave.position, profile, what, *identity, axis=slave.axis)
            drive = None if slave.axis is None else own[slave.axis]
            # one that does not answer would be waited for at each object
            if drive is not None and slave.state:
                supported, said = said_by(drive.sdo, drive.settings)
                node = msgspec.structs.replace(
                    node, modes=modes_of(supported), objects=said, eds=drive.settings.eds
                )
            nodes.append(node)
        file = machine_file("machine", address, nodes, "ethercat")
        return BusScan(bus, address, nodes, file, "ethercat")

    def listen(self, bus: str) -> ListeningPort:
        """As the function."""
        return listen(self.machine, bus)

    def health(
        self,
        bus: str,
        seconds: float,
        data: Mapping[int, ProcessData],
        signals: Sequence[Signal],
        check: Callable[[], None],
    ) -> BusHealth:
        """As `bus_health`."""
        return bus_health(self.machine, bus, seconds, data, signals, check)

    def _looked(self) -> tuple[SlaveState, ...]:
        found = self._relay.states(PATIENCE_S)
        if found is not None:
            self._states, self._seen_at = found, time.monotonic()
        return self._states


def _info(slave: SlaveState, kind: str, age_s: float) -> DriveInfo:
    state, word, code = AlState(slave.state), slave.statusword, slave.error_code or 0
    phase: DrivePhase = "operational"
    if state is AlState.NONE:
        phase = "lost"
    elif state is not AlState.OP:
        phase = "restarting" if slave.begun else "booting"
    return DriveInfo(
        axis=cast(int, slave.axis),
        kind=kind,
        bus=slave.bus,
        node=slave.position,
        state=phase,
        nmt=state.name.lower(),
        heartbeat_age_s=None if state is AlState.NONE else age_s,
        statusword=word,
        status="" if word is None else power_text(word),
        device_type=slave.device_type,
        vendor_id=slave.vendor,
        product_code=slave.product,
        emergency=f"{code:04X}h {emergency_text(code)}" if is_error(code) else "",
        emergency_code=code if is_error(code) else None,
        fieldbus="ethercat",
    )
