"""Which process data a drive and the cycle exchange: mapped by the master, or the drive's own fixed ones.

A drive gets the least that its modes need: one RPDO with controlword, mode and target, another one with
controlword, velocity and torque, a TPDO with statusword, mode and position at every SYNC, and slow TPDOs for
torque and for what is monitored. What an EDS does not have or cannot map is left out where no mode needs it.
Where the drive's mapping is fixed, the fewest of its PDOs that carry what is needed are taken as they are.

The order of writing a PDO is CiA 301's (7.5.2.36): COB-ID invalid, number of entries 0, entries, number,
transmission type, COB-ID valid.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from mcserver.can.cob import RPDOS, TPDOS, Function
from mcserver.can.pdo import MappedObject, MappedPdo, ProcessData
from mcserver.can.pdo_layout import (
    CONTROLWORD,
    MODE,
    MODE_DISPLAY,
    POSITION_ACTUAL,
    SLOW_SYNCS,
    STATUSWORD,
    TARGET_POSITION,
    TARGET_TORQUE,
    TARGET_VELOCITY,
    TORQUE_ACTUAL,
    Mode,
)
from mcserver.canopen.canopen_errors import object_text
from mcserver.canopen.sdo_write import DriveDictionary, SdoWrite, unsigned32
from mcserver.errors import ConfigurationError

INVALID = 1 << 31
NO_REMOTE_REQUEST = 1 << 30
IDENTIFIER = 0x7FF
PDOS = 4
# Records of a node's next axis are so many further (CiA 402).
PDOS_OF_AXIS = 64
MOST_BYTES = 8
# Transmission types at SYNC (CiA 301): acyclic, every, every n-th.
SYNCHRONOUS = range(241)
BY_EVENTS = (254, 255)

INTERPOLATED = MappedObject(0x60C1, 1, 32)
TORQUE_OFFSET = MappedObject(0x60B2, 0, 16)
PROFILE_VELOCITY = MappedObject(0x6081, 0, 32)
DIGITAL_INPUTS = MappedObject(0x60FD, 0, 32)
DIGITAL_OUTPUTS = MappedObject(0x60FE, 1, 32)
TARGETS = {
    Mode.CYCLIC_POSITION: TARGET_POSITION,
    Mode.CYCLIC_VELOCITY: TARGET_VELOCITY,
    Mode.INTERPOLATED_POSITION: INTERPOLATED,
    Mode.PROFILE_POSITION: TARGET_POSITION,
    Mode.CYCLIC_TORQUE: TARGET_TORQUE,
}
# Modes whose position loop is closed in the master: their target is in an RPDO of every cycle.
_CLOSED_HERE = (Mode.CYCLIC_VELOCITY, Mode.CYCLIC_TORQUE)
# What may stand in a fixed RPDO besides, since 0 in it changes nothing: offsets, and dummy objects.
NEUTRAL = frozenset({0x60B0, 0x60B1, 0x60B2, *range(1, 8)})


@dataclass(frozen=True)
class PlannedProcessData:
    """What the cycle exchanges, and what has to be written for it.

    Attributes:
        spare: names of PDOs that are given up where the drive refuses them, by PDO.
    """

    process_data: ProcessData
    writes: tuple[SdoWrite, ...]
    spare: dict[str, MappedPdo]

    def without(self, dropped: Iterable[str]) -> ProcessData:
        """Return the process data without PDOs that the drive has refused."""
        gone = [self.spare[name] for name in dropped]
        data = self.process_data
        return ProcessData(
            tuple(pdo for pdo in data.rpdos if pdo not in gone),
            tuple(pdo for pdo in data.tpdos if pdo not in gone),
        )


@dataclass(frozen=True)
class _Direction:
    """RPDOs or TPDOs: their records and COB-IDs."""

    kind: str
    communication: int
    mapping: int
    bases: tuple[Function, ...]
    flags: int


_RPDO = _Direction("RPDO", 0x1400, 0x1600, RPDOS, 0)
# remote frames are not for drives, and some devices refuse a COB-ID that allows them
_TPDO = _Direction("TPDO", 0x1800, 0x1A00, TPDOS, NO_REMOTE_REQUEST)


@dataclass(frozen=True)
class _Wanted:
    """One PDO that the master would map."""

    objects: tuple[MappedObject, ...]
    transmission: int
    spare: bool = False


def plan_process_data(dictionary: DriveDictionary) -> PlannedProcessData:
    """Choose an axis's PDOs and list what has to be written for them.

    Raises:
        ConfigurationError: MC552 a mode needs what the drive cannot exchange.
    """
    plan = _Plan(dictionary)
    rpdos = plan.of_direction(_RPDO, plan.wanted_rpdos(), plan.required_rpdo_objects())
    tpdos = plan.of_direction(_TPDO, plan.wanted_tpdos(), plan.required_tpdo_objects())
    return PlannedProcessData(ProcessData(tuple(rpdos), tuple(tpdos)), tuple(plan.writes), plan.spare)


class _Plan:
    def __init__(self, dictionary: DriveDictionary) -> None:
        self._dictionary = dictionary
        self._drive = dictionary.drive
        self._offset = self._drive.offset
        self._in_defaults = self._default_mapped()
        self.writes: list[SdoWrite] = []
        self.spare: dict[str, MappedPdo] = {}

    # ------------------------------------------------------------ what is wanted

    def required_rpdo_objects(self) -> tuple[MappedObject, ...]:
        required = [CONTROLWORD, TARGETS[Mode(self._drive.mode)]]
        required += [TORQUE_OFFSET] if self._drive.torque_offset else []
        required += [DIGITAL_OUTPUTS] if self._drive.outputs else []
        return tuple(self._of_axis(mapped) for mapped in required)

    def required_tpdo_objects(self) -> tuple[MappedObject, ...]:
        required = [STATUSWORD, POSITION_ACTUAL, *([DIGITAL_INPUTS] if self._drive.inputs else ())]
        return tuple(self._of_axis(mapped) for mapped in required)

    def wanted_rpdos(self) -> list[_Wanted]:
        target, own = self._target(), TARGETS[Mode(self._drive.mode)]
        mode = [MODE] if self._can_map(MODE) else []
        wanted = [_Wanted((CONTROLWORD, *mode, target), 1)]
        if self._drive.torque_offset:
            self._check_torque_offset()
            wanted.append(_Wanted((TORQUE_OFFSET,), 1))
        if self._drive.outputs:
            wanted.append(_Wanted((DIGITAL_OUTPUTS,), 1))
        if self._drive.mode == Mode.PROFILE_POSITION:
            speed = [_Wanted((PROFILE_VELOCITY,), 1, spare=True)] if self._can_map(PROFILE_VELOCITY) else []
            return wanted + speed
        others = [TARGET_VELOCITY] if target is not TARGET_VELOCITY and self._can_map(TARGET_VELOCITY) else []
        if self._drive.torque and target is not TARGET_TORQUE and self._can_map(TARGET_TORQUE):
            others.append(TARGET_TORQUE)
        if own is not target and own not in others:
            # planned all the same, so that the refusal names it
            others.append(own)
        if others and (mode or own is not target):
            # without a mode in its process data the drive stays in the one of boot-up
            others = others if mode else [own]
            wanted.append(_Wanted((CONTROLWORD, *others), 1, spare=own is target))
        return wanted

    def _check_torque_offset(self) -> None:
        if not self._can_map(TORQUE_OFFSET):
            place = self._of_axis(TORQUE_OFFSET)
            raise self._dictionary.no_place(
                place.index,
                place.subindex,
                "torque_feed_forward: the drive has no torque offset in its process data",
                "set torque_feed_forward = false",
            )

    def wanted_tpdos(self) -> list[_Wanted]:
        mode = [MODE_DISPLAY] if self._can_map(MODE_DISPLAY) else []
        wanted = [_Wanted((STATUSWORD, *mode, POSITION_ACTUAL), 1)]
        if self._drive.inputs:
            wanted.append(_Wanted((DIGITAL_INPUTS,), 1))
        if self._drive.torque and self._can_map(TORQUE_ACTUAL):
            wanted.append(_Wanted((TORQUE_ACTUAL,), SLOW_SYNCS, spare=True))
        monitored = [self._monitored(index, subindex) for index, subindex, _ in self._drive.monitor]
        while monitored:
            taken: list[MappedObject] = []
            while monitored and sum(each.bits for each in (*taken, monitored[0])) <= 8 * MOST_BYTES:
                taken.append(monitored.pop(0))
            wanted.append(_Wanted(tuple(taken), SLOW_SYNCS, spare=True))
        return wanted

    def _target(self) -> MappedObject:
        mode = Mode(self._drive.mode)
        if mode in _CLOSED_HERE and self._can_map(MODE) and self._can_map(TARGET_POSITION):
            # the position is for information; a drive that has it gets the usual mapping
            return TARGET_POSITION
        return TARGETS[mode]

    def _monitored(self, index: int, subindex: int) -> MappedObject:
        variable = self._dictionary.must_have(index, subindex)
        bits = len(variable)
        if not 8 <= bits <= 64 or bits % 8:
            raise self._dictionary.no_place(
                index, subindex, "monitor: it is no number of whole bytes", "take it out of `monitor`"
            )
        if not (variable.pdo_mappable or (index, subindex) in self._in_defaults):
            raise self._dictionary.no_place(
                index,
                subindex,
                "monitor: the EDS says that it cannot be mapped into a PDO",
                "take it out of `monitor`; `mcctl sdo read` reads it",
            )
        return MappedObject(index, subindex, bits)

    # ------------------------------------------------------------ one direction

    def of_direction(
        self, direction: _Direction, wanted: Sequence[_Wanted], required: Sequence[MappedObject]
    ) -> list[MappedPdo]:
        numbers = self._numbers(direction)
        if self._is_fixed(direction, numbers):
            chosen = self._cover(direction, numbers, required, wanted)
        else:
            chosen = self._mapped(direction, numbers, wanted)
        if self._drive.node_axis == 0:
            used = {pdo.number for pdo in chosen}
            for number in range(1, PDOS + 1):
                if number not in used:
                    self._switch_off(direction, number)
        return chosen

    def _numbers(self, direction: _Direction) -> list[int]:
        """Numbers of the records of this axis."""
        axis = self._drive.node_axis
        first = PDOS_OF_AXIS * axis + 1
        if axis and not self._dictionary.has(direction.communication + first - 1, 1):
            # the node's axes share one set of records
            first = 2 * axis + 1
        return [
            number
            for number in range(first, first + PDOS)
            if self._dictionary.has(direction.communication + number - 1, 1)
        ]

    def _is_fixed(self, direction: _Direction, numbers: Sequence[int]) -> bool:
        if self._drive.fixed_pdos:
            return True
        if not numbers:
            raise self._dictionary.no_place(
                direction.communication,
                1,
                f"the EDS does not have it{self._dictionary.other_device}",
                "check that `eds` names this drive's file; without `eds` the standard's objects are assumed",
            )
        first = numbers[0] - 1
        return not (
            self._dictionary.writable(direction.mapping + first, 0)
            and self._dictionary.writable(direction.communication + first, 1)
        )

    def _mapped(
        self, direction: _Direction, numbers: Sequence[int], wanted: Sequence[_Wanted]
    ) -> list[MappedPdo]:
        chosen = []
        for place, pdo in enumerate(wanted):
            if place >= len(numbers):
                if pdo.spare:
                    continue
                raise self._no_pdo(direction, numbers)
            number = numbers[place]
            objects = tuple(self._of_axis(mapped) for mapped in pdo.objects)
            for mapped, written in zip(pdo.objects, objects, strict=True):
                self._check_mappable(direction, mapped, written)
            made = MappedPdo(number, self._cob(direction, place, number), objects, pdo.transmission)
            name = f"{direction.kind}{number}"
            self.writes += self._writes_of(direction, made, name if pdo.spare else "")
            if pdo.spare:
                self.spare[name] = made
            chosen.append(made)
        return chosen

    def _writes_of(self, direction: _Direction, pdo: MappedPdo, spare: str) -> Iterator[SdoWrite]:
        name = f"{direction.kind}{pdo.number}"
        record, mapping = direction.communication + pdo.number - 1, direction.mapping + pdo.number - 1
        cob = pdo.cob_id | direction.flags
        yield SdoWrite(record, 1, unsigned32(INVALID | cob), f"{name} off", spare_pdo=spare)
        yield SdoWrite(mapping, 0, b"\x00", f"{name} without entries", spare_pdo=spare)
        for at, mapped in enumerate(pdo.objects, 1):
            what = f"{name} entry {at}: {object_text(mapped.index, mapped.subindex)}"
            yield SdoWrite(mapping, at, unsigned32(mapped.word), what, spare_pdo=spare)
        yield SdoWrite(mapping, 0, bytes([len(pdo.objects)]), f"{name} number of entries", spare_pdo=spare)
        yield from self._behaviour(direction, pdo, record, name, spare)
        yield SdoWrite(record, 1, unsigned32(cob), f"{name} on", spare_pdo=spare)

    def _behaviour(
        self, direction: _Direction, pdo: MappedPdo, record: int, name: str, spare: str
    ) -> Iterator[SdoWrite]:
        """Transmission type and time-out."""
        if self._dictionary.writable(record, 2):
            yield SdoWrite(
                record, 2, bytes((pdo.transmission,)), f"{name} transmission type", spare_pdo=spare
            )
        if direction is _RPDO and self._dictionary.writable(record, 5):
            timeout = self._drive.command_timeout_ms if not spare and self._is_watched(pdo) else 0
            payload = struct.pack("<H", timeout)
            yield SdoWrite(record, 5, payload, f"{name} time-out [ms]", optional=True, spare_pdo=spare)

    def _is_watched(self, pdo: MappedPdo) -> bool:
        """Return whether an RPDO goes out in every mode of the axis: one with speeds alone does not."""
        carried = set(pdo.objects)
        if pdo.objects[0] in (self._of_axis(TORQUE_OFFSET), self._of_axis(DIGITAL_OUTPUTS)):
            return False
        by_speed = {self._of_axis(TARGET_VELOCITY), self._of_axis(TARGET_TORQUE)}
        by_position = {self._of_axis(each) for each in (MODE, TARGET_POSITION, INTERPOLATED)}
        return not carried & by_speed or bool(carried & by_position) or not self._can_map(MODE)

    # ------------------------------------------------------------ fixed mappings

    def _cover(
        self,
        direction: _Direction,
        numbers: Sequence[int],
        required: Sequence[MappedObject],
        wanted: Sequence[_Wanted],
    ) -> list[MappedPdo]:
        """Return the fewest of the drive's own PDOs that carry what is required, and most of what is
        wanted.
        """
        own = [pdo for number in numbers if (pdo := self._own_pdo(direction, number)) is not None]
        usable = [pdo for pdo in own if direction is _TPDO or self._is_harmless(pdo)]
        nice = {self._of_axis(mapped) for each in wanted for mapped in each.objects}
        best: tuple[tuple[int, int, int], tuple[MappedPdo, ...]] | None = None
        for count in range(1, len(usable) + 1):
            for subset in itertools.combinations(usable, count):
                carried = {mapped for pdo in subset for mapped in pdo.objects}
                if not carried.issuperset(required):
                    continue
                cost = (len(nice - carried), count, sum(pdo.length for pdo in subset))
                if best is None or cost < best[0]:
                    best = cost, subset
        if best is None:
            raise self._uncovered(direction, own, usable, required)
        for pdo in best[1]:
            self._check_fixed(direction, pdo)
        return list(best[1])

    def _own_pdo(self, direction: _Direction, number: int) -> MappedPdo | None:
        mapping = direction.mapping + number - 1
        count = self._dictionary.default(mapping, 0) or 0
        words = [self._dictionary.default(mapping, at) for at in range(1, count + 1)]
        if not words or any(word is None for word in words):
            return None
        objects = tuple(MappedObject(word >> 16, word >> 8 & 0xFF, word & 0xFF) for word in words if word)
        place = number - 1 if self._drive.node_axis == 0 else (number - 1) % PDOS
        cob = self._cob(direction, min(place, PDOS - 1), number)
        if not self._dictionary.writable(direction.communication + number - 1, 1):
            cob = (self._dictionary.default(direction.communication + number - 1, 1) or 0) & IDENTIFIER
        transmission = 1
        if not self._dictionary.writable(direction.communication + number - 1, 2):
            transmission = self._dictionary.default(direction.communication + number - 1, 2) or 0
        return MappedPdo(number, cob, objects, transmission)

    def _is_harmless(self, pdo: MappedPdo) -> bool:
        """Return whether the server has a value for everything in a fixed RPDO."""
        known = {CONTROLWORD, MODE, TARGET_POSITION, INTERPOLATED, TARGET_VELOCITY, TARGET_TORQUE}
        if self._drive.mode == Mode.PROFILE_POSITION:
            known = {CONTROLWORD, MODE, TARGET_POSITION, PROFILE_VELOCITY}
        if self._drive.outputs:
            known.add(DIGITAL_OUTPUTS)
        ours = {self._of_axis(mapped) for mapped in known}
        return all(mapped in ours or mapped.index in NEUTRAL for mapped in pdo.objects)

    def _check_fixed(self, direction: _Direction, pdo: MappedPdo) -> None:
        """Check that a fixed PDO runs as it has to, and list what can be written of it."""
        record, mapping = direction.communication + pdo.number - 1, direction.mapping + pdo.number - 1
        name = f"{direction.kind}{pdo.number}"
        at_sync = pdo.transmission in SYNCHRONOUS or (direction is _RPDO and pdo.transmission in BY_EVENTS)
        if not at_sync:
            raise self._dictionary.no_place(
                record,
                2,
                f"{name} does not come with SYNC: its transmission type {pdo.transmission} cannot be changed",
                "set it with the maker's tool, or use a drive whose PDOs can be configured",
            )
        count = SdoWrite(mapping, 0, bytes([len(pdo.objects)]), f"{name} number of entries", verify=True)
        self.writes.append(count)
        for at, mapped in enumerate(pdo.objects, 1):
            what = f"{name} entry {at}: {object_text(mapped.index, mapped.subindex)}"
            self.writes.append(SdoWrite(mapping, at, unsigned32(mapped.word), what, verify=True))
        cob = pdo.cob_id | direction.flags
        if not self._dictionary.writable(record, 1):
            default = self._dictionary.default(record, 1)
            if default is None or default & INVALID or not default & IDENTIFIER:
                raise self._dictionary.no_place(
                    record,
                    1,
                    f"{name} is switched off, and the EDS says that its COB-ID cannot be changed",
                    "set it with the maker's tool, or check `eds`",
                )
            self.writes += self._behaviour(direction, pdo, record, name, "")
            return
        self.writes.append(SdoWrite(record, 1, unsigned32(INVALID | cob), f"{name} off"))
        self.writes += self._behaviour(direction, pdo, record, name, "")
        self.writes.append(SdoWrite(record, 1, unsigned32(cob), f"{name} on"))

    def _uncovered(
        self,
        direction: _Direction,
        own: Sequence[MappedPdo],
        usable: Sequence[MappedPdo],
        required: Sequence[MappedObject],
    ) -> ConfigurationError:
        carried = {mapped for pdo in own for mapped in pdo.objects}
        missing = [mapped for mapped in required if mapped not in carried]
        mapping = direction.mapping + (own[0].number if own else 1) - 1
        if missing:
            named = ", ".join(object_text(mapped.index, mapped.subindex) for mapped in missing)
            what = f"its {direction.kind}s cannot be mapped by the master, and none carries {named}"
        elif len(usable) < len(own):
            foreign = ", ".join(
                object_text(mapped.index, mapped.subindex)
                for pdo in own
                if pdo not in usable
                for mapped in pdo.objects
                if not self._is_harmless(MappedPdo(1, 1, (mapped,), 1))
            )
            what = f"its fixed {direction.kind}s carry objects that this server has no value for: {foreign}"
        else:
            what = f"the mapping of its {direction.kind}s is fixed, and no choice of them has all it takes"
        return self._dictionary.no_place(
            mapping, 0, what, "ask the maker for a firmware or an EDS with variable mapping, or another mode"
        )

    # ------------------------------------------------------------ objects

    def _of_axis(self, mapped: MappedObject) -> MappedObject:
        """Return the same object of this axis of the node."""
        if not self._offset or not 0x6000 <= mapped.index < 0x6800:
            return mapped
        return MappedObject(mapped.index + self._offset, mapped.subindex, mapped.bits)

    def _default_mapped(self) -> set[tuple[int, int]]:
        """Objects in default mappings: they can be mapped, whatever the flag of their own says."""
        found = set()
        for first in (0x1600, 0x1A00):
            for index in range(first, first + 0x200):
                if index not in self._dictionary.objects.indices:
                    continue
                for at in range(1, MOST_BYTES + 1):
                    word = self._dictionary.default(index, at)
                    if word:
                        found.add((word >> 16, word >> 8 & 0xFF))
        return found

    def _can_map(self, mapped: MappedObject) -> bool:
        place = self._of_axis(mapped)
        variable = self._dictionary.variable(place.index, place.subindex)
        if variable is None:
            return False
        return bool(variable.pdo_mappable) or (place.index, place.subindex) in self._in_defaults

    def _check_mappable(self, direction: _Direction, mapped: MappedObject, written: MappedObject) -> None:
        self._dictionary.must_have(written.index, written.subindex)
        if mapped.index >= 0x6000 and not self._can_map(mapped):
            raise self._dictionary.no_place(
                written.index,
                written.subindex,
                f"the EDS says that it cannot be mapped into a PDO, and no {direction.kind} carries it",
                "check `eds`; another mode may need another object",
            )

    def _cob(self, direction: _Direction, place: int, number: int) -> int:
        drive = self._drive
        if drive.pdo_node:
            return direction.bases[place] + drive.pdo_node
        return direction.bases[(number - 1) % PDOS] + drive.node

    def _switch_off(self, direction: _Direction, number: int) -> None:
        record = direction.communication + number - 1
        if self._dictionary.writable(record, 1):
            cob = direction.bases[number - 1] + self._drive.node | direction.flags
            what = f"{direction.kind}{number} off"
            self.writes.append(SdoWrite(record, 1, unsigned32(INVALID | cob), what, optional=True))

    def _no_pdo(self, direction: _Direction, numbers: Sequence[int]) -> ConfigurationError:
        return self._dictionary.no_place(
            direction.communication + (numbers[-1] if numbers else 0),
            1,
            f"the EDS does not have another {direction.kind} for what the mode needs",
            "check `eds`",
        )
