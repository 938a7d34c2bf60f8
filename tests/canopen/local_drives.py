"""Slaves that are not ours: python-canopen's LocalNode over an EDS, with a power state machine of its own."""

from __future__ import annotations

import io
import math
import select
import struct
import threading
import time
from collections.abc import Callable, Sequence

import canopen
from canopen.objectdictionary import ObjectDictionary, import_od

from mcserver.can.open import open_port
from tests.canopen.rig import RunningHub

DISABLED, READY, SWITCHED_ON, ENABLED, FAULT = 0x40, 0x21, 0x23, 0x27, 0x08


def dictionary_of(text: str, node: int) -> ObjectDictionary:
    """As python-canopen itself reads an EDS."""
    file = io.StringIO(text)
    file.name = "drive.eds"
    return import_od(file, node)


class HubNetwork(canopen.Network):
    """python-canopen's network on a hub, with a thread that hands over what comes."""

    def __init__(self, address: str) -> None:
        super().__init__()
        self._port = open_port(address)
        self._sending = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="local drive", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        self._stopping.set()
        self._thread.join(5.0)
        self._port.close()

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        assert not remote
        with self._sending:
            self._port.send(can_id, bytes(data))

    def send_periodic(self, can_id: int, data: bytes, period: float, remote: bool = False) -> PeriodicFrame:  # type: ignore[override]
        assert not remote
        return PeriodicFrame(self, can_id, bytes(data), period)

    def _run(self) -> None:
        while not self._stopping.is_set():
            descriptor = self._port.fileno()
            if descriptor < 0:
                # the hub of the test is gone
                return
            select.select([descriptor], [], [], 0.01)
            with self._sending:
                frames = self._port.drain()
            for identifier, payload in frames:
                self.notify(identifier, bytearray(payload), time.monotonic())


class PeriodicFrame:
    """What python-canopen's heartbeat producer sends again and again."""

    def __init__(self, network: HubNetwork, can_id: int, payload: bytes, period: float) -> None:
        self._network, self._can_id, self._payload, self._period = network, can_id, payload, period
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="local heartbeat", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._stopping.set()

    def update(self, payload: bytes) -> None:
        self._payload = bytes(payload)

    def _run(self) -> None:
        while not self._stopping.wait(self._period):
            self._network.send_message(self._can_id, self._payload)


