"""A simulated drive on a bench: a master's end of the bus, and a clock that only moves when it is stepped."""

from __future__ import annotations

import struct
from typing import Any

from mcserver.can.cob import NMT, SYNC, Function, NmtCommand
from mcserver.can.pdo_layout import RPDO1, RPDO2, TPDO1, TPDO2, Mode, Pdo
from mcserver.can.port import Frame
from mcserver.drive_sim.cia402_node import Cia402Node
from mcserver.drive_sim.described import Identity
from mcserver.drive_sim.motor import Hardware
from mcserver.drive_sim.pdo import INVALID

NODE = 5
PERIOD_S = 0.005
# Commands of the controlword (CiA 402-2, table 27).
DISABLE_VOLTAGE, SHUTDOWN, SWITCH_ON, ENABLE = 0x00, 0x06, 0x07, 0x0F
QUICK_STOP, FAULT_RESET, HALT = 0x02, 0x80, 0x10F
# State bits of the statusword.
STATE_MASK = 0x6F
SWITCH_ON_DISABLED, READY, SWITCHED_ON, ENABLED = 0x40, 0x21, 0x23, 0x27
QUICK_STOPPED, FAULT = 0x07, 0x08


class Aborted(Exception):
    """An SDO abort; `args` is the code."""


class Bench:
    """One node and everything that it has transmitted."""

    def __init__(self, position: float = 0.0, hardware: Hardware | None = None, **options: Any) -> None:
        self.now = 100.0
        self.sent: list[Frame] = []
        self.node = Cia402Node(NODE, self._take, hardware, position, Identity(), **options)
        self.controlword = 0
        self.target: int | None = None
        self.mode = Mode.CYCLIC_POSITION

    def _take(self, identifier: int, payload: bytes) -> None:
        self.sent.append((identifier, payload))

    # ------------------------------------------------------------------ time and frames

    def wait(self, time_s: float) -> None:
        """Lets time pass; the node is polled whenever it wants to be."""
        end = self.now + time_s
        while self.node.wake <= end:
            self.now = max(self.now, self.node.wake)
            self.node.poll(self.now)
        self.now = end

    def receive(self, identifier: int, payload: bytes = b"") -> None:
        self.node.receive(identifier, payload, self.now)
        if self.node.wake <= self.now:
            self.node.poll(self.now)

    def taken(self, identifier: int | None = None) -> list[bytes]:
        """What was sent with an identifier since it was asked last; None: forgets everything."""
        found = [payload for sent, payload in self.sent if sent == identifier]
        self.sent = [] if identifier is None else [frame for frame in self.sent if frame[0] != identifier]
        return found

    def boot(self) -> Bench:
        self.node.switch_on(self.now)
        self.wait(0.1)
        assert self.taken(Function.HEARTBEAT + NODE) == [b"\x00"]
        return self

    def nmt(self, command: NmtCommand, node: int = NODE) -> None:
        self.receive(NMT, bytes((command, node)))

    # ------------------------------------------------------------------ SDO

    def exchange(self, message: bytes) -> bytes:
        """One SDO message and its answer."""
        self.taken(Function.SDO_RESPONSE + NODE)
        self.receive(Function.SDO_REQUEST + NODE, message)
        (answer,) = self.taken(Function.SDO_RESPONSE + NODE)
        if answer[0] == 0x80:
            raise Aborted(struct.unpack("<I", answer[4:])[0])
        return answer

    def write(self, index: int, subindex: int, packing: str, value: int) -> None:
        raw = struct.pack(f"<{packing}", value)
        command = 0x23 | (4 - len(raw)) << 2
        answer = self.exchange(struct.pack("<BHB", command, index, subindex) + raw.ljust(4, b"\x00"))
        assert answer == struct.pack("<BHB", 0x60, index, subindex) + bytes(4)

    def read(self, index: int, subindex: int, packing: str) -> int:
        answer = self.exchange(struct.pack("<BHB4x", 0x40, index, subindex))
        size = struct.calcsize(f"<{packing}")
        assert answer[:4] == struct.pack("<BHB", 0x43 | (4 - size) << 2, index, subindex)
        value: int = struct.unpack(f"<{packing}", answer[4 : 4 + size])[0]
        return value

    # ------------------------------------------------------------------ process data

    def map_pdo(self, pdo: Pdo, communication: int, identifier: int) -> None:
        """Writes one PDO into the drive, as CiA 301 wants it done."""
        index = communication + pdo.number - 1
        self.write(index, 1, "I", identifier | INVALID)
        self.write(index + 0x200, 0, "B", 0)
        for subindex, entry in enumerate(pdo.objects, start=1):
            self.write(index + 0x200, subindex, "I", entry.word)
        self.write(index + 0x200, 0, "B", len(pdo.objects))
        self.write(index, 2, "B", pdo.transmission)
        self.write(index, 1, "I", identifier)

    def operate(self) -> Bench:
        """Boots, maps the PDOs of layout.py, and starts the node."""
        self.boot()
        for pdo in (RPDO1, RPDO2):
            self.map_pdo(pdo, 0x1400, Function.RPDO1 + 0x100 * (pdo.number - 1) + NODE)
        for pdo in (TPDO1, TPDO2):
            self.map_pdo(pdo, 0x1800, Function.TPDO1 + 0x100 * (pdo.number - 1) + NODE)
        self.write(0x60C2, 1, "B", round(PERIOD_S * 1e3))
        self.nmt(NmtCommand.START)
        self.taken()
        return self

    def cycle(self, controlword: int | None = None, target: int | None = None) -> tuple[int, int, int]:
        """One cycle of a master: RPDO1, SYNC; gives statusword, mode and position of TPDO1.

        Without a target the drive is commanded to stay where the last one was, at first where it is.
        """
        if controlword is not None:
            self.controlword = controlword
        if target is not None:
            self.target = target
        if self.target is None:
            self.target = self.read(0x6064, 0, "i")
        self.wait(PERIOD_S)
        payload = RPDO1.packing.pack(self.controlword, self.mode, self.target)
        self.receive(Function.RPDO1 + NODE, payload)
        self.receive(SYNC)
        (answer,) = self.taken(Function.TPDO1 + NODE)
        status: tuple[int, int, int] = TPDO1.packing.unpack(answer)
        return status

    def cycles(self, count: int, controlword: int | None = None, target: int | None = None) -> int:
        """So many cycles; the last statusword."""
        for _ in range(count):
            statusword, _, _ = self.cycle(controlword, target)
        return statusword

    def enable(self) -> Bench:
        """To operation enabled."""
        for controlword in (SHUTDOWN, SWITCH_ON, ENABLE):
            self.cycles(12, controlword)
        assert self.state == ENABLED
        return self

    @property
    def state(self) -> int:
        return self.read(0x6041, 0, "H") & STATE_MASK

    @property
    def position(self) -> int:
        return self.read(0x6064, 0, "i")

    def emergencies(self) -> list[int]:
        """Codes of the EMCY messages since the last call."""
        return [struct.unpack_from("<H", payload)[0] for payload in self.taken(Function.EMCY + NODE)]
