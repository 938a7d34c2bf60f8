"""Read bodies that a program adds: work pieces and fixtures in its comments (D-131).

``(BODY, name, shape, sizes, place)``, followed by ``turned A B C``, ``work``, ``on BODY`` and ``touches
BODY`` in any order, separated by commas.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import msgspec

from mcserver.gcode.line_faults import Span
from mcserver.gcode.notices import bodies_in
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.machine.clearance_section import (
    MOST_GIVEN,
    Body,
    BoxBody,
    CapsuleBody,
    Clearance,
    CylinderBody,
    GivenBody,
    Place,
    SphereBody,
)
from mcserver.machine.section_reader import did_you_mean
from mcserver.units import MM

# Sizes of each shape [mm].
_SIZES = {
    "box": ("X", "Y", "Z"),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "sphere": ("radius",),
}
_FILES = ("stl", "obj", "dae", "mesh")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_LARGEST = 1e6  # mm, as in machine files
_LONGEST_NAME = 60
_WRITTEN = "write (BODY, vise, box, 100 60 40, 150 0 20): name, shape, sizes and the place of its middle [mm]"


class _Field(NamedTuple):
    """Text between two commas, and its columns."""

    text: str
    span: Span


class _Faulty(Exception):
    """A field that cannot be read: code, message, columns and hint."""

    def __init__(self, code: str, message: str, span: Span, hint: str = _WRITTEN) -> None:
        super().__init__(message)
        self.code, self.message, self.span, self.hint = code, message, span, hint


def read_bodies(block: BlockState) -> None:
    """Add a line's bodies to the modal state, or report their faults (MC204 to MC207)."""
    for found in bodies_in(block.parsed.text):
        whole = (found.start() + 1, found.end() + 1)
        try:
            clearance = block.setup.machine.clearance
            if block.parsed.text[found.start(1) - 1] != ",":
                raise _Faulty("MC204", "a comma is missing behind BODY", whole)
            if clearance is None:
                message = "this machine judges no bodies, so that nothing would stay clear of this one"
                hint = "name what moves by [[body]] in the machine file, or [clearance] for a URDF"
                raise _Faulty("MC205", message, whole, hint)
            given = _read(_fields(found.group(1), found.start(1)), whole, block, clearance)
            _add(given, whole, block)
        except _Faulty as fault:
            block.faults.add(fault.code, fault.message, fault.span, fault.hint)


def _add(given: GivenBody, whole: Span, block: BlockState) -> None:
    known = block.modal.bodies
    if given in known:
        # the line is repeated by a loop or subprogram
        return
    if any(each.body.name == given.body.name for each in known):
        message = f"{given.body.name!r} stands already, and is another one"
        raise _Faulty("MC204", message, whole, "give it a name of its own: all stay until the program ends")
    if len(known) >= MOST_GIVEN:
        message = f"more than {MOST_GIVEN} bodies"
        raise _Faulty("MC207", message, whole, "join some of them, or name them in the machine file")
    block.change(bodies=(*known, given))


def _fields(content: str, at: int) -> list[_Field]:
    """Split the text after ``BODY`` at its commas; ``at``: the index of its first character in the line."""
    found = []
    for part in content.split(","):
        text = part.strip(" \t")
        first = at + len(part) - len(part.lstrip(" \t")) + 1
        found.append(_Field(text, (first, first + max(1, len(text)))))
        at += len(part) + 1
    return found


