"""A line listened on beside its master, as a CAN port: the frame of a cycle stands for SYNC and all its PDOs.

The reading in the frame of a cycle was sampled before the frame came, by the setpoint of the cycle before.
So it belongs to the SYNC before, as a TPDO of CAN comes behind its SYNC. A cycle is given as the readings
that its frame brought back, the commands that it took along, and SYNC, once the next frame goes out.
"""

from __future__ import annotations

import socket
import struct
from collections.abc import Sequence

from mcserver.can.cob import SYNC
from mcserver.can.pdo import ProcessData
from mcserver.can.port import Frame, PortCounters
from mcserver.ethercat.slave import SLAVE_COUNT
from mcserver.ethercat.tap import ETHERTYPE, open_tap

# Process data by logical addresses: LRD, LWR, LRW; with LRW a slave counts both ways.
_LOGICAL_READ, _LOGICAL_WRITE, _LOGICAL_BOTH = 10, 11, 12
_DATAGRAM = struct.Struct("<BBIHH")
_BEGIN, _COUNTER_BYTES = 16, 2
_LENGTH, _MORE = 0x7FF, 0x8000
# On the wire besides what the socket shows: preamble, checksum and gap [bytes].
_AROUND = 24
LONGEST_FRAME = 1600
MAX_DRAINED = 512


class LineTap:
    """As `mcserver.can.port.ListeningPort`: only its master sends on a line.

    Args:
        interfaces: of the master; the first one is where its frames go out.
        slaves: process data of each drive, in the order of the line. They lie one behind the other in the
            frame, first all outputs, then all inputs.

    Attributes:
        bits: on the wire since it was opened, both ways counted once.

    Raises:
        RuntimeFault: MC424 an interface cannot be listened on.
    """

    def __init__(self, interfaces: Sequence[str], slaves: Sequence[ProcessData]) -> None:
        self.counters = PortCounters()
        self.bits = 0
        self._first = interfaces[0]
        self._interfaces = frozenset(interfaces)
        self._places: list[list[tuple[int, slice]]] = []
        at = 0
        for pdos in ([each.rpdos[0] for each in slaves], [each.tpdos[0] for each in slaves]):
            own = []
            for pdo in pdos:
                own.append((pdo.cob_id, slice(at, at + pdo.length)))
                at += pdo.length
            self._places.append(own)
        self._image = bytearray(at)
        self._expected = SLAVE_COUNT * len(slaves)
        self._commands: list[Frame] | None = None
        self._readings: list[Frame] = []
        self._socket = open_tap(interfaces)

    def fileno(self) -> int:
        return self._socket.fileno()

    def drain(self) -> list[Frame]:
        frames: list[Frame] = []
        for _ in range(MAX_DRAINED):
            try:
                frame, (interface, _, kind, *_) = self._socket.recvfrom(LONGEST_FRAME)
            except BlockingIOError:
                break
            except OSError:
                self.counters.errors += 1
                break
            if interface not in self._interfaces or frame[12:14] != ETHERTYPE.to_bytes(2, "big"):
                continue
            if kind != socket.PACKET_OUTGOING:
                self._come_back(frame)
            elif interface == self._first:
                frames += self._go_out(frame)
        return frames

    def close(self) -> None:
        self._socket.close()

    def _go_out(self, frame: bytes) -> list[Frame]:
        """Take a frame of the master; return the cycle before where it begins another one."""
        self.counters.sent += 1
        self.bits += 8 * (len(frame) + _AROUND)
        if self._logical(frame) is None:
            return []
        passed = [] if self._commands is None else [*self._readings, *self._commands, (SYNC, b"")]
        self._commands = [(cob_id, bytes(self._image[where])) for cob_id, where in self._places[0]]
        self._readings = []
        return passed

    def _come_back(self, frame: bytes) -> None:
        self.counters.received += 1
        counted = self._logical(frame)
        if counted is None:
            return
        if counted == self._expected:
            self._readings = [(cob_id, bytes(self._image[where])) for cob_id, where in self._places[1]]
        else:
            self.counters.malformed += 1

    def _logical(self, frame: bytes) -> int | None:
        """Copy process data into the image; return the working counter where they end it, None elsewhere."""
        at, more = _BEGIN, True
        while more and at + _DATAGRAM.size + _COUNTER_BYTES <= len(frame):
            command, _, address, length, _ = _DATAGRAM.unpack_from(frame, at)
            more, length = bool(length & _MORE), length & _LENGTH
            at += _DATAGRAM.size
            if command in (_LOGICAL_READ, _LOGICAL_WRITE, _LOGICAL_BOTH):
                end = address + length
                if end > len(self._image) or at + length + _COUNTER_BYTES > len(frame):
                    return None
                self._image[address:end] = frame[at : at + length]
                if end == len(self._image):
                    return int.from_bytes(frame[at + length :][:_COUNTER_BYTES], "little")
            at += length + _COUNTER_BYTES
        return None
