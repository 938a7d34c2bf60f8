"""From a bus of the machine file to a port on it, its drives configured and supervised."""

from __future__ import annotations

import math

from mcserver.canopen.settings import settings_of
from mcserver.ethercat.mailbox_relay import MailboxServer
from mcserver.ethercat.master import EthercatMaster
from mcserver.ethercat.port import EthercatPort
from mcserver.ethercat.slave import AlState
from mcserver.ethercat.supervision import EthercatSupervision
from mcserver.ethercat.tap import refuse_other_master
from mcserver.machine.bus_section import BusConfig
from mcserver.machine.machine_file import Machine


def open_ethercat(machine: Machine, bus: BusConfig, mailboxes: MailboxServer | None = None) -> EthercatPort:
    """Boot the drives of a bus to SAFEOP; they go to OP once cycles run. May wait for some seconds.

    Args:
        mailboxes: through which the server reaches the drives, too.

    Raises:
        ConfigurationError: MC008, MC016, MC552. RuntimeFault: MC424 the interface; MC560 another master;
            MC550, MC551, MC553, MC554, MC555 a drive.
    """
    drives = [drive for drive in settings_of(machine) if drive.bus == bus.name]
    refuse_other_master(bus.address, f"bus {bus.name}", bus.listen_ms / 1e3)
    master = EthercatMaster(bus, drives, machine.cycle_s)
    try:
        master.boot()
    except BaseException:
        master.close()
        raise
    for device in master.soem.slaves:
        # what has no process data, such as a coupler, has nothing to wait for
        if not (device.output or device.input):
            device.state = AlState.OP
            device.write_state()
    timeout = min(drive.command_timeout_ms for drive in drives) / 1e3
    supervision: EthercatSupervision | None = None

    def close() -> None:
        if supervision is not None:
            supervision.close()
        for slave in master.slaves:
            slave.request(AlState.PREOP)
        master.close()

    port = EthercatPort(
        master.soem,
        master.slaves,
        silence_cycles=bus.silence_cycles,
        patience_cycles=math.ceil(timeout / machine.cycle_s),
        on_close=close,
        period_ns=round(machine.cycle_s * 1e9),
    )
    port.clocked = master.clocked
    supervision = EthercatSupervision(master, port)
    supervision.start()
    if mailboxes is not None:
        mailboxes.add(master.slaves)
    return port
