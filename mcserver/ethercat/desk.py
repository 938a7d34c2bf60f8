"""One drive on EtherCAT by its mailbox, without a server: only where nobody else sends frames on the line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from mcserver.canopen.desk import LEAST_LISTEN_S, Desk
from mcserver.canopen.settings import DriveSettings
from mcserver.ethercat.master import EthercatMaster
from mcserver.ethercat.slave import EthercatSlave
from mcserver.ethercat.tap import refuse_other_master
from mcserver.machine.bus_section import BusConfig


class EthercatDesk(Desk):
    """A drive's parameters by its mailbox, and the error counters of its slave controller."""

    def __init__(self, drive: DriveSettings, slave: EthercatSlave) -> None:
        # a line has one master, which is this one: a second one is not told from it
        super().__init__(drive, slave.sdo, lambda: None)
        self._slave = slave

    def line_errors(self) -> dict[str, list[int]]:
        return self._slave.error_counters


@contextmanager
def at_ethercat_desk(drive: DriveSettings) -> Iterator[Desk]:
    """Listen whether a master is at work on the drive's line, bring the line to PREOP, and give its desk.

    No slave leaves PREOP, in which nothing moves.

    Raises:
        ConfigurationError: MC008, MC016. RuntimeFault: MC424 the interface, MC560 another master; MC550,
            MC555 the drive.
    """
    refuse_other_master(drive.address, drive.name, max(LEAST_LISTEN_S, drive.listen_s))
    bus = BusConfig(drive.bus, drive.address, kind="ethercat", redundant_interface=drive.redundant_interface)
    # its process data do not matter here, nor does its cycle
    master = EthercatMaster(bus, [drive], 0.001)
    try:
        master.find()
        (slave,) = master.slaves
        yield EthercatDesk(drive, slave)
    finally:
        master.close()