class LocalDrive:
    """One LocalNode that acts on SYNC: it applies what RPDOs have brought, moves, and sends its TPDOs.

    Attributes:
        position: of each axis of the node, in counts. word: state bits of each axis's statusword.
        moves: follow targets. written: (index, subindex, bytes) in order.
    """

    def __init__(self, hub: RunningHub, text: str, node: int, positions: Sequence[int] = (0,)) -> None:
        self.number = node
        self.written: list[tuple[int, int, bytes]] = []
        self.position = list(positions)
        self.begins = tuple(positions)
        self.word = [DISABLED] * len(positions)
        self.bits = [0] * len(positions)
        self.home = 0
        self.home_cycles = 0
        self.moves = True
        # profile position
        self.setpoints: list[int] = []
        self.speeds: list[int] = []
        self.acknowledges, self.acknowledged = True, False
        self.last_command, self.pace = 0, 500
        # torque mode: what acts since the latest SYNC [‰], and the shaft that it turns [rad/s, turns]
        self.torques: list[int] = []
        self.rate, self.turns = 0.0, 0.0
        self.answered = 0
        self.targets: list[list[int]] = [[] for _ in positions]
        self.answers: Callable[[int, int], None] = lambda _index, _subindex: None
        self.network = HubNetwork(hub.address())
        self.local = self.network.create_node(node, dictionary_of(text, node))
        self.local.add_write_callback(self._on_write)
        self.local.add_read_callback(self._on_read)
        self.network.subscribe(0x80, self._on_sync)
        self.values: dict[tuple[int, int], bytes] = {}
        self._lock = threading.Lock()

    def start(self) -> LocalDrive:
        """Power comes: the boot-up message."""
        self.network.start()
        self.local.nmt.state = "INITIALISING"
        self.local.nmt.state = "PRE-OPERATIONAL"
        return self

    def close(self) -> None:
        self.local.nmt.stop_heartbeat()
        self.network.close()

    def value(self, index: int, subindex: int = 0) -> int:
        return int.from_bytes(self.local.get_data(index, subindex), "little")

    def emergency(self, code: int, cob: int | None = None) -> None:
        cob = self.value(0x1014) if cob is None else cob
        self.network.send_message(cob & 0x7FF, struct.pack("<HB5x", code, 1))

    # ------------------------------------------------------------ the node

    def _on_write(self, index: int, subindex: int, od: object, data: bytes) -> None:  # noqa: ARG002
        self.answers(index, subindex)
        self.written.append((index, subindex, bytes(data)))

    def _on_read(self, index: int, subindex: int, od: object) -> int | None:  # noqa: ARG002
        return None

    def _on_sync(self, _identifier: int, _payload: bytes, _at: float) -> None:
        if self.local.nmt.state != "OPERATIONAL":
            return
        with self._lock:
            for axis in range(len(self.position)):
                self._step(axis)
            self._send_tpdos()
            self.answered += 1

    def on_rpdo(self, identifier: int, payload: bytes, _at: float) -> None:
        """A frame of the master: its objects by the mapping as it stands."""
        if self.local.nmt.state != "OPERATIONAL":
            return
        record = self._records(0x1400)
        for number in record:
            if self.value(0x1400 + number, 1) & 0x8000_07FF == identifier:
                at = 0
                for word in self._mapping(0x1600 + number):
                    length = (word & 0xFF) // 8
                    index, subindex = word >> 16, word >> 8 & 0xFF
                    self.local.data_store.setdefault(index, {})[subindex] = bytes(payload[at : at + length])
                    at += length

    def listen(self) -> None:
        """Take the RPDOs as they are configured now."""
        for number in self._records(0x1400):
            self.network.subscribe(self.value(0x1400 + number, 1) & 0x7FF, self.on_rpdo)

    def _records(self, first: int) -> list[int]:
        return [n for n in (0, 1, 2, 3, 64, 65, 66, 67) if first + n in self.local.object_dictionary]

    def _mapping(self, index: int) -> list[int]:
        return [self.value(index, at) for at in range(1, self.value(index, 0) + 1)]

    def _send_tpdos(self) -> None:
        for number in self._records(0x1800):
            cob = self.value(0x1800 + number, 1)
            if cob & 0x8000_0000:
                continue
            payload = b"".join(
                self.local.get_data(word >> 16, word >> 8 & 0xFF) for word in self._mapping(0x1A00 + number)
            )
            self.network.send_message(cob & 0x7FF, payload)

    def _step(self, axis: int) -> None:
        offset = 0x800 * axis
        command = self.value(0x6040 + offset)
        word = self.word[axis]
        if not command & 2:
            word = DISABLED
        elif word == DISABLED and command & 7 == 6:
            word = READY
        elif word == READY and command & 0xF in (7, 0xF):
            word = SWITCHED_ON
        elif word == SWITCHED_ON and command & 0xF == 0xF:
            word = ENABLED
        elif word == ENABLED and command & 0xF == 7:
            word = SWITCHED_ON
        elif word != DISABLED and command & 7 == 6:
            word = READY
        self.word[axis] = word
        mode = struct.unpack("<b", self.local.get_data(0x6060 + offset, 0))[0]
        bits = 0
        if word == ENABLED and mode == 6 and command & 0x10:
            self.home_cycles += 1
            self.position[axis] += 1
            if self.home_cycles > 10:
                self.position[axis] = struct.unpack("<i", self.local.get_data(0x607C + offset, 0))[0]
                bits = 0x1400
        elif word == ENABLED and self.moves and mode in (7, 8):
            index, subindex = (0x60C1, 1) if mode == 7 else (0x607A, 0)
            if mode == 8 or command & 0x10:
                target = struct.unpack("<i", self.local.get_data(index + offset, subindex))[0]
                self.targets[axis].append(target)
                self.position[axis] = target
        elif mode == 10:
            self._turn(axis, self._signed16(0x6071 + offset) if word == ENABLED else 0)
        elif mode == 1:
            bits = self._profile_position(axis, command, word == ENABLED)
        store = self.local.data_store
        store.setdefault(0x6041 + offset, {})[0] = struct.pack("<H", word | 0x200 | bits)
        store.setdefault(0x6061 + offset, {})[0] = struct.pack("<b", mode)
        store.setdefault(0x6064 + offset, {})[0] = struct.pack("<i", self.position[axis])

    def _profile_position(self, axis: int, command: int, enabled: bool) -> int:
        """Take set-points at the rising edge of bit 4, acknowledge them, and go there unless halted."""
        edge = enabled and command & 0x10 and not self.last_command & 0x10
        self.last_command = command
        if edge and self.acknowledges:
            self.acknowledged = True
            self.setpoints.append(self._signed(0x607A))
            self.speeds.append(self.value(0x6081))
        if not command & 0x10:
            self.acknowledged = False
        if enabled and self.setpoints and not command & 0x100:
            away = self.setpoints[-1] - self.position[axis]
            self.position[axis] += max(-self.pace, min(self.pace, away))
        reached = bool(self.setpoints) and self.position[axis] == self.setpoints[-1]
        return 0x1000 * self.acknowledged | 0x400 * reached

    def _turn(self, axis: int, permille: int, cycle_s: float = 0.01) -> None:
        """What came before this SYNC acts from it on: 1 N·m of rated torque on 10⁻³ kg·m², 4096 counts."""
        before = self.rate
        self.rate += (self.torques[-1] if self.torques else 0) * cycle_s
        self.turns += 0.5 * (before + self.rate) * cycle_s / (2.0 * math.pi)
        self.torques.append(permille)
        self.position[axis] = self.begins[axis] + round(self.turns * 4096)

    def _signed16(self, index: int) -> int:
        value: int = struct.unpack("<h", self.local.get_data(index, 0))[0]
        return value

    def _signed(self, index: int) -> int:
        value: int = struct.unpack("<i", self.local.get_data(index, 0))[0]
        return value


def until(holds: Callable[[], bool], what: str, limit_s: float = 10.0) -> None:
    """Wait for what another thread brings about."""
    pause = threading.Event()
    deadline = time.monotonic() + limit_s
    while not holds():
        assert time.monotonic() < deadline, f"not within {limit_s:g} s: {what}"
        # the cycle of these machines: what is judged by cycles is not judged sooner than on a real bus
        pause.wait(0.01)
