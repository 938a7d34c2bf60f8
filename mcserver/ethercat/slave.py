"""One drive on EtherCAT as its master sees it: its mailbox, its registers, its state."""

from __future__ import annotations

import enum
import threading
from contextlib import suppress
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

from mcserver.can.pdo import ProcessData
from mcserver.canopen.abort_codes import refused, unanswered
from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.coe import SYNC_TYPE
from mcserver.canopen.node import Identity, NodeAxis
from mcserver.canopen.sdo_write import SdoWrite
from mcserver.canopen.settings import STORING, DriveSettings

# SOEM's own time for an answer of a mailbox; a drive may have longer, never less [s].
LEAST_ANSWER_S = 0.7
# An object that is longer than what is tried first.
MOST_BYTES = 64 * 1024
# Registers of a slave controller (ETG.1000.4): DL status, AL control and status, features, watchdog, FMMUs,
# sync managers.
DL_STATUS, AL_CONTROL, AL_STATUS, FEATURES = 0x0110, 0x0120, 0x0130, 0x0008
WATCHDOG_DIVIDER, WATCHDOG = 0x0400, 0x0420
# Frames that came damaged, or were lost with a link, by port (ETG.1000.4, 6.1).
ERROR_COUNTERS = MappingProxyType(
    {
        "invalid frames": (0x0300, 2),
        "receive errors": (0x0301, 2),
        "forwarded errors": (0x0308, 1),
        "lost links": (0x0310, 1),
    }
)
PORTS = 4
FMMUS, SYNC_MANAGERS, MAILBOXES = (0x0600, 48), (0x0800, 32), (0x0800, 16)
# What one slave adds to the working counter of LRW: outputs 2, inputs 1.
SLAVE_COUNT, OUTPUT_COUNT = 3, 2
_HAS_CLOCK = 0x04
_WATCHDOG_UNIT_NS = 40
GREATEST_WATCHDOG = 0xFFFF


class AlState(enum.IntEnum):
    """States of the application layer (ETG.1000.6); NONE: the slave does not answer."""

    NONE = 0
    INIT = 1
    PREOP = 2
    BOOT = 3
    SAFEOP = 4
    OP = 8


ACKNOWLEDGE = ERROR = 0x10


def line_errors() -> tuple[type[Exception], ...]:
    """Return what pysoem, an optional package, raises where a frame, a counter or a mailbox fails."""
    import pysoem

    return (
        pysoem.WkcError,
        pysoem.PacketError,
        pysoem.MailboxError,
        pysoem.SdoError,
        pysoem.NetworkInterfaceNotOpenError,
    )


class MailboxSdo:
    """CoE with one slave; one transfer at a time, threads wait for each other, the cycle goes on beside it.

    Args:
        soem: pysoem's master, which has the times of its slaves. device: of pysoem.
    """

    def __init__(self, soem: Any, device: Any, settings: DriveSettings) -> None:
        self._soem = soem
        self._device = device
        self._settings = settings
        self._turn = threading.Lock()
        # told by 603Fh in the cycle
        device.add_emergency_callback(lambda _message: None)

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        """Read an object.

        Raises:
            DriveError: MC553 the drive refuses, MC554 it does not answer.
        """
        attempts = attempts or self._settings.sdo.attempts
        size = 0
        answer_us = self._answer_us(self._settings.sdo.response_s)
        for left in range(attempts, -1, -1):
            try:
                with self._turn:
                    self._soem.sdo_read_timeout = answer_us
                    return bytes(self._device.sdo_read(index, subindex, size, release_gil=True))
            except line_errors() as error:
                abort = getattr(error, "abort_code", None)
                if abort:
                    raise refused(self._settings, index, subindex, "read", abort) from None
                size = MOST_BYTES
                if not left:
                    raise self._silent(index, subindex, "read", error) from None
        raise AssertionError("an attempt returns or raises")

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        """Write an object; one whose answer stays out is repeated only where it does not hold the value.

        Raises:
            DriveError: as `upload`.
        """
        attempts = attempts or self._settings.sdo.attempts
        times = self._settings.sdo
        if index in STORING:
            # a reading is repeated until its own answer comes: of questions that were given up none is left,
            # which this command, given once, would take for its own
            with suppress(DriveError):
                self.upload(index, 0)
        answer_us = self._answer_us(times.store_s if index in STORING else times.response_s)
        for left in range(attempts - 1, -1, -1):
            try:
                with self._turn:
                    self._soem.sdo_write_timeout = answer_us
                    self._device.sdo_write(index, subindex, bytes(payload), release_gil=True)
                return
            except line_errors() as error:
                abort = getattr(error, "abort_code", None)
                if abort:
                    raise refused(self._settings, index, subindex, "written", abort) from None
                if index in STORING or not left:
                    raise self._silent(index, subindex, "written", error) from None
                if self.upload(index, subindex) == payload:
                    return

    @staticmethod
    def _answer_us(seconds: float) -> int:
        return round(1e6 * max(LEAST_ANSWER_S, seconds))

    def _silent(self, index: int, subindex: int, verb: str, error: Exception) -> DriveError:
        shown = getattr(error, "desc", "") or str(error) or type(error).__name__
        return unanswered(
            self._settings,
            index,
            subindex,
            f"could not be {verb}: no answer by the mailbox ({shown})",
            "check the drive's power and the cable in front of it",
        )


