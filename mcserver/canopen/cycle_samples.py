"""What drives and their master exchange in each cycle, taken from the bus: one row of signals a SYNC.

A drive takes its RPDOs and samples its TPDOs at SYNC. So the row of SYNC k has the commands that came before
it and the readings that come after it, and the setpoint of SYNC k − 1 is where the reading of SYNC k should
be.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from mcserver.can.cob import SYNC
from mcserver.can.pdo import MappedPdo, ProcessData
from mcserver.canopen.configuration import of_first_axis
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.parameters import parameters_of
from mcserver.drives.cia402.scaling import Scaling
from mcserver.machine.axis import Axis

Array = NDArray[np.float64]

WRAP = 2.0**32
SETPOINTS = frozenset({(0x607A, 0), (0x60C1, 1)})
POSITION = (0x6064, 0)
_POSITIONS = SETPOINTS | {POSITION}
_VELOCITIES = frozenset({(0x60FF, 0), (0x606C, 0)})
_TORQUES = frozenset({(0x6071, 0), (0x6077, 0), (0x60B2, 0)})
_LETTERS = MappingProxyType({1: "b", 2: "h", 4: "i", 8: "q"})


@dataclass(frozen=True)
class Signal:
    """One mapped object of an axis.

    Attributes:
        place: index and subindex, of a further axis of a node as those of its first one.
        name: of the EDS. unit: of values; empty: as the drive has them. command: it goes to the drive.
        sources: (COB-ID, byte) where it is. every_cycle: it is due after each SYNC. packing: of its bytes.
        scale, zero: value = number · scale + zero.
    """

    axis: int
    place: tuple[int, int]
    name: str
    unit: str
    command: bool
    sources: tuple[tuple[int, int], ...]
    packing: struct.Struct
    every_cycle: bool = False
    scale: float = 1.0
    zero: float = 0.0

    def values(self, numbers: Array) -> Array:
        """Values of the drive's numbers, shape as given; positions go on past the wrap of 32 bits."""
        known = np.isfinite(numbers)
        if self.place in _POSITIONS and known.any():
            numbers = numbers.copy()
            numbers[known] = np.unwrap(numbers[known], period=WRAP)
        return numbers * self.scale + self.zero


def signals_of(
    axis: Axis, data: ProcessData, dictionary: DeviceDictionary, node_axis: int = 0
) -> list[Signal]:
    """Return every whole-byte object that is mapped for an axis, commands first, each once.

    Args:
        axis: of the machine, with its drive's section filled in. data: as planned for the drive.
    """
    known = {each.place: each for each in parameters_of(dictionary, node_axis)}
    found: list[Signal] = []
    for command, pdos in ((True, data.rpdos), (False, data.tpdos)):
        places: dict[tuple[int, int], list[tuple[int, int]]] = {}
        sizes: dict[tuple[int, int], int] = {}
        due: dict[tuple[int, int], bool] = {}
        for pdo in pdos:
            for place, size, at in _bytes_of(pdo):
                places.setdefault(place, []).append((pdo.cob_id, at))
                sizes[place] = size
                due[place] = not command and pdo.transmission == 1
        for place, sources in places.items():
            parameter = known.get(place)
            if parameter is None:
                continue
            kind = parameter.type
            letter = "f" if kind == "f32" else _LETTERS[sizes[place]]
            packing = struct.Struct("<" + (letter if kind[0] in "if" else letter.upper()))
            own = (of_first_axis(place[0]), place[1])
            scale, zero, unit = _scale(axis, own)
            where = (tuple(sources), packing, due[place])
            found.append(Signal(axis.index, own, parameter.name, unit, command, *where, scale, zero))
    return found


def _bytes_of(pdo: MappedPdo) -> Iterator[tuple[tuple[int, int], int, int]]:
    """Place, length and first byte of a PDO's objects that lie on whole bytes, but for dummies."""
    bits = 0
    for mapped in pdo.objects:
        if mapped.index >= 0x1000 and bits % 8 == 0 and mapped.bits in (8, 16, 32, 64):
            yield (mapped.index, mapped.subindex), mapped.bits // 8, bits // 8
        bits += mapped.bits


def _scale(axis: Axis, place: tuple[int, int]) -> tuple[float, float, str]:
    """Factor, summand and unit of an object's values."""
    scale, unit = Scaling.of(axis), axis.type.unit
    if place in _POSITIONS:
        zero = getattr(axis.drive, "zero_offset", 0.0)
        return 1.0 / scale.counts_per_si / axis.type.si_per_unit, zero, unit
    if place == (0x60F4, 0):
        return 1.0 / scale.counts_per_si / axis.type.si_per_unit, 0.0, unit
    if place in _VELOCITIES:
        return 1.0 / scale.velocity_per_si / axis.type.si_per_unit, 0.0, f"{unit}/s"
    if place in _TORQUES:
        known = scale.permille_per_nm
        return (1.0 / known, 0.0, "N·m") if known else (1.0, 0.0, "‰")
    return 1.0, 0.0, ""


class CycleSampler:
    """Rows from frames. A command, or a slow reading, stays the newest one; before the first it is NaN.

    A reading that is due in every cycle and did not come in its own is NaN too: the one before it is of
    another position.

    Attributes:
        rows: that were finished.
    """

    def __init__(self, signals: Sequence[Signal]) -> None:
        self.rows = 0
        self._commands = [signal.command for signal in signals]
        self._due = [at for at, signal in enumerate(signals) if signal.every_cycle]
        self._latest = [math.nan] * len(signals)
        self._held: list[float] | None = None
        self._sources: dict[int, list[tuple[int, struct.Struct, int]]] = {}
        for column, signal in enumerate(signals):
            for cob_id, at in signal.sources:
                self._sources.setdefault(cob_id, []).append((column, signal.packing, at))

    def take(self, identifier: int, payload: bytes) -> list[float] | None:
        """Take a frame; at a SYNC return the row of the SYNC before, None at all others."""
        if identifier == SYNC:
            held, self._held = self._held, list(self._latest)
            latest = list(self._latest)
            for column in self._due:
                self._latest[column] = math.nan
            if held is None:
                return None
            self.rows += 1
            return [
                before if command else now
                for command, before, now in zip(self._commands, held, latest, strict=True)
            ]
        for column, packing, at in self._sources.get(identifier, ()):
            if len(payload) >= at + packing.size:
                self._latest[column] = float(packing.unpack_from(payload, at)[0])
        return None


def following_error(rows: Array, signals: Sequence[Signal]) -> Array | None:
    """Setpoint of the cycle before less the reading, shape (n,) [mm or deg]; None without both on the bus.

    Args:
        rows: numbers of one axis's signals, shape (n, signals).
    """
    columns: Mapping[tuple[int, int], int] = {signal.place: at for at, signal in enumerate(signals)}
    setpoint = next((columns[place] for place in sorted(SETPOINTS) if place in columns), None)
    if setpoint is None or POSITION not in columns:
        return None
    reading = columns[POSITION]
    error = np.full(len(rows), math.nan)
    counts = rows[:-1, setpoint] - rows[1:, reading]
    error[1:] = (counts - WRAP * np.round(counts / WRAP)) * signals[reading].scale
    return error
