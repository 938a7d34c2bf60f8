"""Source or target of an input or output: an object of a CANopen node, or a bit of an axis's drive."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Annotated, Literal

import msgspec
from msgspec import Meta

from mcserver.can.cob import GREATEST_NODE, LEAST_NODE
from mcserver.machine.drive import CanDrive
from mcserver.machine.section_reader import Mistakes
from mcserver.machine.toml_positions import Path

if TYPE_CHECKING:
    from mcserver.machine.drive import Drive

ObjectAddress = Annotated[
    str,
    Meta(
        pattern=r"^[0-9A-Fa-f]{4}h?(:[0-9A-Fa-f]{1,2})?$",
        description="index and subindex in hexadecimal digits: '6000h:01', '60FDh:00'",
    ),
]

# Inputs and outputs of a drive (CiA 402), index and subindex; AXIS_OFFSET further for a node's next axis.
DIGITAL_INPUTS, DIGITAL_OUTPUTS = (0x60FD, 0), (0x60FE, 1)
AXIS_OFFSET = 0x800

# Width and sign of objects whose type the machine file may omit (CiA 401, CiA 402).
_KNOWN_TYPES = {
    0x6000: "u8",
    0x6100: "u16",
    0x6120: "u32",
    0x6200: "u8",
    0x6300: "u16",
    0x6320: "u32",
    0x6400: "i8",
    0x6401: "i16",
    0x6402: "i32",
    0x6403: "f32",
    0x6410: "i8",
    0x6411: "i16",
    0x6412: "i32",
    0x6413: "f32",
    0x60FD: "u32",
    0x60FE: "u32",
}
ObjectType = Literal["u8", "u16", "u32", "i8", "i16", "i32", "f32"]


class IoObjectSection(msgspec.Struct, frozen=True):
    """``source`` and ``target``: an object of a CANopen node, or a bit of an axis's drive (60FDh, 60FEh)."""

    bus: Annotated[str, Meta(min_length=1, description="name a bus of this file")] | None = None
    node: (
        Annotated[int, Meta(ge=LEAST_NODE, le=GREATEST_NODE, description="give the node's number")] | None
    ) = None
    object: ObjectAddress | None = None
    drive: Annotated[int, Meta(ge=0, le=63, description="give the number of an axis")] | None = None
    bit: Annotated[int, Meta(ge=0, le=31, description="0 is the least significant bit")] | None = None
    type: ObjectType | None = None


class IoObject(msgspec.Struct, frozen=True):
    """An object of a CANopen node, or one bit of it.

    Attributes:
        bus: name of the bus. bit: None if the whole object is one value.
        type: of the whole object. axis: with this drive; -1: a node without a drive.
    """

    bus: str
    node: int
    index: int
    subindex: int
    type: ObjectType
    bit: int | None = None
    axis: int = -1

    @property
    def shown(self) -> str:
        """Return a name for people: ``can0 node 5 6000h:01 bit 3``, ``drive of axis 2 bit 17``."""
        if self.axis >= 0:
            return f"drive of axis {self.axis} bit {self.bit}"
        bit = "" if self.bit is None else f" bit {self.bit}"
        return f"{self.bus} node {self.node} {self.index:04X}h:{self.subindex:02X}{bit}"


def _of_drive(
    section: IoObjectSection,
    digital: bool,
    path: Path,
    drives: Mapping[int, Drive],
    place: tuple[int, int],
    mistakes: Mistakes,
) -> IoObject | None:
    """Return a bit of 60FDh or 60FEh of an axis's drive; ``place``: index and subindex."""
    for key in ("bus", "node", "object", "type"):
        if getattr(section, key) is not None:
            mistakes.add((*path, key), "follows from drive", "leave it out")
    drive = drives.get(section.drive if section.drive is not None else -1)
    if not isinstance(drive, CanDrive) or not drive.has_pins:
        what = "there is no such axis" if drive is None else f"its drive is of kind {drive.kind!r}"
        mistakes.add((*path, "drive"), what, 'name an axis whose drive has kind = "cia402"')
        return None
    if not digital or section.bit is None:
        mistakes.add(path, "a drive's input or output is a bit", "give bit, and leave kind out")
        return None
    index = place[0] + AXIS_OFFSET * drive.place[1]
    return IoObject(drive.bus, drive.node, index, place[1], "u32", section.bit, section.drive or 0)


def read_object(
    section: IoObjectSection | None,
    digital: bool,
    path: Path,
    known: tuple[Collection[str], Mapping[int, Drive]],
    of_drives: tuple[int, int],
    mistakes: Mistakes,
) -> IoObject | None:
    """Return the object of a source or target; None after a mistake, or if none is given.

    Args:
        known: names of the file's buses; drives by axis. of_drives: index and subindex in a drive.
    """
    buses, drives = known
    if section is None:
        return None
    if section.drive is not None:
        return _of_drive(section, digital, path, drives, of_drives, mistakes)
    if section.bus is None or section.node is None or section.object is None:
        missing = next(key for key in ("bus", "node", "object") if getattr(section, key) is None)
        hint = "give bus, node and object of a node, or drive = the axis whose drive has it"
        mistakes.add((*path, missing), "is missing", hint)
        return None
    index_text, _, sub_text = section.object.replace("h", "").partition(":")
    index, subindex = int(index_text, 16), int(sub_text or "0", 16)
    if section.bus not in buses:
        there = ", ".join(sorted(buses)) or "none"
        mistakes.add(
            (*path, "bus"), f'the file has no bus "{section.bus}"', f"add a [[bus]]; there is {there}"
        )
    kind = section.type or _KNOWN_TYPES.get(index)
    if kind is None:
        mistakes.add((*path, "object"), "is not an object whose type is known", 'add its type = "u16"')
        kind = "u32"
    width = int(kind[1:])
    if digital and section.bit is None:
        mistakes.add(path, "a digital one is a bit of its object", "add bit = 0")
    elif not digital and section.bit is not None:
        mistakes.add((*path, "bit"), "belongs to a digital one", "leave it out")
    elif section.bit is not None and (section.bit >= width or kind == "f32"):
        mistakes.add((*path, "bit"), f"{section.bit} is no bit of an object of type {kind}", "")
    return IoObject(section.bus, section.node, index, subindex, kind, section.bit)  # type: ignore[arg-type]
