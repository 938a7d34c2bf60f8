"""The EtherCAT bus in the cycle: outputs are copied into the process image, and SYNC is its frame.

`mcserver.drives.can_bus.CanBus` exchanges with it as with a CAN port: COB-IDs stand for the PDOs of slaves.
The frame of a cycle is taken back at the beginning of the next one. Where it does not come back, or its
working counter is not that of the slaves in operation, no slave has answered, since nothing says which one
it was; `mcserver.ethercat.supervision` asks each of them then.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any

from mcserver.can.cob import SYNC, Function, NmtState
from mcserver.can.port import Frame, PortCounters
from mcserver.canopen.coe import ERROR_CODE
from mcserver.ethercat.slave import OUTPUT_COUNT, SLAVE_COUNT, AlState, EthercatSlave

HEADER = struct.Struct("<H")
# A frame that is still on its way is waited for at most so long [µs].
LATE_US = 200
_EMERGENCY = struct.Struct("<HB5x")
_NMT_OF = {
    AlState.OP: NmtState.OPERATIONAL,
    AlState.SAFEOP: NmtState.PRE_OPERATIONAL,
    AlState.PREOP: NmtState.PRE_OPERATIONAL,
    # only a slave that was switched off is in INIT
    AlState.INIT: NmtState.BOOT_UP,
}


class EthercatPort:
    """As `mcserver.can.port.CanPort`.

    Args:
        soem: pysoem's master. slaves: in SAFEOP. silence_cycles: so many frames in a row that do not come
            back are a bus that is away.
        patience_cycles: an axis whose outputs are not sent for so long gets zeros: no energy.
        on_close: called once. period_ns: of the cycle.

    Attributes:
        states: AL state of each slave; the supervision replaces the tuple. reported: those that the cycle
            has been given.
        clocked: a slave has a distributed clock, which the cycle has to follow.
        begun: setpoints are sent: before, nothing keeps a slave from falling out of OP again.
        troubled: called where an answer is missing.
    """

    payload_offset = HEADER.size

    def __init__(
        self,
        soem: Any,
        slaves: Sequence[EthercatSlave],
        *,
        silence_cycles: int,
        patience_cycles: int,
        on_close: Callable[[], None],
        period_ns: int,
    ) -> None:
        self.counters = PortCounters()
        self.states: tuple[AlState, ...] = (AlState.SAFEOP,) * len(slaves)
        self.begun = False
        self.clocked = False
        self.troubled: Callable[[], None] = lambda: None
        self._soem = soem
        self._on_close = on_close
        self._closed = False
        self._period_ns = period_ns
        self._silence = silence_cycles
        self._patience = patience_cycles
        self._devices = [slave.device for slave in slaves]
        self._outputs = {
            Function.RPDO1 + slave.settings.node: (number, slave.planned.rpdos[0].length)
            for number, slave in enumerate(slaves)
        }
        self._unsent = [0] * len(slaves)
        self._inputs = [
            (slave.device, Function.TPDO1 + slave.settings.node, Function.EMCY + slave.settings.node, at)
            for slave in slaves
            for at in (slave.planned.tpdos[0].offset(ERROR_CODE.index),)
        ]
        self._heartbeats = [Function.HEARTBEAT + slave.settings.node for slave in slaves]
        self._errors = [b"\x00\x00"] * len(slaves)
        self.reported: tuple[AlState, ...] = self.states
        self._under_way = False
        self._gone = 0

    def fileno(self) -> int:
        return -1

    def prepare(self, identifier: int, length: int) -> bytearray:
        return bytearray(HEADER.pack(identifier) + bytes(length))

    def send(self, identifier: int, payload: bytes) -> bool:
        return self.send_prepared(bytearray(HEADER.pack(identifier) + payload))

    def send_prepared(self, buffer: bytearray) -> bool:
        (identifier,) = HEADER.unpack_from(buffer)
        if identifier == SYNC:
            return self._send_frame()
        number, length = self._outputs[identifier]
        payload = bytes(buffer[HEADER.size :])
        if len(payload) == length:
            self._devices[number].output = payload
            self._unsent[number] = 0
            self.begun = True
        return True

    def drain(self) -> list[Frame]:
        if not self._under_way:
            return self._report_states([])
        self._under_way = False
        counted = self._soem.receive_processdata(LATE_US)
        states = self.states
        safe = states.count(AlState.SAFEOP)
        expected = SLAVE_COUNT * (safe + states.count(AlState.OP))
        if counted <= 0 and expected:
            self._gone += 1
            self.counters.down = self._gone >= self._silence
            self.troubled()
            return self._report_states([])
        self._gone = 0
        self.counters.down = False
        self.counters.received += 1
        # in SAFEOP some slaves take no outputs
        if counted != expected and counted != expected - OUTPUT_COUNT * safe:
            self.counters.malformed += 1
            self.troubled()
            return self._report_states([])
        frames: list[Frame] = []
        for number, (device, answer, emergency, at) in enumerate(self._inputs):
            if states[number] < AlState.SAFEOP:
                continue
            payload = device.input
            frames.append((answer, payload))
            if at is not None and payload[at : at + 2] != self._errors[number]:
                self._errors[number] = payload[at : at + 2]
                code = int.from_bytes(payload[at : at + 2], "little")
                frames.append((emergency, _EMERGENCY.pack(code, 1 if code else 0)))
        return self._report_states(frames)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._on_close()

    @property
    def clock_error_ns(self) -> int | None:
        """How far behind the whole cycles of the slaves' clock the latest frame passed; None: they have none.

        SYNC0 is half a cycle behind these, so that a frame may be late by nearly as much.
        """
        if not self.clocked:
            return None
        half = self._period_ns // 2
        return int((self._soem.dc_time + half) % self._period_ns - half)

    @property
    def flowing(self) -> bool:
        """Whether frames come back."""
        return self._gone == 0

    def _send_frame(self) -> bool:
        for number, age in enumerate(self._unsent):
            if age == self._patience:
                length = len(self._devices[number].output)
                self._devices[number].output = bytes(length)
            self._unsent[number] = age + 1
        self._under_way = self._soem.send_processdata() > 0
        if self._under_way:
            self.counters.sent += 1
        else:
            self.counters.unsent += 1
        return self._under_way

    def _report_states(self, frames: list[Frame]) -> list[Frame]:
        """What supervision has found goes along, as an NMT slave would say it."""
        states = self.states
        if states is not self.reported:
            for identifier, before, now in zip(self._heartbeats, self.reported, states, strict=True):
                if now is not before and now in _NMT_OF:
                    frames.append((identifier, bytes((_NMT_OF[now],))))
            self.reported = states
        return frames
