"""An EtherCAT slave controller: registers, FMMUs, sync managers, EEPROM, distributed clock, AL states.

What the application makes of mailboxes, process data and states it says through `Application`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from mcserver.drive_sim.ethercat import registers as reg
from mcserver.drive_sim.ethercat.registers import AlCode, AlState

MEMORY = 0x3000
_SYNC_MANAGER = struct.Struct("<HHBBBB")
_FMMU = struct.Struct("<IHBBHBBB3x")
_READ, _WRITE = 1, 2
_EEPROM_READ, _EEPROM_READS_8_BYTES = 0x0100, 0x0040
MAILBOX_OUT, MAILBOX_IN, OUTPUTS, INPUTS = 0, 1, 2, 3


class Application(Protocol):
    """The device behind a controller."""

    def refuse(self, state: AlState) -> AlCode:
        """Return why a state cannot be gone to; `AlCode.NONE`: it can."""

    def enter(self, old: AlState, new: AlState) -> None:
        """The state has changed."""

    def take(self, message: bytes) -> None:
        """A mailbox message came."""

    def reply(self) -> bytes | None:
        """Return the next mailbox message for the master; None: there is none."""

    def exchange(self, outputs: bytes) -> bytes:
        """Take outputs in a cycle (empty: there are none, or they do not count), and return the inputs."""


@dataclass(frozen=True)
class SyncManager:
    """A buffer of process memory."""

    start: int
    length: int
    active: bool


class SlaveController:
    """One slave on the line.

    Args:
        eeprom: its SII. clock: local time [ns].

    Attributes:
        first, last: the cable in front of it, behind it, is open.
        silent: its sync managers of process data answer nothing. deaf: so many exchanges of process data
            are still missed. exchanged_at: of process data [ns].
    """

    def __init__(self, eeprom: bytes, application: Application, clock: Callable[[], int]) -> None:
        self._eeprom = eeprom
        self._application = application
        self._clock = clock
        self.first = self.last = False
        self.silent = False
        self.deaf = 0
        self.exchanged_at = 0
        self._memory = bytearray(MEMORY)
        self.switch_on()

    def switch_on(self) -> None:
        """Power comes: registers have their defaults, the state is INIT."""
        old = self.state
        self._memory[:] = bytes(MEMORY)
        memory = self._memory
        # type, revision, build, FMMUs, sync managers, RAM, ports (two MII), features (64-bit DC)
        memory[0:10] = struct.pack("<BBHBBBBH", 0x11, 2, 0, reg.FMMUS, reg.SYNC_MANAGERS, 8, 0x0F, 0x000C)
        self._put(reg.WATCHDOG_DIVIDER, "<H", 2498)
        self._put(reg.WATCHDOG_PROCESS_DATA, "<H", 1000)
        self._put(reg.AL_STATUS, "<H", AlState.INIT)
        self._inputs = b""
        self._sent = b""
        if old is not AlState.INIT:
            self._application.enter(old, AlState.INIT)

    @property
    def station_address(self) -> int:
        """As the master has set it."""
        return int.from_bytes(self._memory[reg.STATION_ADDRESS : reg.STATION_ADDRESS + 2], "little")

    @property
    def state(self) -> AlState:
        """Of the application layer."""
        return AlState(self._memory[reg.AL_STATUS] & 0x0F or AlState.INIT)

    @property
    def failed(self) -> bool:
        """Whether the error flag is set, until the master acknowledges it."""
        return bool(self._memory[reg.AL_STATUS] & reg.ERROR)

    @property
    def watchdog_ns(self) -> int:
        """Without process data for so long it leaves OP; 0: never."""
        (divider,) = struct.unpack_from("<H", self._memory, reg.WATCHDOG_DIVIDER)
        (count,) = struct.unpack_from("<H", self._memory, reg.WATCHDOG_PROCESS_DATA)
        return int((divider + 2) * reg.WATCHDOG_UNIT_NS * count)

    def sync_manager(self, number: int) -> SyncManager:
        """As the master has set it."""
        at = reg.SYNC_MANAGER + reg.SYNC_MANAGER_SIZE * number
        start, length, _, _, active, _ = _SYNC_MANAGER.unpack_from(self._memory, at)
        return SyncManager(start, length, bool(active & 1))

    def fail(self, state: AlState, code: int) -> None:
        """Fall to a state by itself, with the error flag."""
        old = self.state
        self._set_state(state, code, failed=True)
        if state is not old:
            self._application.enter(old, state)

    def watch(self) -> None:
        """Leave OP where process data have stayed out for too long."""
        limit = self.watchdog_ns
        if self.state is AlState.OP and limit and self._clock() - self.exchanged_at > limit:
            self.fail(AlState.SAFEOP, AlCode.WATCHDOG)

    def offer(self) -> None:
        """Put the next mailbox message into its buffer where there is room."""
        buffer = self.sync_manager(MAILBOX_IN)
        if not buffer.active or self._full(MAILBOX_IN) or self.state is AlState.INIT:
            return
        message = self._application.reply()
        if message is not None:
            self._sent = message.ljust(buffer.length, b"\x00")[: buffer.length]
            self._memory[buffer.start : buffer.start + buffer.length] = self._sent
            self._set_full(MAILBOX_IN, True)

    # ------------------------------------------------------------------ datagrams

    def read(self, address: int, into: memoryview, *, together: bool = False) -> int:
        """Read physical memory; returns 1, or 0 where nothing is to be had.

        Args:
            together: what is read is added to what other slaves have given (BRD).
        """
        length = len(into)
        if address + length > MEMORY:
            return 0
        mailbox = self._mailbox_at(MAILBOX_IN, address)
        if mailbox is not None:
            self.offer()
            if not self._full(MAILBOX_IN):
                return 0
        self._refresh(address, length)
        found = self._memory[address : address + length]
        if together:
            found = bytearray(one | other for one, other in zip(found, into, strict=True))
        into[:] = found
        if mailbox is not None and address + length >= mailbox.start + mailbox.length:
            self._set_full(MAILBOX_IN, False)
        return 1

    def write(self, address: int, data: bytes) -> int:
        """Write physical memory; returns 1, or 0 where it is not taken."""
        if address + len(data) > MEMORY:
            return 0
        mailbox = self._mailbox_at(MAILBOX_OUT, address)
        if mailbox is not None:
            if address + len(data) >= mailbox.start + mailbox.length:
                self._application.take(data)
            return 1
        if reg.AL_STATUS <= address < reg.AL_STATUS_CODE + 2 or reg.DL_STATUS <= address < reg.AL_CONTROL:
            return 0
        if address == reg.RECEIVE_TIMES:
            now = self._clock()
            for port in range(4):
                self._put(reg.RECEIVE_TIMES + 4 * port, "<I", now & 0xFFFFFFFF)
            self._put(reg.RECEIVE_TIME_UNIT, "<Q", now & (1 << 64) - 1)
            return 1
        if address == reg.SYSTEM_TIME:
            # its control loop would follow; the simulated clocks run alike
            return 1
        self._memory[address : address + len(data)] = data
        if address <= reg.AL_CONTROL < address + len(data):
            self._request_state(self._memory[reg.AL_CONTROL])
        if address <= reg.MAILBOX_IN_ACTIVATE < address + len(data):
            self._repeat()
        if address <= reg.EEPROM_CONTROL < address + len(data):
            self._eeprom_command()
        return 1

    def logical(self, address: int, payload: memoryview, *, reads: bool, writes: bool) -> int:
        """Exchange process data by the FMMUs; returns what the working counter gains."""
        if self.state not in (AlState.SAFEOP, AlState.OP) or self.silent:
            return 0
        if self.deaf:
            self.deaf -= 1
            return 0
        taken = given = False
        for start, length, physical, kind in self._mapped(address, len(payload)):
            where = payload[start : start + length]
            if kind & _WRITE and writes:
                self._memory[physical : physical + length] = where
                taken = True
        if taken and writes:
            self.exchanged_at = self._clock()
            outputs = self.sync_manager(OUTPUTS)
            counts = self.state is AlState.OP
            sent = bytes(self._memory[outputs.start : outputs.start + outputs.length]) if counts else b""
            # what the frame takes along was there before it came
            inputs, self._inputs = self._inputs, self._application.exchange(sent)
            buffer = self.sync_manager(INPUTS)
            shown = inputs.ljust(buffer.length, b"\x00")[: buffer.length]
            self._memory[buffer.start : buffer.start + buffer.length] = shown
        for start, length, physical, kind in self._mapped(address, len(payload)):
            if kind & _READ and reads:
                payload[start : start + length] = self._memory[physical : physical + length]
                given = True
        return (given and 1) + ((2 if reads else 1) if taken else 0)

    # ------------------------------------------------------------------ inside

    def _mapped(self, address: int, length: int) -> list[tuple[int, int, int, int]]:
        """Parts of a logical range that FMMUs map: place in it, length, physical address, direction."""
        found = []
        for number in range(reg.FMMUS):
            entry = _FMMU.unpack_from(self._memory, reg.FMMU + reg.FMMU_SIZE * number)
            start, size, _, _, physical, _, kind, active = entry
            if not active & 1 or start + size <= address or start >= address + length:
                continue
            first, end = max(start, address), min(start + size, address + length)
            found.append((first - address, end - first, physical + first - start, kind))
        return found

    def _mailbox_at(self, number: int, address: int) -> SyncManager | None:
        buffer = self.sync_manager(number)
        inside = buffer.active and buffer.start <= address < buffer.start + buffer.length
        return buffer if inside and self.state is not AlState.INIT else None

    def _repeat(self) -> None:
        """The master has lost the frame with a mailbox message: it toggles a bit to get it again."""
        asked = self._memory[reg.MAILBOX_IN_ACTIVATE] & reg.REPEAT
        if asked == self._memory[reg.MAILBOX_IN_ACTIVATE + 1] & reg.REPEAT:
            return
        self._memory[reg.MAILBOX_IN_ACTIVATE + 1] ^= reg.REPEAT
        buffer = self.sync_manager(MAILBOX_IN)
        if self._sent and buffer.active:
            self._memory[buffer.start : buffer.start + buffer.length] = self._sent
            self._set_full(MAILBOX_IN, True)

    def _status_at(self, number: int) -> int:
        return reg.SYNC_MANAGER + reg.SYNC_MANAGER_SIZE * number + reg.SM_STATUS

    def _full(self, number: int) -> bool:
        return bool(self._memory[self._status_at(number)] & reg.MAILBOX_FULL)

    def _set_full(self, number: int, full: bool) -> None:
        at = self._status_at(number)
        self._memory[at] = self._memory[at] & ~reg.MAILBOX_FULL | (reg.MAILBOX_FULL if full else 0)

    def _refresh(self, address: int, length: int) -> None:
        """Registers that are made as they are read."""
        if address <= self._status_at(MAILBOX_IN) < address + length:
            self.offer()
        if address <= reg.DL_STATUS < address + length:
            self._put(reg.DL_STATUS, "<H", reg.PORTS[self.first, self.last])
        if address <= reg.SYSTEM_TIME < address + length:
            (offset,) = struct.unpack_from("<q", self._memory, reg.SYSTEM_TIME_OFFSET)
            self._put(reg.SYSTEM_TIME, "<Q", (self._clock() + offset) & (1 << 64) - 1)

    def _request_state(self, control: int) -> None:
        old = self.state
        if control & reg.ERROR and self.failed:
            self._set_state(old, AlCode.NONE, failed=False)
        elif self.failed:
            return
        try:
            wanted = AlState(control & 0x0F)
        except ValueError:
            self._set_state(old, AlCode.UNKNOWN_STATE, failed=True)
            return
        code = self._refusal(old, wanted)
        if code:
            self._set_state(old, code, failed=True)
            return
        if wanted is not old:
            self._set_state(wanted, AlCode.NONE, failed=False)
            self.exchanged_at = self._clock()
            self._application.enter(old, wanted)
            if wanted is AlState.SAFEOP:
                # inputs count from here on
                self._inputs = self._application.exchange(b"")

    def _refusal(self, old: AlState, wanted: AlState) -> AlCode:
        if wanted is AlState.BOOT:
            return AlCode.BOOT_NOT_SUPPORTED
        order = (AlState.INIT, AlState.PREOP, AlState.SAFEOP, AlState.OP)
        if order.index(wanted) > order.index(old) + 1:
            return AlCode.INVALID_STATE_CHANGE
        boxes = self.sync_manager(MAILBOX_OUT), self.sync_manager(MAILBOX_IN)
        if wanted is AlState.PREOP and not all(box.active and box.length for box in boxes):
            return AlCode.INVALID_MAILBOX
        return self._application.refuse(wanted) if order.index(wanted) > order.index(old) else AlCode.NONE

    def _set_state(self, state: AlState, code: int, *, failed: bool) -> None:
        self._put(reg.AL_STATUS, "<H", state | (reg.ERROR if failed else 0))
        self._put(reg.AL_STATUS_CODE, "<H", code)

    def _eeprom_command(self) -> None:
        (command,) = struct.unpack_from("<H", self._memory, reg.EEPROM_CONTROL)
        (word,) = struct.unpack_from("<I", self._memory, reg.EEPROM_ADDRESS)
        if command & _EEPROM_READ:
            found = self._eeprom[2 * word : 2 * word + 8].ljust(8, b"\xff")
            self._memory[reg.EEPROM_DATA : reg.EEPROM_DATA + 8] = found
        self._put(reg.EEPROM_CONTROL, "<H", _EEPROM_READS_8_BYTES)

    def _put(self, address: int, packing: str, value: int) -> None:
        struct.pack_into(packing, self._memory, address, value)
