"""The executor's process: ``python -m mcserver.executor.process``, with its machine on standard input.

One thread, nothing else. It wakes at absolute deadlines; a wake-up that is a whole cycle late or more is
counted and the missed cycles are left out, so motion is delayed by them and never jumps or bursts.
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
from mcserver.executor.process_start import ExitCode, ProcessState, Start
from mcserver.executor.realtime import MonotonicClock, lock_memory, take_realtime_priority
from mcserver.executor.shm.mailbox import CommandMailbox
from mcserver.executor.shm.shared_memory import SharedParts, map_block
from mcserver.machine.drive import CanDrive, Drive
from mcserver.motion.kernels.rate_search import warm_up_playback
from mcserver.terminal import visible

if TYPE_CHECKING:
    from mcserver.ethercat.mailbox_relay import MailboxServer

# Without a beat of the server for this time motion is stopped [s]. A server that has died is noticed sooner,
# as the parent process that is gone; this is about one that hangs. A loaded computer of two cores was seen to
# keep a living server from beating for more than 0.5 s.
SERVER_TIMEOUT_S = 2.0
# How long axes are held after that stop before they are de-energized [s].
HOLD_AFTER_STOP_S = 1.0
# Motion that has not come to rest in this time, while ending, is cut off [s].
STOP_TIMEOUT_S = 10.0
# How often it is looked whether the parent process is still there [cycles]: what is played until then is run,
# and is not in the journal of the server that has died.
PARENT_CYCLES = 8
# The cycle follows a bus's clock with this time constant [cycles], at most by this part of a period a cycle.
CLOCK_FILTER_CYCLES = 16
GREATEST_CORRECTION = 100


class ServerWatch:
    """Whether the server lives, by its beats. Counted in executed cycles, so that a stall of the whole
    computer, server included, is no loss."""

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
    """How much later the next cycle begins than a period after this one, to follow the bus's clock [ns].

    Clocks differ by some 50 ppm, a loop of first order then is behind by less than a microsecond at 1 kHz.
    """
    error = bus.clock_error_ns
    if error is None:
        return 0
    most = period // GREATEST_CORRECTION
    return max(-most, min(most, -error // CLOCK_FILTER_CYCLES))


def run_loop(
    executor: Executor, mailbox: CommandMailbox, clock: MonotonicClock, parent: int, asked: Callable[[], bool]
) -> ExitCode:
    """Run cycles until the server asks for the end or is lost; axes are at rest then where that was possible.

    Args:
        asked: whether something else than the mailbox asks for the end.
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
                mailbox.set_executor_state(ProcessState.SERVER_LOST)
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
    """Return what makes the machine's buses; only a machine with EtherCAT imports what that needs."""
    if mailboxes is None:
        return BUS_FACTORIES
    from mcserver.ethercat.open import open_ethercat

    return {**BUS_FACTORIES, CanDrive: on_buses({"ethercat": partial(open_ethercat, mailboxes=mailboxes)})}


def _mailboxes(descriptor: int) -> MailboxServer | None:
    """Return what serves the mailboxes of drives on EtherCAT; None: the machine has no such bus."""
    if descriptor < 0:
        return None
    from mcserver.ethercat.mailbox_relay import MailboxServer

    return MailboxServer(descriptor)


def main() -> int:
    """Run the process; return its exit code."""
    start = msgspec.msgpack.decode(sys.stdin.buffer.read(), type=Start)
    terminated: list[int] = []
    # an interrupt from the keyboard goes to the server too, which ends this process in order
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, _frame: terminated.append(number))
    parts: SharedParts = map_block(start.descriptor, start.machine)
    os.close(start.descriptor)
    machine, mailbox = start.machine, parts.mailbox
    # before drives are switched on, and long before a cycle must not wait
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
        mailbox.set_executor_state(ProcessState.ENDED)
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
        mailbox.set_executor_state(ProcessState.RUNNING)
        code = run_loop(executor, mailbox, MonotonicClock(), start.parent, lambda: bool(terminated))
    finally:
        if mailboxes is not None:
            # behind a transfer under way: its line is closed next
            mailboxes.close()
        executor.close()
        mailbox.set_executor_state(ProcessState.ENDED)
    return int(code)


if __name__ == "__main__":
    sys.exit(main())
