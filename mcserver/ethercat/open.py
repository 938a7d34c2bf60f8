"""From a bus of the machine file to a port on it, its drives configured and supervised."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from mcserver.can.pdo_layout import STATUSWORD
from mcserver.canopen.coe import ERROR_CODE
from mcserver.canopen.settings import settings_of
from mcserver.ethercat.mailbox_relay import MailboxServer, SlaveState
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
        mailboxes.add(master.slaves, lambda: _states(bus.name, master, port))
    return port


def _states(bus: str, master: EthercatMaster, port: EthercatPort) -> Sequence[SlaveState]:
    """Return every slave of a line now; nothing is sent."""
    # while no frame comes back nobody is asked, and nobody answers
    states = port.states if port.flowing else (AlState.NONE,) * len(master.slaves)
    drives = {
        slave.settings.place: (slave, state) for slave, state in zip(master.slaves, states, strict=True)
    }
    found = []
    for position, device in enumerate(master.soem.slaves):
        shown = SlaveState(bus, position, None, device.man, device.id, device.rev, device.name)
        if position in drives:
            slave, state = drives[position]
            exchanged = device.input if state >= AlState.SAFEOP else b""
            inputs = slave.planned.tpdos[0]
            shown = msgspec.structs.replace(
                shown,
                axis=slave.settings.axis,
                device_type=slave.identity.device_type,
                state=int(state),
                statusword=_word(exchanged, inputs.offset(STATUSWORD.index)),
                error_code=_word(exchanged, inputs.offset(ERROR_CODE.index)),
                begun=port.begun,
            )
        found.append(shown)
    return found


def _word(inputs: bytes, at: int | None) -> int | None:
    return int.from_bytes(inputs[at : at + 2], "little") if inputs and at is not None else None
