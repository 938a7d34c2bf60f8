"""The executor's process: ``python -m mcserver.executor.process``, with its machine on standard input.

It has one thread, which wakes at absolute deadlines. If a wake-up is late by a whole cycle or more, the
missed cycles are counted and left out: motion is delayed by them, without a jump or a burst.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, TypeGuard

import msgspec

from mcserver.drives.bus import ClockedBus, DriveBus
from mcserver.drives.registry import BUS_FACTORIES, BusFactory, create_buses, on_buses
from mcserver.errors import McError
from mcserver.executor.executor import Executor
from mcserver.executor.fault_codes import FaultCode
from mcserver.executor.process_start import ExitCode, Start
from mcserver.executor.realtime import MonotonicClock, lock_memory, take_realtime_priority
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.executor.shm.shared_memory import SharedParts, map_block
from mcserver.machine.drive import CanDrive, Drive
from mcserver.motion.kernels.rate_search import warm_up_playback
from mcserver.terminal import visible

if TYPE_CHECKING:
    from mcserver.ethercat.mailbox_relay import MailboxServer

# Motion is stopped after this time without a beat of the server [s]. This is for a server that hangs: one
# that has died is noticed sooner, as the parent process is gone. A loaded computer of two cores has kept a
# living server from beating for more than 0.5 s.
SERVER_TIMEOUT_S = 2.0
# How long axes are held after that stop before they are de-energized [s].
HOLD_AFTER_STOP_S = 1.0
# Longest time for motion to come to rest at the end of the process [s].
STOP_TIMEOUT_S = 10.0
# Period of checking the parent process [cycles]: motion that is played until its death is noticed is missing
# from the server's journal.
PARENT_CYCLES = 8
# Time constant with which the cycle follows a bus's clock [cycles].
CLOCK_FILTER_CYCLES = 16
# Greatest correction per cycle: the period divided by this.
GREATEST_CORRECTION = 100


class ServerWatch:
    """Watches the server by its beats and its process.

    Time is counted in executed cycles, so that a stall of the whole computer, server included, does not count
    as a loss.
    """

    def __init__(self, mailbox: CommandMailbox, cycle_s: float, parent: int) -> None:
        self._mailbox = mailbox
        self._patience = max(1, round(SERVER_TIMEOUT_S / cycle_s))
        self._parent = parent
        self._beat = mailbox.server_beat
        self._without = 0
        self._beating = False
        self._cycles = 0

    def lost(self) -> bool:
        """Return whether the server is lost; called once a cycle."""
        beat = self._mailbox.server_beat
        self._cycles += 1
        if beat != self._beat:
            self._beat = beat
            self._without = 0
            self._beating = True
            return False
        self._without += 1
        if self._beating and self._without >= self._patience:
            return True
        return self._cycles % PARENT_CYCLES == 0 and os.getppid() != self._parent


def _has_clock(bus: DriveBus) -> TypeGuard[ClockedBus]:
    return isinstance(bus, ClockedBus) and bus.clock_error_ns is not None


def clock_correction_ns(bus: ClockedBus, period: int) -> int:
    """Return the correction of the next cycle's start, positive for later, to follow the bus's clock [ns].

    Clocks differ by some 50 ppm, for which a first-order loop lags by less than a microsecond at 1 kHz.
    """
    error = bus.clock_error_ns
    if error is None:
        return 0
    most = period // GREATEST_CORRECTION
    return max(-most, min(most, -error // CLOCK_FILTER_CYCLES))


def run_loop(
    executor: Executor, mailbox: CommandMailbox, clock: MonotonicClock, parent: int, asked: Callable[[], bool]
) -> ExitCode:
    """Run cycles until the server requests the end or is lost, then bring the axes to rest if possible.

    Args:
        asked: returns whether something other than the mailbox requests the end.
    """
    cycle_s = executor.machine.cycle_s
    period = round(cycle_s * 1e9)
    watch = ServerWatch(mailbox, cycle_s, parent)
    result: ExitCode | None = None
    ending_since = 0
    number = 0
    standing_since: int | None = None
    clocked = next((bus for bus in executor.bank.buses if _has_clock(bus)), None)
    deadline = clock.now() + period
    mailbox.set_epoch(time.time() + period * 1e-9)
    while True:
        clock.sleep_until(deadline)
        missed = (clock.now() - deadline) // period
        if missed > 0:
            executor.late_cycles += missed
            number += missed
            deadline += missed * period
        executor.cycle(number * cycle_s)
        number += 1
        deadline += period if clocked is None else period + clock_correction_ns(clocked, period)
        if result is None:
            if watch.lost():
                result = ExitCode.SERVER_LOST
                executor.stop_all(FaultCode.SERVER_LOST)
                ending_since = number
            elif mailbox.quitting or asked():
                result = ExitCode.ASKED
                executor.stop_all()
                ending_since = number
            continue
        if executor.standing and standing_since is None:
            standing_since = number
        hold = 0.0 if result is ExitCode.ASKED else HOLD_AFTER_STOP_S
        if standing_since is not None and (number - standing_since) * cycle_s >= hold:
            return result
        if (number - ending_since) * cycle_s > STOP_TIMEOUT_S:
            return result


def _factories(mailboxes: MailboxServer | None) -> Mapping[type[Drive], BusFactory]:
    """Return the factories of the machine's buses; modules of EtherCAT are imported only if needed."""
    if mailboxes is None:
        return BUS_FACTORIES
    from mcserver.ethercat.open import open_ethercat

    return {**BUS_FACTORIES, CanDrive: on_buses({"ethercat": partial(open_ethercat, mailboxes=mailboxes)})}


def _mailboxes(descriptor: int) -> MailboxServer | None:
    """Return the server for the mailboxes of drives on EtherCAT; None: the machine has no such bus."""
    if descriptor < 0:
        return None
    from mcserver.ethercat.mailbox_relay import MailboxServer

    return MailboxServer(descriptor)


def main() -> int:
    """Run the process; return its exit code."""
    start = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Start)
    terminated: list[int] = []
    # Ctrl-C goes to the server too, which ends this process in order
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, _frame: terminated.append(number))
    parts: SharedParts = map_block(start.descriptor, start.machine)
    os.close(start.descriptor)
    machine, mailbox = start.machine, parts.mailbox
    # compile before drives are switched on and cycles begin
    warm_up_playback()
    mailboxes = _mailboxes(start.mailboxes)
    try:
        buses = create_buses(machine, _factories(mailboxes))
        executor = Executor(
            machine,
            buses,
            parts.rings,
            mailbox,
            parts.feedback,
            parts.events,
            references=start.references,
        )
        executor.mount(start.tool)
    except McError as error:
        print(visible(str(error)), file=sys.stderr, flush=True)  # noqa: T201
        return int(ExitCode.DRIVES)
    code = ExitCode.BROKEN
    if mailboxes is not None:
        mailboxes.start()
    try:
        locked = lock_memory()
        gc.collect()
        gc.freeze()
        gc.disable()
        if not (take_realtime_priority() and locked):
            executor.warn(FaultCode.NO_REALTIME)
        code = run_loop(executor, mailbox, MonotonicClock(), start.parent, lambda: bool(terminated))
    finally:
        if mailboxes is not None:
            # after a transfer under way: its bus is closed next
            mailboxes.close()
        executor.close()
    return int(code)


if __name__ == "__main__":
    sys.exit(main())
