"""A CAN bus in memory and small drives on it, which act and answer as SYNC comes."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable

from mcserver.can.cob import SYNC, Function
from mcserver.can.frame import HEADER, PAYLOAD_OFFSET, prepare_frame
from mcserver.can.pdo_layout import RPDO1, RPDO2, SLOW_SYNCS, TPDO1, TPDO2, Mode
from mcserver.can.port import Frame, PortCounters

DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAULT = 0x40, 0x21, 0x23, 0x27, 0x07, 0x08
OPERATIONAL = bytes([5])


def wrap(count: int) -> int:
    """As a signed 32-bit number."""
    return (count + 2**31) % 2**32 - 2**31


class FakeBus:
    """The port of the master; what it sends reaches the nodes at once, what they send waits to be drained."""

    payload_offset = PAYLOAD_OFFSET

    def __init__(self) -> None:
        self.counters = PortCounters()
        self.nodes: list[FakeNode] = []
        self.waiting: deque[Frame] = deque()
        self.sent: list[Frame] = []
        self.full = False
        self.closed = False

    def fileno(self) -> int:
        return -1

    def prepare(self, identifier: int, length: int) -> bytearray:
        return prepare_frame(identifier, length)

    def send(self, identifier: int, payload: bytes) -> bool:
        if self.counters.down or self.full:
            self.counters.unsent += 1
            return False
        self.sent.append((identifier, payload))
        for node in self.nodes:
            node.receive(identifier, payload)
        return True

    def send_prepared(self, buffer: bytearray) -> bool:
        identifier, length = HEADER.unpack_from(buffer)
        return self.send(identifier, bytes(buffer[PAYLOAD_OFFSET : PAYLOAD_OFFSET + length]))

    def drain(self) -> list[Frame]:
        for node in self.nodes:
            node.tick()
        frames = [] if self.counters.down else list(self.waiting)
        self.waiting.clear()
        return frames

    def close(self) -> None:
        self.closed = True


class FakeNode:
    """Somebody on the bus."""

    def __init__(self, bus: FakeBus, node: int) -> None:
        self.bus = bus
        self.node = node
        bus.nodes.append(self)

    def receive(self, identifier: int, payload: bytes) -> None:
        raise NotImplementedError

    def tick(self) -> None:
        """A cycle passes for nodes that send by their own clocks."""

    def say(self, function: int, payload: bytes) -> None:
        self.bus.waiting.append((function + self.node, payload))


class FakeDrive(FakeNode):
    """A CiA 402 drive: its position follows CSP targets within one cycle, CSV speeds by their integral.

    Attributes:
        position: count at the latest SYNC. word: state bits of the statusword. jumps: distances between
            target and position at which it was enabled.
    """

    def __init__(self, bus: FakeBus, node: int, position: int = 0, cycle_s: float = 1e-3) -> None:
        super().__init__(bus, node)
        self.cycle_s = cycle_s
        self.position = position
        self.word = DISABLED
        self.mode = 0
        self.shown = 0
        self.controlword = 0
        self.target = 0
        self.speed = 0
        self.torque = 0
        self.exact = float(position)
        self.jumps: list[int] = []
        self.syncs = 0
        self.slowness = 0  # SYNCs that a transition between power states takes
        self.lost: set[int] = set()  # SYNCs whose TPDO1 gets lost
        self.mode_slowness = 0
        self.muted = self.short = self.stuck = self.jammed = self.booting = False
        self.beating = True
        self.late = 0
        self.pending: deque[tuple[int, bytes]] = deque()
        self.drift: Callable[[], int] = lambda: 0
        self._goal = self._pace = 0
        self._mode_wait = 0
        self._old_controlword = 0
        self._transition = 0
        self.shows_transitions = True  # else "not ready to switch on" while one takes place
        self.controlwords: list[int] = []

    # ------------------------------------------------------------------ the bus

    def receive(self, identifier: int, payload: bytes) -> None:
        if self.booting:
            return
        if identifier == Function.RPDO1 + self.node:
            controlword, self.mode, self.target = RPDO1.packing.unpack(payload)
            self._command(controlword)
        elif identifier == Function.RPDO2 + self.node:
            controlword, self.speed, self.torque = RPDO2.packing.unpack(payload)
            self._command(controlword)
        elif identifier == SYNC:
            self._sync()

    def _command(self, controlword: int) -> None:
        if not self.stuck:
            self.controlword = controlword
        if not self.controlwords or self.controlwords[-1] != controlword:
            self.controlwords.append(controlword)

    def _sync(self) -> None:
        self._move()
        if self.syncs % round(0.1 / self.cycle_s) == 0 and self.beating:
            self.say(Function.HEARTBEAT, OPERATIONAL)
        self._answer()
        # what came before this SYNC is acted on from it on
        self._goal, self._pace = self.target, self.speed
        self.syncs += 1
        self._step()

    def _answer(self) -> None:
        word = self.word if self.shows_transitions or not self._transition else 0
        payload = TPDO1.packing.pack(word | 0x0210, self.shown, wrap(self.position))
        if self.muted or self.syncs in self.lost:
            return
        if self.short:
            payload = payload[:4]
        self.pending.append((self.syncs + self.late, payload))
        while self.pending and self.pending[0][0] <= self.syncs:
            self.say(Function.TPDO1, self.pending.popleft()[1])
        if self.syncs % SLOW_SYNCS == 0:
            self.say(Function.TPDO2, TPDO2.packing.pack(0, 100))

    # ------------------------------------------------------------------ the drive

    def _move(self) -> None:
        if self.word == ENABLED and not self.jammed:
            if self.shown == Mode.CYCLIC_POSITION:
                # the nearest count that is the target modulo 2^32
                self.exact = float(self.position + wrap(self._goal - self.position))
            elif self.shown == Mode.CYCLIC_VELOCITY:
                self.exact += self._pace * self.cycle_s
        elif self.word != ENABLED:
            self.exact += self.drift()
        self.position = round(self.exact)

    def _step(self) -> None:
        """One transition of the power state machine, and of the mode, at most."""
        word, before = self.controlword, self._old_controlword
        self._old_controlword = word
        if self.stuck:
            return
        if self.mode != self.shown:
            self._mode_wait += 1
            if self._mode_wait > self.mode_slowness:
                self.shown, self._mode_wait = self.mode, 0
        after = self._next_word(word, before)
        if after != self.word:
            self._transition += 1
            if self._transition <= self.slowness:
                self._old_controlword = before if self.word == FAULT else word
                return
            if after == ENABLED:
                self.jumps.append(wrap(self.target - self.position))
        self._transition = 0
        self.word = after

    def _next_word(self, word: int, before: int) -> int:
        if self.word == FAULT:
            return DISABLED if word & 0x80 and not before & 0x80 else FAULT
        if not word & 0x02:
            return DISABLED
        if not word & 0x04:
            return DISABLED if self.word in (DISABLED, READY) else QUICK_STOP
        if self.word == DISABLED and word & 0x07 == 0x06:
            return READY
        if self.word == READY and word & 0x0F in (0x07, 0x0F):
            return SWITCHED_ON
        if self.word == SWITCHED_ON and word & 0x0F == 0x0F:
            return ENABLED
        if self.word in (SWITCHED_ON, ENABLED) and word & 0x07 == 0x06:
            return READY
        if self.word == ENABLED and word & 0x0F == 0x07:
            return SWITCHED_ON
        return self.word

    def trip(self, code: int) -> None:
        """A fault, with its emergency message."""
        self.word = FAULT
        self.emergency(code)

    def emergency(self, code: int) -> None:
        self.say(Function.EMCY, struct.pack("<HB5x", code, 1))

    def reboot(self) -> None:
        """Switched off and on: says so, and is silent until `operate`."""
        self.word, self.shown, self.booting = DISABLED, 0, True
        self.say(Function.HEARTBEAT, bytes([0]))

    def operate(self) -> None:
        """Somebody has configured and started the node again."""
        self.booting = False
        self.say(Function.HEARTBEAT, bytes([0x7F]))
        self.say(Function.HEARTBEAT, OPERATIONAL)


class FakeServosila(FakeNode):
    """A Servosila drive: streams telemetry by itself, follows Servo commands at once.

    Attributes:
        count: of the work zone. residue: what it shows after Reset. commands: (code, value) in order.
    """

    def __init__(self, bus: FakeBus, node: int, count: float = 0.0, every: int = 1) -> None:
        super().__init__(bus, node)
        self.count = count
        self.residue = 0.0
        self.every = every
        self.bits = 0
        self.hertz = 0.0
        self.muted = False
        self.commands: list[tuple[int, float]] = []
        self._ticks = 0

    def tick(self) -> None:
        if not self.muted and self._ticks % self.every == 0:
            self.say(Function.TPDO1, struct.pack("<HHf", self.bits, 0, self.hertz))
            self.say(Function.TPDO2, struct.pack("<ff", 0.0, self.count))
            self.say(Function.TPDO3, struct.pack("<ff", 1.0, 2.0))
        self._ticks += 1

    def receive(self, identifier: int, payload: bytes) -> None:
        if identifier != Function.RPDO1 + self.node:
            return
        code, value = payload[0], struct.unpack_from("<f", payload, 4)[0]
        self.commands.append((code, value))
        if code == 0x01:
            self.bits, self.count = 0, self.residue
        elif self.bits == 0 and code == 0x30:
            self.count = value
        self.hertz = value if code == 0x20 and self.bits == 0 else 0.0
