"""The RPDOs of all CiA 402 axes of one bus: what they hold, and which of them go out in a cycle.

Payloads lie in arenas, 7 bytes an axis for RPDO1, 8 for RPDO2 and 2 for torque offsets, which NumPy writes as
columns; what is per frame is one copy.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.can.pdo_layout import RPDO1, RPDO2, Mode
from mcserver.can.port import CanPort
from mcserver.drives.bus import DriveMode
from mcserver.drives.cia402.frames import AxisFrames, OutgoingPdo
from mcserver.drives.cia402.power_stage import PowerStage

_RPDO1 = np.dtype([("controlword", "<u2"), ("mode", "i1"), ("position", "<i4")])
_RPDO2 = np.dtype([("controlword", "<u2"), ("velocity", "<i4"), ("torque", "<i2")])

# 60B2h and 60FEh:01, which are not among the usual objects
_OFFSET_BYTES, _OUTPUT_BYTES = 2, 4

# pieces of the arenas with their places in the buffer, and the prepared buffer
_Send = tuple[tuple[tuple[memoryview, slice], ...], bytearray]
# bit 4 of the controlword: interpolation on (mode 7), homing starts (mode 6)
_START = 0x0010
_WITH_START = (Mode.INTERPOLATED_POSITION, Mode.HOMING)
_BY_SPEED = (Mode.CYCLIC_VELOCITY, Mode.CYCLIC_TORQUE)


class Rpdos:
    """Columns of n axes, and their frames.

    Args:
        frames: of each axis. refresh: RPDO1 goes out once in so many cycles where speeds are commanded.

    Attributes:
        target, speed, torque, torque_offset, outputs: shape (n,), of 607Ah, 60FFh, 6071h, 60B2h and 60FEh:01.
        needs_speed: a frame with speeds or torques goes out.
    """

    def __init__(self, frames: Sequence[AxisFrames], refresh: int) -> None:
        count = len(frames)
        self._frames, self._refresh = tuple(frames), refresh
        sizes = (RPDO1.packing.size, RPDO2.packing.size, _OFFSET_BYTES, _OUTPUT_BYTES)
        self._arenas = {number: (bytearray(size * count), size) for number, size in enumerate(sizes, 1)}
        first: Any = np.frombuffer(self._arenas[1][0], _RPDO1)
        second: Any = np.frombuffer(self._arenas[2][0], _RPDO2)
        self._controlwords = (first["controlword"], second["controlword"])
        self._mode = first["mode"]
        self.target, self.speed, self.torque = first["position"], second["velocity"], second["torque"]
        self.torque_offset: NDArray[np.int16] = np.frombuffer(self._arenas[3][0], "<i2")
        self.outputs: NDArray[np.uint32] = np.frombuffer(self._arenas[4][0], "<u4")
        self._sends: list[list[_Send]] = [[] for _ in range(refresh)]
        self._number = 0
        self.needs_speed = False

    def open(self, port: CanPort) -> None:
        """Prepare the frames."""
        self._outgoing = [
            [
                (pdo, self._pieces(index, pdo, port.payload_offset), port.prepare(pdo.cob_id, pdo.length))
                for pdo in frames.rpdos
            ]
            for index, frames in enumerate(self._frames)
        ]
        self._send = port.send_prepared

    def _pieces(self, index: int, pdo: OutgoingPdo, offset: int) -> tuple[tuple[memoryview, slice], ...]:
        pieces = []
        for piece in pdo.pieces:
            arena, size = self._arenas[piece.arena]
            where = slice(offset + piece.at, offset + piece.at + piece.length)
            pieces.append((memoryview(arena)[index * size + piece.first :][: piece.length], where))
        return tuple(pieces)

    def set_controlword(self, index: int, word: int) -> None:
        """Set 6040h of an axis in both PDOs that have it."""
        for column in self._controlwords:
            column[index] = word

    def command(self, stages: Iterable[PowerStage]) -> None:
        """Take controlwords and modes of the power stages, and plan which frames go out."""
        for index, stage in enumerate(stages):
            word = stage.controlword
            if stage.running and stage.mode in _WITH_START and stage.started:
                word |= _START
            self.set_controlword(index, word)
            self._mode[index] = stage.mode
        self.plan(stages)

    def next_cycle(self) -> None:
        """Begin a cycle."""
        self._number += 1

    def plan(self, stages: Iterable[PowerStage]) -> None:
        """Plan which frames go out, by cycle: RPDO1 in position mode, else RPDO2 and now and then RPDO1."""
        sends: list[list[_Send]] = [[] for _ in range(self._refresh)]
        self.needs_speed = False
        for index, stage in enumerate(stages):
            if stage.commanded is DriveMode.SILENT:
                continue
            by_speed = stage.commanded >= DriveMode.POSITION and stage.mode in _BY_SPEED
            both = stage.changing or (by_speed and stage.capturing)
            for number, frames in enumerate(sends):
                positions = not by_speed or both or number == index % self._refresh
                for pdo, pieces, buffer in self._outgoing[index]:
                    if (pdo.by_position and positions) or (pdo.by_speed and (by_speed or both)):
                        frames.append((pieces, buffer))
            self.needs_speed = self.needs_speed or by_speed or both
        self._sends = sends

    def send(self) -> int:
        """Send the RPDOs of this cycle; returns how many found no room."""
        lost = 0
        send = self._send
        for pieces, buffer in self._sends[self._number % self._refresh]:
            for payload, where in pieces:
                buffer[where] = payload
            if not send(buffer):
                lost += 1
        return lost
