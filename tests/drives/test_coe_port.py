"""The cycle over EtherCAT's CoE in place of CAN: another port and mailbox, the same CiA 402 axes."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import pytest

from mcserver.can.cob import SYNC, Function
from mcserver.can.port import Frame, PortCounters
from mcserver.canopen.configuration import configuration_writes
from mcserver.canopen.dictionary import generic_dictionary
from mcserver.canopen.settings import settings_of
from mcserver.drives.bus import DriveFault, DriveMode, DriveState, Setpoints
from mcserver.drives.can_bus import CanBus
from tests.drives.can_rig import machine
from tests.drives.fake_can import DISABLED, ENABLED, READY, SWITCHED_ON

HEADER = struct.Struct("<H")


@dataclass
class CoeSlave:
    """A slave with a mailbox (objects) and a process image by the mapping that was written there."""

    position: int = 0
    objects: dict[tuple[int, int], bytes] = field(default_factory=dict)
    outputs: dict[int, bytes] = field(default_factory=dict)  # by number of the PDO
    word: int = DISABLED

    def sdo_write(self, index: int, subindex: int, payload: bytes) -> None:
        """As pysoem's `CdefSlave.sdo_write`."""
        self.objects[index, subindex] = payload

    def exchange(self) -> dict[int, bytes]:
        """One cycle of the slave: outputs taken, inputs given, by number of the PDO."""
        for number, payload in self.outputs.items():
            at = 0
            for place, length in self._mapping(0x1600 + number - 1):
                self.objects[place] = payload[at : at + length]
                at += length
        self._step()
        return {
            number: b"".join(self.objects[place] for place, _ in self._mapping(0x1A00 + number - 1))
            for number in range(1, 5)
            if self.objects.get((0x1A00 + number - 1, 0), b"\x00") != b"\x00"
        }

    def _mapping(self, index: int) -> list[tuple[tuple[int, int], int]]:
        count = self.objects.get((index, 0), b"\x00")[0]
        words = [int.from_bytes(self.objects[index, at], "little") for at in range(1, count + 1)]
        return [((word >> 16, word >> 8 & 0xFF), (word & 0xFF) // 8) for word in words]

    def _step(self) -> None:
        (command,) = struct.unpack("<H", self.objects.get((0x6040, 0), b"\x00\x00"))
        if not command & 2:
            self.word = DISABLED
        elif self.word == DISABLED and command & 7 == 6:
            self.word = READY
        elif self.word == READY and command & 7 == 7:
            self.word = SWITCHED_ON
        elif self.word == SWITCHED_ON and command & 0xF == 0xF:
            self.word = ENABLED
        elif self.word == ENABLED:
            (self.position,) = struct.unpack("<i", self.objects[0x607A, 0])
        self.objects[0x6041, 0] = struct.pack("<H", self.word)
        self.objects[0x6061, 0] = self.objects.get((0x6060, 0), b"\x00")
        self.objects[0x6064, 0] = struct.pack("<i", self.position)
        self.objects[0x6077, 0] = b"\x00\x00"


class FakeCoePort:
    """What a port on pysoem would be: outputs are copied, the frame for SYNC is the datagram of the cycle."""

    payload_offset = HEADER.size

    def __init__(self, slaves: dict[int, CoeSlave]) -> None:
        self.counters = PortCounters()
        self.slaves = slaves
        self.working = True
        self._inputs: list[Frame] = []

    def fileno(self) -> int:
        return -1

    def prepare(self, identifier: int, length: int) -> bytearray:
        return bytearray(HEADER.pack(identifier) + bytes(length))

    def send(self, identifier: int, payload: bytes) -> bool:
        return self.send_prepared(bytearray(HEADER.pack(identifier) + payload))

    def send_prepared(self, buffer: bytearray) -> bool:
        (identifier,) = HEADER.unpack_from(buffer)
        if identifier == SYNC:
            self._send_processdata()
            return True
        number = (identifier - Function.RPDO1) // 0x100 + 1
        self.slaves[identifier & 0x7F].outputs[number] = bytes(buffer[HEADER.size :])
        return True

    def drain(self) -> list[Frame]:
        inputs, self._inputs = self._inputs, []
        return inputs

    def close(self) -> None:
        """Nothing is open."""

    def _send_processdata(self) -> None:
        for node, slave in self.slaves.items():
            if self.working:
                for number, payload in slave.exchange().items():
                    self._inputs.append((Function.TPDO1 + 0x100 * (number - 1) + node, payload))


@pytest.fixture
def cell() -> tuple[CanBus, FakeCoePort, Setpoints]:
    described = machine(2)
    slaves = {1: CoeSlave(1000), 2: CoeSlave(-2000)}
    for settings in settings_of(described):
        dictionary = generic_dictionary(settings.node)
        for write in configuration_writes(settings, described.cycle_s, dictionary, 127):
            slaves[settings.node].sdo_write(write.index, write.subindex, write.payload)
    port = FakeCoePort(slaves)
    bus = CanBus(described, described.buses[0], [0, 1], opener=lambda _address: port, wait=lambda _s: None)
    setpoints = Setpoints.of(2)
    setpoints.position[:] = bus.boot().position
    return bus, port, setpoints


def test_axes_on_coe_are_captured_without_a_jump_and_moved(
    cell: tuple[CanBus, FakeCoePort, Setpoints],
) -> None:
    bus, port, setpoints = cell
    setpoints.mode[:] = DriveMode.POSITION
    for _ in range(20):
        feedback = bus.exchange(setpoints)
    assert set(feedback.state.tolist()) == {DriveState.ENERGIZED}
    assert [slave.position for slave in port.slaves.values()] == [1000, -2000]
    setpoints.position[:] += 0.001
    for _ in range(4):
        bus.exchange(setpoints)
    assert [slave.position for slave in port.slaves.values()] == [2000, -1000]


def test_a_working_counter_that_is_wrong_is_a_lost_axis_as_on_can(
    cell: tuple[CanBus, FakeCoePort, Setpoints],
) -> None:
    bus, port, setpoints = cell
    setpoints.mode[:] = DriveMode.POSITION
    for _ in range(20):
        bus.exchange(setpoints)
    port.working = False
    for _ in range(4):
        feedback = bus.exchange(setpoints)
    assert set(feedback.fault.tolist()) == {DriveFault.COMMUNICATION}