def _read(fields: list[_Field], whole: Span, block: BlockState, clearance: Clearance) -> GivenBody:
    if len(fields) < 2:
        raise _Faulty("MC204", "a body has a name, a shape, sizes and a place", whole)
    name, shape = fields[0], fields[1].text.lower()
    if not 1 <= len(name.text) <= _LONGEST_NAME or not name.text.isprintable():
        raise _Faulty("MC204", f"a name has 1 to {_LONGEST_NAME} characters", name.span)
    if name.text in {each.name for each in (*clearance.bodies, *clearance.zones)}:
        message = f"{name.text!r} is a body or a zone of the machine file"
        raise _Faulty("MC204", message, name.span, "give it another name")
    if shape in _FILES:
        message = "a program reads no files of the server"
        hint = "give a box or a cylinder around it, or a [[body]] with that file in the machine file"
        raise _Faulty("MC206", message, fields[1].span, hint)
    if shape not in _SIZES:
        hint = did_you_mean(shape, tuple(_SIZES), f"take one of {', '.join(_SIZES)}")
        raise _Faulty("MC204", f"there is no shape {fields[1].text!r}", fields[1].span, hint)
    if len(fields) < 4:
        raise _Faulty("MC204", "a body has a name, a shape, sizes and a place", whole)
    names = _SIZES[shape]
    sizes = _numbers(fields[2], f"the sizes of a {shape} are {', '.join(names)} [mm]", len(names))
    if min(sizes) <= 0.0:
        raise _Faulty("MC204", "sizes are above 0", fields[2].span)
    at = _place(fields[3], "a place has X, Y and Z [mm]")
    more: dict[str, Any] = {}
    touches = []
    for field in fields[4:]:
        word, _, rest = field.text.partition(" ")
        match word.lower():
            case "turned" if "turned_deg" not in more:
                angles = _Field(rest, field.span)
                more["turned_deg"] = _place(angles, "a turn has the angles A, B and C [deg]")
            case "work" if not rest:
                at = _in_work_system(at, field.span, block, clearance)
            case "on" if "carried_by" not in more:
                more |= _carrier(rest.strip(), field.span, clearance)
            case "touches":
                touches.append(_touched(rest.strip(), field.span, block, clearance))
            case _:
                hint = "behind the place stand turned A B C, work, on BODY and touches BODY"
                raise _Faulty("MC204", f"{field.text[:40]!r} is not understood", field.span, hint)
    return GivenBody(_shaped(shape, sizes, name=name.text, at_mm=at, **more), tuple(touches))


def _shaped(shape: str, sizes: tuple[float, ...], **more: Any) -> Body:
    match shape:
        case "box":
            return BoxBody(size_mm=(sizes[0], sizes[1], sizes[2]), **more)
        case "cylinder":
            return CylinderBody(radius_mm=sizes[0], length_mm=sizes[1], **more)
        case "capsule":
            return CapsuleBody(radius_mm=sizes[0], length_mm=sizes[1], **more)
    return SphereBody(radius_mm=sizes[0], **more)


def _numbers(field: _Field, what: str, count: int) -> tuple[float, ...]:
    words = field.text.split()
    if len(words) != count or not all(_NUMBER.fullmatch(each) for each in words):
        raise _Faulty("MC204", f"{what}, not {field.text[:40]!r}", field.span)
    found = tuple(float(each) for each in words)
    if max(map(abs, found)) > _LARGEST:
        raise _Faulty("MC204", f"a number is beyond {_LARGEST:.0f}", field.span)
    return found


def _place(field: _Field, what: str) -> Place:
    x, y, z = _numbers(field, what, 3)
    return x, y, z


def _in_work_system(at: Place, span: Span, block: BlockState, clearance: Clearance) -> Place:
    """Convert a place in the work system in force, with G92 and G52, to the base's frame [mm]."""
    frame: Frame | None = block.modal.frame
    if frame is None or block.setup.machine.urdf is not None:
        message = "this machine's bodies stand in the frame of its base alone"
        raise _Faulty("MC204", message, span, "leave out work, and give the place in the base's frame")
    if frame.plane is not None or block.modal.transformation is not None:
        message = "the work system is turned, scaled or tilted"
        raise _Faulty("MC204", message, span, "leave out work, and give the place in the base's frame")
    # a tool's length does not shift the work piece
    shift = msgspec.structs.replace(frame, tool_length=0.0).shift() or {}
    moved = list(at)
    for axis, direction in clearance.letters.items():
        moved[direction] += shift.get(axis, 0.0) / MM
    return moved[0], moved[1], moved[2]


def _carrier(name: str, span: Span, clearance: Clearance) -> dict[str, Any]:
    """Return the carrier of a body that is fixed on one of the machine file."""
    known = {each.name: each for each in clearance.bodies}
    if name not in known:
        hint = did_you_mean(name, tuple(known), "name a [[body]] of the machine file")
        raise _Faulty("MC204", f"there is no body {name!r} to stand on", span, hint)
    carrier = known[name]
    return {
        "link": carrier.link,
        "carried_by": carrier.carried_by,
        "opposite": carrier.opposite,
        "tool": carrier.tool,
    }


def _touched(name: str, span: Span, block: BlockState, clearance: Clearance) -> str:
    """Return the name of a body that may touch this one."""
    known = [*(each.name for each in clearance.bodies), *(each.body.name for each in block.modal.bodies)]
    # links of a URDF are only known when the bodies are built
    if not name or (name not in known and block.setup.machine.urdf is None):
        hint = did_you_mean(name, known, "name a [[body]] of the machine file, or one that stands already")
        raise _Faulty("MC204", f"there is no body {name!r} to touch", span, hint)
    return name
