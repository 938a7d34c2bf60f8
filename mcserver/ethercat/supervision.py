"""Slaves are brought to OP, watched, and brought back: beside the cycle, in a thread that never holds it.

The states are read ten times a second, and at once where the cycle misses an answer. A slave that has left
OP is told to the cycle first, which latches its axis; then it is brought back, a step a round: found again,
configured as at boot-up, its registers set as they were, and to OP. It is never energized by that.
"""

from __future__ import annotations

import logging
import threading
import time

from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.node_configuration import configure_node
from mcserver.ethercat.master import ANSWER_US, EthercatMaster
from mcserver.ethercat.port import EthercatPort
from mcserver.ethercat.slave import AL_STATUS, ERROR, FMMUS, MAILBOXES, SYNC_MANAGERS, AlState, EthercatSlave

log = logging.getLogger(__name__)

ROUND_S = 0.1
STEP_S = 0.01
FIRST_RETRY_S, LONGEST_RETRY_S = 1.0, 30.0
JOIN_S = 5.0
# A frame may be lost: one answer that stays out is no slave that is gone.
UNHEARD_ROUNDS = 3
# Less than the time after which a frame counts as lost [s].
ANSWER_S = 0.5 * ANSWER_US * 1e-6
RECOVER_US = 500
# A ring that is open does no harm yet [s].
RING_S = 1.0


class EthercatSupervision:
    """The thread of one bus; made by `start`, ended by `close`."""

    def __init__(self, master: EthercatMaster, port: EthercatPort) -> None:
        self._master = master
        self._port = port
        self._stopping = threading.Event()
        self._look = threading.Event()
        self._retry_at = [0.0] * len(master.slaves)
        self._failures = [0] * len(master.slaves)
        self._unheard = [0] * len(master.slaves)
        self._links = [slave.links for slave in master.slaves] if master.is_ring else []
        self._ring_at = 0.0
        self._open_at: list[str] = []
        port.troubled = self._look.set
        self._thread = threading.Thread(target=self._run, name="ethercat supervision", daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._stopping.set()
        self._look.set()
        if self._thread.is_alive():
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        pause = STEP_S
        while not self._stopping.is_set():
            self._look.wait(pause)
            self._look.clear()
            try:
                pause = STEP_S if self.round() else ROUND_S
            except Exception:
                log.exception("a round of the EtherCAT supervision failed")
                pause = ROUND_S

    def round(self) -> bool:
        """Read all states, and take one step with each slave that is not in OP; True: there are some."""
        port = self._port
        if not port.flowing:
            # without frames that come back every question would wait
            return True
        before = port.states
        if self._links and time.monotonic() >= self._ring_at:
            self._ring_at = time.monotonic() + RING_S
            self._look_at_ring()
        if self._master.soem.read_state() == AlState.OP and all(state is AlState.OP for state in before):
            return False
        found = []
        for number, slave in enumerate(self._master.slaves):
            found.append(self._confirmed(number, slave, before[number]))
            # the cycle goes first
            time.sleep(0)
        states = tuple(state for state, _, _ in found)
        if states != before:
            port.states = states
        now = time.monotonic()
        for number, (state, failed, code) in enumerate(found):
            if state is AlState.OP and not failed:
                self._failures[number] = 0
            elif state is before[number] is port.reported[number] and now >= self._retry_at[number]:
                # the cycle knows it: the axis is latched
                self._step(number, state, failed, code)
        return any(state is not AlState.OP for state in states)

    def _look_at_ring(self) -> None:
        """Say where a ring is open and when it is closed again: meanwhile frames go from both its ends."""
        open_at = [
            slave.settings.name
            for slave, links in zip(self._master.slaves, self._links, strict=True)
            if (now := slave.links) is not None and links is not None and now < links
        ]
        if open_at != self._open_at:
            self._open_at = open_at
            if open_at:
                log.warning(
                    "the ring is open at %s: one more cut, and drives are lost", " and ".join(open_at)
                )
            else:
                log.warning("the ring is closed again")

    def _confirmed(self, number: int, slave: EthercatSlave, before: AlState) -> tuple[AlState, bool, int]:
        """A state that is read twice alike, or that of before; silence counts after some rounds."""
        began = time.monotonic()
        status = self._status(slave)
        if status[0] is not AlState.NONE:
            self._unheard[number] = 0
        elif time.monotonic() - began < ANSWER_S:
            # the frame came back, and nobody was there
            self._unheard[number] = UNHEARD_ROUNDS
        else:
            self._unheard[number] += 1
        if status[0] is before:
            return status
        if status[0] is AlState.NONE:
            return status if self._unheard[number] >= UNHEARD_ROUNDS else (before, False, 0)
        return status if self._status(slave) == status else (before, False, 0)

    def _status(self, slave: EthercatSlave) -> tuple[AlState, bool, int]:
        status = slave.read_register(AL_STATUS, 6)
        if not status or status[0] & 0x0F not in set(AlState):
            return AlState.NONE, False, 0
        return (
            AlState(status[0] & 0x0F),
            bool(status[0] & ERROR),
            int.from_bytes(status[4:6], "little"),
        )

    def _step(self, number: int, state: AlState, failed: bool, code: int) -> None:
        slave = self._master.slaves[number]
        if failed:
            log.warning("%s: left OP for %s: %s", slave.settings.name, state.name, self._master.why(code))
            slave.request(state, acknowledge=True)
            return
        try:
            if state is AlState.NONE:
                slave.device.recover(RECOVER_US)
            elif state is AlState.INIT:
                address, length = MAILBOXES
                slave.write_register(address, slave.registers[SYNC_MANAGERS[0]][:length])
                slave.request(AlState.PREOP)
            elif state is AlState.PREOP:
                self._configure(slave)
            elif state is AlState.SAFEOP and self._port.begun:
                slave.request(AlState.OP)
        except DriveError as error:
            self._failures[number] += 1
            pause = min(LONGEST_RETRY_S, FIRST_RETRY_S * 2.0 ** (self._failures[number] - 1))
            self._retry_at[number] = time.monotonic() + pause
            log.warning("%s; tried again in %g s", error, pause)

    def _configure(self, slave: EthercatSlave) -> None:
        configure_node(slave, slave.sdo, slave.writes, lambda: None)
        slave.set_watchdog()
        at, skipped = SYNC_MANAGERS[0], MAILBOXES[1]
        slave.write_register(at + skipped, slave.registers[at][skipped:])
        slave.write_register(FMMUS[0], slave.registers[FMMUS[0]])
        self._master.start_clock(slave)
        slave.request(AlState.SAFEOP)
