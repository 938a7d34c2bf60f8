"""The master of one EtherCAT bus, from its network interface to slaves in SAFEOP."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Sequence
from contextlib import suppress
from stat import S_ISSOCK
from typing import Any

from mcserver.canopen.coe import configure_coe
from mcserver.canopen.node import NodeAxis
from mcserver.canopen.node_configuration import configure_node
from mcserver.canopen.settings import DriveSettings
from mcserver.errors import ConfigurationError, McError, RuntimeFault
from mcserver.ethercat.slave import (
    AL_STATUS,
    FMMUS,
    SYNC_MANAGERS,
    AlState,
    EthercatSlave,
    MailboxSdo,
)
from mcserver.machine.bus_section import BusConfig

# Slaves that are switched on together appear one after the other [s].
ROUND_S = 0.2
STATE_LIMIT_S = 5.0
# SOEM reads the mapping back and takes an answer that is lost for no process data: once more from the start.
MAPPINGS = 2
# A frame that has not come back in this time is sent again; while drives boot nothing is in a hurry [µs].
BOOT_ANSWER_US, ANSWER_US = 50_000, 2000
# SYNC0 comes this share of a cycle behind the frame.
SYNC0_SHARE = 0.5


def _answer_at_once(*interfaces: str) -> None:
    """Let SOEM's sockets on some interfaces be asked without waiting.

    SOEM gives them a time-out of 1 µs, which Linux rounds up to a tick of its clock, 1 to 10 ms: a cycle
    would stand for so long where a frame is lost.
    """
    for descriptor in map(int, os.listdir("/proc/self/fd")):
        # one of them has read the folder, and is closed
        with suppress(OSError):
            if S_ISSOCK(os.fstat(descriptor).st_mode):
                with socket.socket(fileno=os.dup(descriptor)) as end:
                    if end.family == socket.AF_PACKET and end.getsockname()[0] in interfaces:
                        end.setblocking(False)


class EthercatMaster:
    """The slaves of one bus.

    Args:
        bus: of the machine. drives: those on it. cycle_s: of the machine.

    Attributes:
        soem: pysoem's master. is_ring: the last slave is connected to the computer, too.
        slaves: the drives, in the order of the machine file. clocked: a slave has a distributed clock that is
            used.

    Raises:
        ConfigurationError: MC016 pysoem is not installed. RuntimeFault: MC424 the interface.
    """

    def __init__(self, bus: BusConfig, drives: Sequence[DriveSettings], cycle_s: float) -> None:
        try:
            import pysoem
        except ModuleNotFoundError as error:
            raise ConfigurationError(
                "MC016",
                "drives on EtherCAT need the package pysoem, which is not installed",
                "pip install 'mcserver[ethercat]'",
            ) from error
        self._bus = bus
        self.is_ring = bool(bus.redundant_interface)
        self._drives = tuple(drives)
        self._cycle = cycle_s
        self.slaves: tuple[EthercatSlave, ...] = ()
        self.clocked = False
        self._timeouts = pysoem.settings.timeouts
        self._timeouts.ret = BOOT_ANSWER_US
        self.soem: Any = pysoem.Master()
        self._al_text = pysoem.al_status_code_to_string
        try:
            self.soem.open(bus.address, bus.redundant_interface or None)
            _answer_at_once(bus.address, bus.redundant_interface)
        except ConnectionError as error:
            where = " or ".join(each for each in (bus.address, bus.redundant_interface) if each)
            raise RuntimeFault(
                "MC424",
                f"bus {bus.name}: the interface {where} cannot be opened for EtherCAT",
                "`ip link` lists interfaces; raw sockets need root or CAP_NET_RAW",
            ) from error

    def close(self) -> None:
        """Give the interface back; a second call does nothing."""
        if self.soem.context_initialized:
            self.soem.close()

    def find(self) -> None:
        """Bring all slaves to PREOP, and give each drive its mailbox.

        Raises:
            DriveError: MC550 there are fewer than the machine file has, MC555 one does not go to PREOP.
        """
        furthest = max(self._drives, key=lambda drive: drive.node)
        deadline = time.monotonic() + furthest.appear_s
        while (count := max(0, self.soem.config_init(release_gil=True))) < furthest.node:
            if time.monotonic() >= deadline:
                shown = f"{count} slaves answer" if count else "no slave answers"
                missing = min((drive for drive in self._drives if drive.node > count), key=lambda d: d.node)
                raise missing.fault(
                    "MC550",
                    f"is not there: {shown} on {self._bus.address}",
                    "check power, the order of the cables (IN and OUT), and the interface",
                )
            time.sleep(ROUND_S)
        slaves = []
        for drive in self._drives:
            writes, planned = configure_coe(drive, self._cycle)
            device = self.soem.slaves[drive.node - 1]
            sdo = MailboxSdo(self.soem, device, drive)
            slave = EthercatSlave(drive, device, sdo, planned.process_data, writes, (NodeAxis(drive),))
            slaves.append(slave)
            self._await(slave, AlState.PREOP)
        self.slaves = tuple(slaves)

    def boot(self) -> None:
        """Find all drives, write their configuration, map process data, set clocks, and go to SAFEOP.

        Raises:
            DriveError: as `find`, and MC551 another device, or a slave that nobody knows, MC553, MC554.
        """
        for left in reversed(range(MAPPINGS)):
            self.find()
            for slave in self.slaves:
                configure_node(slave, slave.sdo, slave.writes, lambda: None)
                slave.set_watchdog()
            try:
                self._map()
                break
            except McError:
                if not left:
                    raise
        if self._bus.distributed_clocks and self.soem.config_dc():
            for slave in self.slaves:
                slave.clocked = slave.can_be_clocked
                self.start_clock(slave)
            self.clocked = any(slave.clocked for slave in self.slaves)
        for slave in self.slaves:
            self._await(slave, AlState.SAFEOP)
            for address, length in (FMMUS, SYNC_MANAGERS):
                slave.registers[address] = slave.read_register(address, length)
        self._timeouts.ret = ANSWER_US

    def _map(self) -> None:
        try:
            self.soem.config_map()
        except Exception as error:
            named = "; ".join(
                str(each) or type(each).__name__ for each in getattr(error, "error_list", [error])
            )
            raise RuntimeFault(
                "MC555",
                f"bus {self._bus.name}: its process data cannot be mapped: {named}",
                "see each drive's 1C12h and 1C13h",
            ) from error
        self._check_sizes()

    def start_clock(self, slave: EthercatSlave) -> None:
        """Let a slave with a distributed clock make SYNC0 in every cycle."""
        if slave.clocked:
            period = round(self._cycle * 1e9)
            slave.device.dc_sync(True, period, round(period * SYNC0_SHARE))

    def why(self, code: int) -> str:
        """An AL status code in words."""
        return f"{code:04X}h, {self._al_text(code)}" if code else "without a reason"

    def _await(self, slave: EthercatSlave, state: AlState) -> None:
        deadline = time.monotonic() + STATE_LIMIT_S
        while True:
            status = slave.read_register(AL_STATUS, 6)
            if status and status[0] == state:
                return
            if time.monotonic() >= deadline:
                break
            time.sleep(0.002)
        shown, code = "silent", 0
        if status:
            shown = AlState(status[0] & 0x0F).name if status[0] & 0x0F in set(AlState) else "in no state"
            code = int.from_bytes(status[4:6], "little")
        raise slave.settings.fault(
            "MC555",
            f"does not go to {state.name}: it is {shown} ({self.why(code)})",
            "see the AL status code in the drive's manual; switch it off and on",
        )

    def _check_sizes(self) -> None:
        drives = {slave.settings.node: slave for slave in self.slaves}
        for position, device in enumerate(self.soem.slaves):
            slave = drives.get(position + 1)
            sizes = len(device.output), len(device.input)
            if slave is None and any(sizes):
                raise RuntimeFault(
                    "MC551",
                    f"bus {self._bus.name}: position {position} is {device.name!r}, with process data that "
                    "the machine file does not have",
                    "name its drive in an [[axis]]; inputs and outputs on EtherCAT are not there yet",
                )
            if slave is None:
                continue
            planned = slave.planned.rpdos[0].length, slave.planned.tpdos[0].length
            if sizes != planned:
                raise slave.settings.fault(
                    "MC551",
                    f"exchanges {sizes[0]} and {sizes[1]} bytes, "
                    f"not the {planned[0]} and {planned[1]} of its mapping",
                    "its PDO assignment (1C12h, 1C13h) may be fixed: such a drive cannot be used",
                )
