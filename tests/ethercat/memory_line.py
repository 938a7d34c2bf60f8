"""A line in memory in the place of pysoem: slaves by their process data, frames that come back or do not."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

from mcserver.can.pdo import ProcessData
from mcserver.canopen.coe import agreed_on_ethercat, configure_coe
from mcserver.canopen.settings import settings_of
from mcserver.drives.can_bus import CanBus
from mcserver.drives.cia402.loop_gains import ETHERCAT_DELAY_CYCLES
from mcserver.ethercat.port import EthercatPort
from mcserver.ethercat.slave import AlState, EthercatSlave, MailboxSdo
from mcserver.executor.executor import Executor
from mcserver.machine.machine_file import parse_machine
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.drives.fake_can import DISABLED, ENABLED, READY, SWITCHED_ON
from tests.ethercat.rig import line_of
from tests.executor.rig import Rig

FAULT = 0x08
_SIGNED = (0x607A, 0x6060, 0x6071, 0x60FF)


class MemorySlave:
    """A drive that goes to its target within a cycle; `output` and `input` as pysoem has them."""

    def __init__(self, data: ProcessData, position: int) -> None:
        self._data = data
        self.objects: dict[tuple[int, int], int] = {(0x6064, 0): position}
        self.output = bytes(data.rpdos[0].length)
        self.input = bytes(data.tpdos[0].length)
        self.word = DISABLED
        self.jumps: list[int] = []
        self.jammed = False
        self._sample()
        self._next = self.input

    def add_emergency_callback(self, callback: object) -> None:
        del callback

    def fail(self, code: int) -> None:
        """FAULT with an error code."""
        self.word = FAULT
        self.objects[0x603F, 0] = code
        self._next = self._sampled()

    def exchange(self) -> None:
        """The frame passes: it takes along what was sampled before."""
        self.input, self._next = self._next, self._sampled()
        at = 0
        for mapped in self._data.rpdos[0].objects:
            length = mapped.bits // 8
            raw = self.output[at : at + length]
            signed = mapped.index in _SIGNED
            self.objects[mapped.index, mapped.subindex] = int.from_bytes(raw, "little", signed=signed)
            at += length
        self._obey()

    def _obey(self) -> None:
        command = self.objects[0x6040, 0]
        if self.word == FAULT:
            if command & 0x80:
                self.word = DISABLED
                self.objects[0x603F, 0] = 0
        elif not command & 2:
            self.word = DISABLED
        elif self.word == DISABLED and command & 7 == 6:
            self.word = READY
        elif self.word == READY and command & 7 == 7:
            self.word = SWITCHED_ON
        elif self.word == SWITCHED_ON and command & 0xF == 0xF:
            self.word = ENABLED
            self.jumps.append(self.objects[0x607A, 0] - self.objects[0x6064, 0])
        elif self.word == ENABLED:
            self._follow()

    def _follow(self) -> None:
        if not self.jammed:
            self.objects[0x6064, 0] = self.objects[0x607A, 0]

    def _sample(self) -> None:
        self.input = self._sampled()

    def _sampled(self) -> bytes:
        self.objects[0x6041, 0] = self.word
        self.objects[0x6061, 0] = self.objects.get((0x6060, 0), 0)
        raw = b""
        for mapped in self._data.tpdos[0].objects:
            value = self.objects.get((mapped.index, mapped.subindex), 0)
            raw += struct.pack("<q", value)[: mapped.bits // 8]
        return raw


@dataclass
class MemoryMaster:
    """pysoem's master. lost: so many frames do not come back. silent: slaves that exchange nothing."""

    slaves: Sequence[MemorySlave]
    lost: int = 0
    silent: set[int] = field(default_factory=set)

    def send_processdata(self) -> int:
        for number, slave in enumerate(self.slaves):
            if number not in self.silent and not self.lost:
                slave.exchange()
        return 1

    def receive_processdata(self, timeout_us: int) -> int:
        del timeout_us
        if self.lost:
            self.lost -= 1
            return -1
        return 3 * (len(self.slaves) - len(self.silent))


@dataclass
class LineRig(Rig):
    """An executor at 1 kHz on a virtual clock, with two axes on a line in memory."""

    positions: Sequence[int] = (65536, -6553)
    make: type[MemorySlave] = MemorySlave

    def __post_init__(self) -> None:
        self.machine = described = agreed_on_ethercat(self.machine)
        slaves, self.drives = [], []
        for drive, position in zip(settings_of(described), self.positions, strict=True):
            writes, planned = configure_coe(drive, described.cycle_s)
            device = self.make(planned.process_data, position)
            self.drives.append(device)
            sdo = MailboxSdo(None, device, drive)
            slaves.append(EthercatSlave(drive, device, sdo, planned.process_data, writes))
        self.master = MemoryMaster(self.drives)
        self.port = EthercatPort(
            self.master,
            slaves,
            silence_cycles=described.buses[0].silence_cycles,
            patience_cycles=100,
            on_close=lambda: None,
            period_ns=1_000_000,
        )
        columns = list(range(len(slaves)))
        self.say(*(AlState.OP for _ in columns))
        bus = CanBus(
            described,
            described.buses[0],
            columns,
            opener=lambda _address: self.port,
            wait=lambda _seconds: None,
            delay_cycles=ETHERCAT_DELAY_CYCLES,
        )
        self.executor = VirtualExecutor(described, buses=[bus], recorder=self._record, homed=True)
        self.program = self.open(0)

    @property
    def core(self) -> Executor:
        return self.executor.executor

    def say(self, *states: AlState) -> None:
        """What the supervision has found."""
        self.port.states = states


def line_rig(drive: str = "", make: type[MemorySlave] = MemorySlave) -> LineRig:
    text = line_of(2, silence_cycles=3, drive=drive).replace("cycle_hz = 100", "cycle_hz = 1000")
    text = text.replace("max_velocity = 200.0", "max_velocity = 1000.0")
    text = text.replace("max_acceleration = 2000.0", "max_acceleration = 10000.0")
    return LineRig(
        parse_machine(text.replace("initial_position = 10.0", "initial_position = 0.0")), make=make
    )
