"""CANopen nodes with inputs and outputs (CiA 401), in the cycle of their bus.

The objects of a node are packed into its PDOs in the order of the machine file; `mcserver.canopen.io_nodes`
writes that mapping into the node. A node answers each SYNC with its TPDOs; its RPDOs act as they come.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mcserver.can.cob import Function, NmtState
from mcserver.can.pdo import MappedPdo
from mcserver.can.port import CanPort
from mcserver.machine.io_object import IoObject
from mcserver.machine.io_process_data import HEARTBEAT_MS, Key, io_process_data, nodes_on, own_objects
from mcserver.machine.machine_file import Machine

Array = NDArray[np.float64]

_FORMATS = {"u8": "B", "u16": "H", "u32": "I", "i8": "b", "i16": "h", "i32": "i", "f32": "f"}


class _Pdo:
    """One PDO: its payload and the objects in it."""

    def __init__(self, mapped: MappedPdo, types: dict[Key, str]) -> None:
        self.cob_id = mapped.cob_id
        self.keys = [(each.index, each.subindex) for each in mapped.objects]
        self.packing = struct.Struct("<" + "".join(_FORMATS[types[key]] for key in self.keys))


class IoNodes:
    """The nodes of one bus with inputs and outputs.

    Args:
        limit: cycles without an answer after which a node is lost.

    Attributes:
        inputs, outputs: columns of the machine's.
    """

    def __init__(self, machine: Machine, bus: str, cycle_s: float, limit: int) -> None:
        self.inputs = _columns([each.source for each in machine.inputs], bus)
        self.outputs = _columns([each.target for each in machine.outputs], bus)
        self._sources = [source for column in self.inputs if (source := machine.inputs[column].source)]
        self._targets = [target for column in self.outputs if (target := machine.outputs[column].target)]
        self.numbers = nodes_on(machine, bus)
        self._limit = max(limit, 1)
        # CiA 301 leaves the factor to the consumer
        self._beat_limit = max(self._limit, round(2.5 * HEARTBEAT_MS / 1e3 / cycle_s))
        sources = {node: own_objects(self._sources, bus, node) for node in self.numbers}
        targets = {node: own_objects(self._targets, bus, node) for node in self.numbers}
        self._tpdos: dict[int, list[_Pdo]] = {}
        self._rpdos: dict[int, list[_Pdo]] = {}
        for node in self.numbers:
            agreed = io_process_data(machine, bus, node)
            self._tpdos[node] = [_Pdo(pdo, sources[node]) for pdo in agreed.tpdos]
            self._rpdos[node] = [_Pdo(pdo, targets[node]) for pdo in agreed.rpdos]
        self._read: dict[tuple[int, Key], float] = {}
        self._written: dict[tuple[int, Key], float] = {
            (node, key): 0 for node, keys in targets.items() for key in keys
        }
        self._ages = {pdo.cob_id: self._limit for pdos in self._tpdos.values() for pdo in pdos}
        self._beats = dict.fromkeys(self.numbers, 0)
        self._operational = dict.fromkeys(self.numbers, True)
        self._prepared: list[tuple[int, _Pdo, bytearray]] = []
        self._port: CanPort | None = None
        # sent before the first cycle
        outputs = [machine.outputs[column] for column in self.outputs]
        self.write_outputs(np.array([each.raw_of(each.initial) for each in outputs]))

    # ------------------------------------------------------------------ frames

    def open(self, port: CanPort) -> dict[int, Callable[[bytes], None]]:
        """Prepare what is sent; return what to call for which COB-ID."""
        self._port = port
        self._prepared = [
            (node, pdo, port.prepare(pdo.cob_id, pdo.packing.size))
            for node, pdos in self._rpdos.items()
            for pdo in pdos
        ]
        handlers: dict[int, Callable[[bytes], None]] = {}
        for node, pdos in self._tpdos.items():
            handlers[Function.HEARTBEAT + node] = self._heartbeat_of(node)
            for pdo in pdos:
                handlers[pdo.cob_id] = self._taker(node, pdo)
        return handlers

    def tick(self) -> None:
        """A cycle has passed."""
        for cob_id in self._ages:
            self._ages[cob_id] += 1
        for node in self._beats:
            self._beats[node] += 1

    def send(self) -> int:
        """Send every RPDO; return how many found no room."""
        port, lost = self._port, 0
        assert port is not None
        for node, pdo, buffer in self._prepared:
            pdo.packing.pack_into(
                buffer, port.payload_offset, *(self._written[node, key] for key in pdo.keys)
            )
            lost += not port.send_prepared(buffer)
        return lost

    @property
    def missing(self) -> list[int]:
        """Nodes that have not answered lately."""
        return [node for node in self.numbers if not self._fresh(node)]

    # ------------------------------------------------------------------ values

    def write_outputs(self, raw: Array) -> None:
        for target, value in zip(self._targets, raw.tolist(), strict=True):
            place = target.node, (target.index, target.subindex)
            if target.bit is None:
                self._written[place] = _bounded(value, target.type)
                continue
            bit = 1 << target.bit
            word = int(self._written[place])
            word = word | bit if value else word & ~bit
            self._written[place] = _signed(word, target.type)

    def read_inputs(self, raw: Array, fresh: NDArray[np.bool_]) -> None:
        alive = {node: self._fresh(node) for node in self.numbers}
        for at, source in enumerate(self._sources):
            value = self._read.get((source.node, (source.index, source.subindex)), 0)
            raw[at] = value if source.bit is None else int(value) >> source.bit & 1
            fresh[at] = alive[source.node]

    def read_outputs(self, fresh: NDArray[np.bool_]) -> None:
        """Fill in which outputs' nodes are there."""
        alive = {node: self._fresh(node) for node in self.numbers}
        for at, target in enumerate(self._targets):
            fresh[at] = alive[target.node]

    def _fresh(self, node: int) -> bool:
        silent = any(self._ages[pdo.cob_id] >= self._limit for pdo in self._tpdos[node])
        return self._operational[node] and not silent and self._beats[node] < self._beat_limit

    def _taker(self, node: int, pdo: _Pdo) -> Callable[[bytes], None]:
        def take(payload: bytes) -> None:
            if len(payload) != pdo.packing.size:
                # not what was agreed: it counts as not come
                return
            for key, value in zip(pdo.keys, pdo.packing.unpack(payload), strict=True):
                self._read[node, key] = value
            self._ages[pdo.cob_id] = 0
            self._beats[node] = 0

        return take

    def _heartbeat_of(self, node: int) -> Callable[[bytes], None]:
        def heartbeat(payload: bytes) -> None:
            if len(payload) == 1:
                self._beats[node] = 0
                self._operational[node] = payload[0] & 0x7F == NmtState.OPERATIONAL

        return heartbeat


def _columns(objects: Sequence[IoObject | None], bus: str) -> tuple[int, ...]:
    return tuple(
        column
        for column, each in enumerate(objects)
        if each is not None and each.axis < 0 and each.bus == bus
    )


def _bounded(value: float, kind: str) -> float:
    """Return the nearest number that an object can hold."""
    if kind == "f32":
        return value
    bits = int(kind[1:])
    low, high = (0, (1 << bits) - 1) if kind[0] == "u" else (-(1 << bits - 1), (1 << bits - 1) - 1)
    return min(max(round(value), low), high)


def _signed(word: int, kind: str) -> int:
    bits = int(kind[1:])
    word &= (1 << bits) - 1
    return word - (1 << bits) if kind[0] == "i" and word >> bits - 1 else word
