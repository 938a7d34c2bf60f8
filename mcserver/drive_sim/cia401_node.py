"""One simulated CiA 401 node: inputs that are set on demand, outputs as the master writes them.

When it loses its master, digital outputs with a bit in 6206h take the value of 6207h.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from canopen.objectdictionary import ODVariable, datatypes

from mcserver.drive_sim.canopen_node import CanopenNode, Transmit
from mcserver.drive_sim.dictionary import ObjectStore
from mcserver.drive_sim.fault_injection import BadRequest, Misbehaviour, values_of

Objects = Mapping[tuple[int, int], str]

DEVICE_TYPE = 0x000F0191
DIGITAL_OUTPUTS, ERROR_MODE, ERROR_VALUE = 0x6200, 0x6206, 0x6207
PDO_OFF = 0x8000_0000
_TYPES = {
    "i8": datatypes.INTEGER8,
    "i16": datatypes.INTEGER16,
    "i32": datatypes.INTEGER32,
    "u8": datatypes.UNSIGNED8,
    "u16": datatypes.UNSIGNED16,
    "u32": datatypes.UNSIGNED32,
}


class Cia401Node(CanopenNode):
    """One I/O node; its attributes and services are those of `CanopenNode`.

    Args:
        inputs, outputs: types of its objects, by index and subindex. Floating point is left out.
    """

    def __init__(self, node: int, transmit: Transmit, inputs: Objects, outputs: Objects) -> None:
        super().__init__(node, transmit, _dictionary(node, inputs, outputs))
        self._inputs = {key for key, kind in inputs.items() if kind in _TYPES}
        self._outputs = {key for key, kind in outputs.items() if kind in _TYPES}

    def request(self, fault: str, request: Mapping[str, object], now: float) -> None:
        """Set an input (``set`` with ``index``, ``subindex``, ``value``), or do a fault on demand.

        Raises:
            BadRequest: there is no such input or fault, or a value does not fit.
        """
        self._now = now
        if fault == "set":
            self._set(request)
        elif fault == "clear":
            self.wrong = Misbehaviour()
            self.nmt.beats = True
        elif fault == "reboot":
            self.nmt.reset(now)
        elif fault == "heartbeat_stop":
            self.nmt.beats = False
        elif not self.wrong.begin(fault, values_of(request, fault)):
            raise BadRequest(f"an I/O node has no fault {fault!r}")
        self.wake = now

    def describe(self) -> dict[str, object]:
        """Its inputs and outputs, by ``6200h:01``."""
        state = self.nmt.state
        return {
            "node": self.node,
            "kind": "cia401",
            "nmt": "BOOTING" if state is None else state.name,
            "inputs": self._shown(self._inputs),
            "outputs": self._shown(self._outputs),
            "faults": self.wrong.active + ([] if self.nmt.beats else ["heartbeat_stop"]),
        }

    def connection_lost(self, code: int) -> None:
        """Digital outputs take their values for this."""
        del code
        for index, subindex in self._outputs:
            if index == DIGITAL_OUTPUTS:
                entry = self.store.entry(index, subindex)
                mode = self.store.entry(ERROR_MODE, subindex).value
                value = self.store.entry(ERROR_VALUE, subindex).value
                entry.value = entry.value & ~mode | value & mode

    def _set(self, request: Mapping[str, object]) -> None:
        index, subindex, value = (request.get(name, 0) for name in ("index", "subindex", "value"))
        if not (isinstance(index, int) and isinstance(subindex, int) and isinstance(value, int)):
            raise BadRequest("set needs 'index', 'subindex' and 'value', whole numbers")
        key = index, subindex
        if key not in self._inputs:
            raise BadRequest(f"the node has no input {index}, {subindex}")
        entry = self.store.entry(*key)
        if not entry.least <= value <= entry.greatest:
            raise BadRequest(f"{value} is outside {entry.least} … {entry.greatest}")
        entry.value = value

    def _shown(self, keys: set[tuple[int, int]]) -> dict[str, int]:
        return {f"{index:04X}h:{sub:02X}": self.store.entry(index, sub).value for index, sub in sorted(keys)}


def _dictionary(node: int, inputs: Objects, outputs: Objects) -> ObjectStore:
    """Return the communication part of the shipped EDS file, and the objects of a machine's node."""
    store = ObjectStore(node)
    store.remove(range(0x6000, 0x10000))
    digital = [subindex for index, subindex in outputs if index == DIGITAL_OUTPUTS]
    store.add(_channels(inputs, "ro"))
    store.add(_channels(outputs, "rww"))
    for index in (ERROR_MODE, ERROR_VALUE):
        store.add(_channels({(index, subindex): "u8" for subindex in digital}, "rw", mappable=False))
    store.entry(0x1000).default = DEVICE_TYPE
    for subindex in digital:
        store.entry(ERROR_MODE, subindex).default = 0xFF
    for number in range(4):
        for communication, mapping in ((0x1400, 0x1600), (0x1800, 0x1A00)):
            cob_id = store.entry(communication + number, 1)
            cob_id.default |= PDO_OFF
            for subindex in range(9):
                store.entry(mapping + number, subindex).default = 0
    store.reset()
    return store


def _channels(objects: Objects, access: str, *, mappable: bool = True) -> Iterator[ODVariable]:
    """Yield the members of records with these objects, each record's greatest subindex first."""
    known = {key: _TYPES[kind] for key, kind in objects.items() if kind in _TYPES}
    for index, subindex in dict.fromkeys((index, 0) for index, _ in known):
        if (index, subindex) not in known:
            count = _variable(index, subindex, datatypes.UNSIGNED8, "ro", mappable=False)
            count.default = max(own for each, own in known if each == index)
            yield count
    for (index, subindex), kind in known.items():
        yield _variable(index, subindex, kind, access, mappable=mappable)


def _variable(index: int, subindex: int, kind: int, access: str, *, mappable: bool) -> ODVariable:
    variable = ODVariable(f"Channel {subindex}", index, subindex)
    variable.data_type, variable.access_type, variable.pdo_mappable = kind, access, mappable
    return variable
