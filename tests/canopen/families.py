"""Slaves in the manner of public families of drives: what their EDS files and their habits differ in.

Made for the tests from what makers publish (dictionaries, default mappings, answers to writes); each is a
python-canopen LocalNode over an EDS of its own. None of them is a drive of that maker.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from canopen.sdo.exceptions import SdoAbortedError

from tests.canopen.eds_files import I8, I16, I32, U8, U32, eds, entry, record
from tests.canopen.local_drives import DISABLED, ENABLED, FAULT, READY, SWITCHED_ON, LocalDrive
from tests.canopen.rig import RunningHub

IN_RANGE, WRONG_STATE, PDO_IN_USE = 0x0609_0030, 0x0800_0022, 0x0601_0000
INVALID = 0x8000_0000


@dataclass(frozen=True)
class Habits:
    """What a drive does besides its EDS.

    Attributes:
        strict_pdos: mapping and transmission type are refused while the PDO is valid.
        allows: object → the only values that it takes; others are out of its range.
        hides_mode: 6061h is 0 until operation is enabled. bits: always set in the statusword.
        starts_itself: operational right after its boot-up message. leaps: from ready to enabled at once.
        steps: SYNCs that each transition takes, shown as not ready to switch on.
        reset_steps: SYNCs until a fault is gone.
    """

    strict_pdos: bool = False
    allows: Mapping[tuple[int, int], tuple[int, ...]] = field(default_factory=dict)
    hides_mode: bool = False
    bits: int = 0x200
    starts_itself: bool = False
    leaps: bool = False
    steps: int = 0
    reset_steps: int = 0


@dataclass(frozen=True)
class Family:
    """One family: its EDS, its habits, and what its machine file needs besides ``eds``."""

    text: str
    habits: Habits = Habits()
    keys: str = ""


class FamilyDrive(LocalDrive):
    """A drive with habits; a fault is made by `break_down`.

    Attributes:
        broken: the fault that it has.
    """

    def __init__(self, hub: RunningHub, family: Family, node: int = 1, position: int = 777) -> None:
        super().__init__(hub, family.text, node, (position,))
        self.habits = family.habits
        self.broken = False
        self._busy = 0
        self._last_reset = False
        self.local.add_write_callback(self._judge)
        self.network.subscribe(0, self._on_nmt)

    def start(self) -> FamilyDrive:
        super().start()
        self._after_boot()
        return self

    def break_down(self) -> None:
        self.broken = True

    def _after_boot(self) -> None:
        if self.habits.starts_itself:
            self.local.nmt.state = "OPERATIONAL"

    def _on_nmt(self, _identifier: int, payload: bytes, _at: float) -> None:
        if payload[0] in (0x81, 0x82) and payload[1] in (0, self.number):
            self._after_boot()

    def _judge(self, index: int, subindex: int, od: object, data: bytes) -> None:  # noqa: ARG002
        value = int.from_bytes(data, "little")
        allowed = self.habits.allows.get((index, subindex))
        if allowed is not None and value not in allowed:
            raise SdoAbortedError(IN_RANGE)
        if not self.habits.strict_pdos or not 0x1400 <= index < 0x1C00:
            return
        mapping = bool(index & 0x200)
        record_of = index & ~0x200
        valid = not self.value(record_of, 1) & INVALID
        if mapping and (valid or (subindex and self.value(index, 0))):
            raise SdoAbortedError(PDO_IN_USE)
        if not mapping and subindex == 2 and valid:
            raise SdoAbortedError(WRONG_STATE)
        if not mapping and subindex == 1 and valid and value & 0x7FF != self.value(index, 1) & 0x7FF:
            raise SdoAbortedError(WRONG_STATE)

    def _step(self, axis: int) -> None:
        habits, command = self.habits, self.value(0x6040)
        rising = bool(command & 0x80) and not self._last_reset
        self._last_reset = bool(command & 0x80)
        before = self.word[axis]
        if self.broken and before != FAULT:
            self.word[axis] = FAULT
            self._busy = habits.reset_steps
        elif before == FAULT:
            if rising or self._busy < habits.reset_steps:
                self._busy -= 1
            if self._busy < 0 or (rising and not habits.reset_steps):
                self.broken, self.word[axis], self._busy = False, DISABLED, 0
        elif self._busy > 0:
            self._busy -= 1
        if self.word[axis] == FAULT or self._busy > 0:
            self._show(axis, 0x00 if self.word[axis] != FAULT else FAULT)
            return
        if habits.leaps and before == READY and command & 0xF == 0xF:
            self.word[axis] = SWITCHED_ON
        super()._step(axis)
        if self.word[axis] != before and habits.steps:
            self._busy = habits.steps
            self._show(axis, 0x00)
        else:
            self._show(axis, self.word[axis])

    def _show(self, axis: int, word: int) -> None:
        store = self.local.data_store
        bits = struct.unpack("<H", store.get(0x6041, {}).get(0, b"\0\0"))[0] & ~0x6F if word == ENABLED else 0
        store.setdefault(0x6041, {})[0] = struct.pack("<H", word | bits | self.habits.bits)
        store.setdefault(0x6064, {})[0] = struct.pack("<i", self.position[axis])
        if self.habits.hides_mode and word != ENABLED:
            store.setdefault(0x6061, {})[0] = b"\0"


PROFILE = (
    entry(0x6081, "Profile velocity", U32)
    + entry(0x6083, "Profile acceleration", U32)
    + entry(0x6084, "Profile deceleration", U32)
    + entry(0x6086, "Motion profile type", I16)
)
ABORT_OPTION = entry(0x6007, "Abort connection option code", I16, mapped=False, default="1")
CYCLE = record(0x60C2, "Interpolation time period", (U8, I8), "rw", ["1", "0xFD"])
INTERPOLATED = record(0x60C1, "Interpolation data record", (I32,), "rww", ["0"], mapped=True)
WATCHED = record(0x1016, "Consumer heartbeat time", (U32,), "rw", ["0"])
GEAR = record(0x6091, "Gear ratio", (U32, U32), "rw", ["1", "1"])
FEED = record(0x6092, "Feed constant", (U32, U32), "rw", ["4096", "1"])
ENCODER = record(0x608F, "Position encoder resolution", (U32, U32), "rw", ["4096", "1"])
ENCODER_READ_ONLY = record(0x608F, "Position encoder resolution", (U32, U32), "ro", ["4096", "1"])
TORQUES = entry(0x6071, "Target torque", I16) + entry(0x6077, "Torque actual value", I16, access="ro")
OLD_UNITS = record(0x6093, "Position factor", (U32, U32), "rw", ["1", "1"])
SUPPORTED = 0x6502


def has_modes(mask: int) -> dict[int, dict[str, str]]:
    return {SUPPORTED: {"DefaultValue": f"0x{mask:X}"}}


EVENTS = {"transmission": "255"}
SHORT_RECORDS = {"rpdo_members": 2, **EVENTS}

FAMILIES: Mapping[str, Family] = MappingProxyType(
    {
        # two members in RPDO records, everything by events, a heartbeat of its own kind, 60C2h:02 is -3 only
        "maxon EPOS4": Family(
            eds(
                changes=has_modes(0x3E5),
                more=PROFILE + ABORT_OPTION + CYCLE + WATCHED + TORQUES + entry(0x2000, "Node-ID", U8),
                tpdos=((0x60410010,), (0x60410010, 0x60610008), (0x60410010, 0x60640020), (0x60410010,)),
                **SHORT_RECORDS,
            ),
            Habits(strict_pdos=True, allows={(0x60C2, 2): (0xFD,), (0x6007, 0): (0, 1, 2, 3)}, bits=0x8200),
            "rated_torque = 1.0",
        ),
        "Elmo Gold": Family(
            eds(
                changes=has_modes(0x3ED),
                more=PROFILE + CYCLE + WATCHED + GEAR + FEED + ENCODER + TORQUES,
                **EVENTS,
            ),
            Habits(strict_pdos=True, bits=0x0210, reset_steps=8),
        ),
        # csp in newer firmware only
        "Copley": Family(
            eds(
                without=[0x60FF],
                changes={**has_modes(0x65), 0x6060: {"PDOMapping": "0", "AccessType": "rw"}},
                more=PROFILE + INTERPOLATED + CYCLE + WATCHED,
                **SHORT_RECORDS,
            ),
            Habits(bits=0x4210),
            'mode = "ip"',
        ),
        "Nanotec": Family(
            eds(
                changes=has_modes(0x3EF),
                more=PROFILE + ABORT_OPTION + CYCLE + WATCHED + GEAR + FEED + ENCODER,
            ),
            Habits(strict_pdos=True, bits=0x0610, steps=2),
        ),
        "Technosoft": Family(
            eds(
                without=[0x1014],
                changes=has_modes(0x1F0065),
                more=PROFILE + ABORT_OPTION + INTERPOLATED + OLD_UNITS,
                **SHORT_RECORDS,
            ),
            Habits(bits=0x0250 & ~0x40, steps=5),
            'mode = "ip"',
        ),
        # its process data as the profile's defaults, no 1016h, no quick stop on loss among its options
        "Delta": Family(
            eds(
                changes=has_modes(0xED),
                more=PROFILE + ABORT_OPTION + CYCLE + ENCODER_READ_ONLY,
                **SHORT_RECORDS,
            ),
            Habits(allows={(0x6007, 0): (0, 1, 2)}, bits=0x0200, starts_itself=True),
        ),
        "Leadshine": Family(
            eds(changes=has_modes(0x3ED), more=PROFILE + ABORT_OPTION + CYCLE + WATCHED + GEAR, **EVENTS),
            Habits(allows={(0x6007, 0): (0, 2)}, bits=0x1200 & ~0x1000, leaps=True),
        ),
        "Kinco": Family(
            eds(changes=has_modes(0xED), more=PROFILE + CYCLE + WATCHED, **SHORT_RECORDS),
            Habits(hides_mode=True, bits=0x4230 & ~0x20),
        ),
        "Trinamic": Family(
            eds(
                without=[0x60FF],
                changes=has_modes(0x25),
                more=PROFILE + WATCHED,
                **EVENTS,
            ),
            Habits(),
            'mode = "pp"',
        ),
        "Faulhaber": Family(
            eds(
                changes=has_modes(0x3E5),
                more=PROFILE + CYCLE + WATCHED + GEAR + FEED,
                rpdos=(
                    (0x60400010,),
                    (0x60400010, 0x607A0020),
                    (0x60400010, 0x60FF0020),
                    (0x60400010, 0x60600008),
                ),
                **EVENTS,
            ),
            Habits(strict_pdos=True, bits=0x0210),
        ),
        # process data are switched off until somebody maps them; its encoder cannot be changed
        "Kollmorgen": Family(
            eds(
                changes=has_modes(0xE1),
                more=PROFILE + INTERPOLATED + CYCLE + WATCHED + GEAR + FEED + ENCODER_READ_ONLY,
                off=True,
                rpdos=((0x60400010,), (), (), ()),
                tpdos=((0x60410010,), (), (), ()),
                **EVENTS,
            ),
            Habits(strict_pdos=True, bits=0x0210),
        ),
        # defaults of CiA 402 that nobody can change, as in drives before free mapping; points alone
        "fixed, points": Family(
            eds(
                without=[0x60FF],
                changes=has_modes(0x25),
                more=PROFILE + entry(0x605D, "Halt option code", I16, mapped=False),
                rpdos=(
                    (0x60400010,),
                    (0x60400010, 0x60600008),
                    (0x60400010, 0x607A0020),
                    (0x60400010, 0x60810020),
                ),
                fixed=True,
                **EVENTS,
            ),
            Habits(bits=0x0210),
            'mode = "pp"',
        ),
    }
)


Make = Callable[[str], FamilyDrive]