@dataclass
class EthercatSlave:
    """A drive of the machine file; as `mcserver.canopen.node_configuration.ConfiguredNode`.

    Attributes:
        device: of pysoem. planned: its process data. writes: its configuration. registers: its sync managers
            and FMMUs once they are set, by address. clocked: it acts at SYNC0.
    """

    settings: DriveSettings
    device: Any
    sdo: MailboxSdo
    planned: ProcessData
    writes: list[SdoWrite]
    axes: tuple[NodeAxis, ...] = ()
    identity: Identity = field(default_factory=Identity)
    dropped: frozenset[str] = frozenset()
    remarks: tuple[str, ...] = ()
    registers: dict[int, bytes] = field(default_factory=dict)
    clocked: bool = False

    def read_register(self, address: int, length: int) -> bytes:
        """Read physical memory; empty where the slave does not answer."""
        try:
            return bytes(self.device._fprd(address, length))
        except line_errors():
            return b""

    def write_register(self, address: int, data: bytes) -> bool:
        """Write physical memory; False: the slave has not taken it."""
        try:
            self.device._fpwr(address, data)
        except line_errors():
            return False
        return True

    def request(self, state: AlState, *, acknowledge: bool = False) -> bool:
        """Ask for a state; False: the slave has not heard it."""
        control = state | (ACKNOWLEDGE if acknowledge else 0)
        return self.write_register(AL_CONTROL, int(control).to_bytes(2, "little"))

    @property
    def can_be_clocked(self) -> bool:
        """Whether it has a distributed clock, and is configured to act at SYNC0."""
        features = self.read_register(FEATURES, 2)
        asked = any(write.index == SYNC_TYPE for write in self.writes)
        return asked and bool(features and features[0] & _HAS_CLOCK)

    @property
    def links(self) -> int | None:
        """How many of its ports have a cable with somebody at its other end; None: it does not answer."""
        status = self.read_register(DL_STATUS, 2)
        return (status[0] >> 4).bit_count() if status else None

    @property
    def error_counters(self) -> dict[str, list[int]]:
        """What it has counted since it was switched on, by port, to 255; empty: it does not answer."""
        start = min(address for address, _ in ERROR_COUNTERS.values())
        end = max(address for address, _ in ERROR_COUNTERS.values()) + PORTS
        counted = self.read_register(start, end - start)
        return {
            name: list(counted[address - start :: step][:PORTS])
            for name, (address, step) in ERROR_COUNTERS.items()
            if counted
        }

    def set_watchdog(self) -> None:
        """Let it leave OP when process data stay out for the time-out of commands."""
        divider = int.from_bytes(self.read_register(WATCHDOG_DIVIDER, 2), "little")
        unit_ns = (divider + 2) * _WATCHDOG_UNIT_NS
        count = min(GREATEST_WATCHDOG, max(1, round(self.settings.command_timeout_ms * 1e6 / unit_ns)))
        self.write_register(WATCHDOG, count.to_bytes(2, "little"))
