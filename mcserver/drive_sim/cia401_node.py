"""One simulated CiA 401 node: inputs that are set on demand, outputs as the master writes them.

When it loses its master, digital outputs with a bit in 6206h take the value of 6207h.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from importlib import resources

from mcserver.drive_sim.canopen_node import CanopenNode, Transmit
from mcserver.drive_sim.dictionary import EDS, FORMATS, ObjectStore
from mcserver.drive_sim.fault_injection import BadRequest, Misbehaviour, values_of

Objects = Mapping[tuple[int, int], str]

DEVICE_TYPE = 0x000F0191
DIGITAL_OUTPUTS, ERROR_MODE, ERROR_VALUE = 0x6200, 0x6206, 0x6207
PDO_OFF = 0x8000_0000
_SECTION = re.compile(r"^\[([0-9A-Fa-f]{4})(?:sub[0-9A-Fa-f]+)?\]\n(?:(?!\[).*\n?)*", re.MULTILINE)
_TYPES = {"i8": 2, "i16": 3, "i32": 4, "u8": 5, "u16": 6, "u32": 7}


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
    shipped = resources.files("mcserver.drive_sim").joinpath(EDS).read_text("ascii")
    text = _SECTION.sub(lambda found: found[0] if int(found[1], 16) < 0x6000 else "", shipped)
    digital = {key: "u8" for key in outputs if key[0] == DIGITAL_OUTPUTS}
    text += _records(inputs, "ro", mappable=True)
    text += _records(outputs, "rww", mappable=True)
    for index in (ERROR_MODE, ERROR_VALUE):
        text += _records({(index, sub): kind for (_, sub), kind in digital.items()}, "rw", mappable=False)
    store = ObjectStore(node, text)
    store.entry(0x1000).default = DEVICE_TYPE
    for _, subindex in digital:
        store.entry(ERROR_MODE, subindex).default = 0xFF
    for number in range(4):
        for communication, mapping in ((0x1400, 0x1600), (0x1800, 0x1A00)):
            cob_id = store.entry(communication + number, 1)
            cob_id.default |= PDO_OFF
            for subindex in range(9):
                store.entry(mapping + number, subindex).default = 0
    store.reset()
    return store


def _records(objects: Objects, access: str, *, mappable: bool) -> str:
    """Sections of an EDS file for records with these members."""
    members: dict[int, list[tuple[int, int]]] = {}
    for (index, subindex), kind in objects.items():
        if _TYPES.get(kind) in FORMATS:
            members.setdefault(index, []).append((subindex, _TYPES[kind]))
    text = ""
    for index, own in members.items():
        greatest = max(subindex for subindex, _ in own)
        text += f"\n[{index:04X}]\nParameterName=Channels\nObjectType=0x9\nSubNumber={len(own) + 1}\n"
        if all(subindex for subindex, _ in own):
            text += f"\n[{index:04X}sub0]\nParameterName=Highest subindex\nObjectType=0x7\nDataType=0x0005\n"
            text += f"AccessType=ro\nDefaultValue={greatest}\nPDOMapping=0\n"
        for subindex, code in own:
            text += f"\n[{index:04X}sub{subindex:X}]\nParameterName=Channel {subindex}\nObjectType=0x7\n"
            text += (
                f"DataType=0x{code:04X}\nAccessType={access}\nDefaultValue=0\nPDOMapping={int(mappable)}\n"
            )
    return text
