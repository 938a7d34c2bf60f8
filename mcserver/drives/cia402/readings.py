"""What the TPDOs of the CiA 402 axes of one bus have brought: positions, velocities, ages, digital inputs."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mcserver.can.pdo_layout import TPDO1
from mcserver.drives.bus import Array, Feedback
from mcserver.drives.cia402.frames import AxisFrames, IncomingPdo
from mcserver.drives.cia402.scaling import PositionTracker, Scaling
from mcserver.machine.axis import Axis

# Cycles over which a velocity is taken from positions.
VELOCITY_CYCLES = 4
_PERMILLE = struct.Struct("<h")
_INPUTS = struct.Struct("<i")
# When a reading is taken as it is, after its drive was switched on.
_DONE, _NOW, _NEXT_CYCLE = range(3)
# An age beyond every limit.
_NEVER = 1 << 30
_TPDO1 = np.dtype([("state", "<u2"), ("mode", "i1"), ("position", "<i4")])


class AxisReadings:
    """The latest readings of n axes.

    Args:
        local: where each is in the arrays of the bus; where: the same as an index. zero: position where the
            encoder's count is 0 [m, rad].

    Attributes:
        came: a flag an axis: its TPDO1 came since `begin`; all_came: all flags set. ages: shape (n,), cycles
            since the latest one. silent_for: the greatest of them.
        status, shown, counts: shape (n,): statusword, mode and position as they came. position: [m, rad].
        moved: counts in `VELOCITY_CYCLES`. short: TPDOs that came with a wrong length.
        input_ages: cycles since 60FDh came, by axis, where it is mapped.
    """

    def __init__(
        self,
        axes: Sequence[Axis],
        local: Sequence[int],
        where: slice | NDArray[np.intp],
        frames: Sequence[AxisFrames],
        scales: Sequence[Scaling],
        zero: Array,
        cycle_s: float,
    ) -> None:
        count = len(axes)
        self._local, self._where, self._frames = tuple(local), where, tuple(frames)
        self._si_per_count: Array = 1.0 / np.array([scale.counts_per_si for scale in scales])
        self._nm_per_permille = [
            1.0 / scale.permille_per_nm if scale.permille_per_nm else 0.0 for scale in scales
        ]
        self._zero = zero
        self._cycle = cycle_s
        self._number = 0
        self._answers = [0] * count
        self._wrong_lengths: dict[int, int] = {}
        self.ages = np.zeros(count, np.int64)
        self.silent_for = 0
        self.short = 0
        self.came = bytearray(count)
        self.all_came = bytes([1]) * count
        self._none_came = bytes(count)
        self._fresh: NDArray[np.bool_] = np.frombuffer(self.came, np.bool_)
        self._arena = bytearray(TPDO1.packing.size * count)
        incoming: Any = np.frombuffer(self._arena, _TPDO1)
        self.status, self.shown, self.counts = incoming["state"], incoming["mode"], incoming["position"]
        self.input_ages = {
            index: _NEVER
            for index, each in enumerate(frames)
            if any(pdo.inputs_at is not None for pdo in each.tpdos)
        }
        self._tracker = PositionTracker(count)
        self._restart = [_NOW] * count
        self._any_restart = True
        self.moved = np.zeros(count, np.int64)
        self._past = np.zeros((VELOCITY_CYCLES, count), np.int64)
        self.position: Array = np.zeros(count)

    def handlers(self, feedback: Feedback) -> dict[int, Callable[[bytes], None]]:
        """Return what to call for which COB-ID."""
        handlers = {}
        for index, frames in enumerate(self._frames):
            essential = sum(1 << bit for bit, pdo in enumerate(frames.tpdos) if pdo.essential)
            for bit, pdo in enumerate(frames.tpdos):
                handlers[pdo.cob_id] = self._taker(index, pdo, bit, essential, feedback)
        return handlers

    def _taker(
        self, index: int, pdo: IncomingPdo, bit: int, essential: int, feedback: Feedback
    ) -> Callable[[bytes], None]:
        start = index * TPDO1.packing.size
        pieces = [
            (
                slice(start + piece.first, start + piece.first + piece.length),
                piece.at,
                piece.at + piece.length,
            )
            for piece in pdo.pieces
        ]

        def take(payload: bytes) -> None:
            if len(payload) != pdo.length:
                # process data of another length than was mapped count as not come
                self.short += 1
                self._wrong_lengths[index] = len(payload)
                return
            for where, first, end in pieces:
                self._arena[where] = payload[first:end]
            if pdo.torque_at is not None:
                (torque,) = _PERMILLE.unpack_from(payload, pdo.torque_at)
                feedback.torque[self._local[index]] = torque * self._nm_per_permille[index]
            if pdo.inputs_at is not None:
                (feedback.inputs[self._local[index]],) = _INPUTS.unpack_from(payload, pdo.inputs_at)
                self.input_ages[index] = 0
            if pdo.essential:
                # an axis has answered once all of it has come
                self._answers[index] |= 1 << bit
                if self._answers[index] & essential == essential:
                    self._answers[index] = 0
                    self.came[index] = 1

        return take

    def silence_detail(self, index: int, age: int) -> int:
        """Why an axis does not answer: cycles, or below 0 the length of process data that were not taken."""
        length = self._wrong_lengths.pop(index, None)
        return age if length is None else -length - 1

    def begin(self) -> None:
        """Begin a cycle, in which nothing has come yet."""
        self.came[:] = self._none_came
        self._number += 1
        for index in self.input_ages:
            self.input_ages[index] += 1

    def answered(self) -> list[int]:
        """Whose TPDO1 has come since `begin`, as indices of the bus."""
        return [self._local[index] for index, flag in enumerate(self.came) if flag]

    def begin_here(self) -> None:
        """Take the latest reading of every axis as it is: all of them have answered once."""
        for index, position in enumerate(self.counts.tolist()):
            self._tracker.restart(index, position)
        self._past[:] = self._tracker.counts
        self._restart = [_DONE] * len(self.came)
        self._any_restart = False

    def restart(self, index: int) -> None:
        """The drive has been switched on again: its next reading is taken as it is."""
        self._restart[index] = _NEXT_CYCLE
        self._any_restart = True

    def read(self, feedback: Feedback) -> None:
        """Positions, velocities and ages from the TPDOs that came."""
        came = self.came
        whole = came == self.all_came
        if not whole:
            self.ages += 1
            self.ages[self._fresh] = 0
            self.silent_for = int(self.ages.max())
        elif self.silent_for:
            self.ages[:] = 0
            self.silent_for = 0
        tracker = self._tracker
        if self._any_restart:
            self._restart_tracked()
        tracker.follow(self.counts)
        row = self._past[self._number % VELOCITY_CYCLES]
        np.multiply(tracker.counts, self._si_per_count, out=self.position)
        self.position += self._zero
        moved = tracker.counts - row
        row[:] = tracker.counts
        self.moved = moved
        local = self._where
        feedback.position[local] = self.position
        feedback.velocity[local] = moved * (self._si_per_count / (VELOCITY_CYCLES * self._cycle))
        feedback.fresh[local] = True if whole else self._fresh

    def _restart_tracked(self) -> None:
        for index, wanted in enumerate(self._restart):
            if wanted == _NEXT_CYCLE:
                # what came together with the boot-up is of the time before
                self._restart[index] = _NOW
            elif wanted == _NOW and self.came[index]:
                self._restart[index] = _DONE
                self._tracker.restart(index, int(self.counts[index]))
                self._past[:, index] = self._tracker.counts[index]
        self._any_restart = any(self._restart)
