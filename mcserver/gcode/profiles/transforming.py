"""Read G68, G69, G50, G51, G50.1, G51.1, G15 and G16, and refuse what conflicts with them (D-94 to D-96)."""

from __future__ import annotations

import math

import msgspec

from mcserver.gcode.profiles.codes import PROBING, THREADING
from mcserver.gcode.profiles.transformation import Polar, Rotation, Scaling, Transformation
from mcserver.gcode.semantics.arc_plane import OFFSET_LETTERS, PLANES
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.semantics.program_units import length_scale
from mcserver.gcode.text.profile_words import Action, ProfileWord, ProfileWords
from mcserver.machine.work_systems import SYSTEM_NUMBERS
from mcserver.units import AxisType

# whole factors from here on are thousandths (Fanuc); smaller ones could be plain factors (Haas)
LEAST_THOUSANDTHS = 100.0
LEAST_FACTOR, GREATEST_FACTOR = 0.001, 1000.0
_ZEROS = SYSTEM_NUMBERS.keys() | {"G52", "G92", "G92.1", "G92.2", "G92.3"}
_ENDS = {"G69": "rotation", "G50": "scaling", "G50.1": "scaling", "G15": "polar"}


def refuse_beside(block: BlockState, profile: ProfileWords) -> None:
    """Report actions that conflict with what is in force after a line (MC185)."""
    codes = {action.code for action in profile.actions}
    ended = {part: None for code, part in _ENDS.items() if code in codes}
    found = msgspec.structs.replace(
        block.transformation, **ended, tilted=block.transformation.tilted and "G69" not in codes
    )
    for action in profile.actions:
        code = action.code
        named = {word.axis for word in action.axes}
        what = ""
        same = SYSTEM_NUMBERS.get(code) == block.frame.system
        zero = (code in _ZEROS and not same) or (code == "G10" and not _of_tools(action))
        if zero:
            turned = found.scaling is not None or found.rotation is not None or found.tilted
            what = "another zero" if turned else ""
        elif code in PROBING | THREADING:
            three = {0, 1, 2} if code == "G76" else named
            along = found.changed if code in PROBING and not found.tilted else found.axes
            what = code if along & three or (found.tilted and code in PROBING) else ""
        if what:
            _refuse(block, action, what, found)


def _refuse(
    block: BlockState, action: Action, what: str, found: Transformation, names: str | None = None
) -> None:
    message = f"{what} does not go together with {names or found.names}"
    block.faults.add("MC185", message, action.span, f"end that by {found.enders} first")


def _of_tools(action: Action) -> bool:
    return "L" in action.words and action.words["L"].value == 1.0


def end_transformation(block: BlockState, action: Action, beside: frozenset[str]) -> None:
    """Execute G69, G50, G15 and G16, which have no axis words.

    Args:
        beside: codes of the same line.
    """
    found, code = block.transformation, action.code
    if code == "G16":
        plane = PLANES[block.modal.plane or 17]
        if linear(block, action, plane):
            block.transformation = msgspec.structs.replace(
                found, polar=Polar(plane), unsettled=found.unsettled.union(plane)
            )
        return
    part = getattr(found, _ENDS[code])
    if part is None:
        return
    if isinstance(part, Scaling):
        if part.code != "G51":
            # its mirrors stay in force
            return
        if found.rotation is not None and "G69" not in beside:
            _refuse(block, action, code, msgspec.structs.replace(found, scaling=None))
            return
    freed = frozenset(part.factors if isinstance(part, Scaling) else part.plane)
    settled = found.unsettled if code == "G15" else found.unsettled | freed
    block.transformation = msgspec.structs.replace(found, **{_ENDS[code]: None}, unsettled=settled)


def read_polar_line(block: BlockState) -> None:
    """Read X and Y of this line as radius and angle, relative to where the axes are (@ and ^, LinuxCNC)."""
    whole = (1, len(block.parsed.text) + 1)
    axes = [block.setup.axes.get(axis) for axis in (0, 1) if axis in block.setup.leased]
    if block.modal.transformation is not None and block.transformation != Transformation(
        directions=block.transformation.directions
    ):
        what = "@ and ^ do not go together with G68, G51 and G16, nor with the move behind them"
        block.faults.add("MC185", what, whole, "write X and Y")
        return
    if [axis.type for axis in axes if axis is not None] != [AxisType.LINEAR, AxisType.LINEAR]:
        block.faults.add("MC188", "@ and ^ are for the linear axes X and Y", whole, "write the axes' words")
        return
    reads = block.frame.coordinates(block.commanded.positions)
    x, y = (reads.get(axis, 0.0) for axis in (0, 1))
    polar = Polar((0, 1), math.hypot(x, y), math.degrees(math.atan2(y, x)), of_line=True)
    block.transformation = msgspec.structs.replace(block.transformation, polar=polar)


def transform(block: BlockState, action: Action) -> None:
    """Execute the codes with words of their own, after the line's settings, and check G16 again."""
    code = action.code
    if code == "G16":
        if block.modal.incremental:
            block.faults.add(
                "MC188",
                "under G91 controllers count the radius of G16 from different places",
                action.span,
                "write G90 G16; G52 puts the program's zero elsewhere",
            )
    elif code == "G68":
        _rotate(block, action)
    elif code == "G50.1":
        _unmirror(block, action)
    elif code in ("G51", "G51.1"):
        _scale(block, action)


def _rotate(block: BlockState, action: Action) -> None:
    found, plane = block.transformation, PLANES[block.modal.plane or 17]
    angle = action.words.get("R")
    _only(block, action, "R", frozenset(plane))
    if angle is None:
        block.faults.add("MC118", "G68 has no R: the angle", action.span, "such as G68 X0 Y0 R30")
    scaling = found.scaling
    if found.tilted:
        # G69 ends both
        _refuse(block, action, "G68", found)
    if found.polar is not None or (scaling is not None and found.mirrors(plane)):
        _refuse(block, action, "G68", found, "G16" if found.polar else f"{found.names}, which mirrors")
    if scaling is not None and not found.keeps_circles(plane):
        block.faults.add(
            "MC185",
            "G68 does not go together with unequal factors",
            action.span,
            "let the CAM rotate the part",
        )
    centre = _places(block, action, frozenset(plane))
    if not action.axes and found.rotation is None and not found.unsettled.intersection(plane):
        shift, at = block.modal.shift or {}, block.commanded.positions
        centre = found.undone({axis: at[axis] - shift.get(axis, 0.0) for axis in range(3) if axis in at})
    elif len(centre) < len(plane):
        block.faults.add(
            "MC188",
            "G68 does not say where its centre is",
            action.span,
            "give both axes, such as G68 X0 Y0 R30",
        )
    if block.faults.found or angle is None or not linear(block, action, plane):
        return
    degrees = angle.value
    if block.modal.incremental and found.rotation is not None:
        degrees += found.rotation.degrees
    unturned = msgspec.structs.replace(found, rotation=None, directions=None).applied(centre)
    block.transformation = msgspec.structs.replace(
        found,
        rotation=Rotation(plane, (unturned[plane[0]], unturned[plane[1]]), degrees),
        unsettled=found.unsettled.union(plane),
    )


def _scale(block: BlockState, action: Action) -> None:
    """Set the scaling of G51 with P or I J K, or the mirrors of G51.1."""
    found, code, words = block.transformation, action.code, action.words
    letters = "P" + OFFSET_LETTERS if code == "G51" else ""
    _only(block, action, letters, frozenset({0, 1, 2}))
    if found.rotation is not None or found.polar is not None:
        _refuse(block, action, code, msgspec.structs.replace(found, scaling=None))
    elif found.scaling is not None and found.scaling.code != code:
        _refuse(block, action, code, found)
    if block.modal.incremental:
        block.faults.add(
            "MC188",
            f"under G91 controllers read the centre of {code} differently",
            action.span,
            "write G90 ahead",
        )
    centres = _places(block, action, frozenset({0, 1, 2}))
    before = found.scaling if code == "G51.1" else None
    factors = dict.fromkeys(centres, -1.0)
    if code == "G51":
        read = {letter: _factor(block, words[letter]) for letter in letters if letter in words}
        factors = dict.fromkeys((0, 1, 2), read["P"]) if "P" in read else {}
        factors |= {axis: read[letter] for axis, letter in enumerate(OFFSET_LETTERS) if letter in read}
    if not factors or factors.keys() != centres.keys():
        block.faults.add(
            "MC188",
            f"{code} needs "
            + ("the place of the mirror" if code == "G51.1" else "centre and factor of each axis"),
            action.span,
            "such as G51.1 X0"
            if code == "G51.1"
            else "P scales X, Y and Z: G51 X0 Y0 Z0 P1.5; I, J and K one each: G51 X0 Y0 I1.5 J1.5",
        )
    if block.faults.found or not linear(block, action, tuple(factors)):
        return
    if before is not None:
        factors, centres = {**before.factors, **factors}, {**before.centres, **centres}
    changed = frozenset(factors) | frozenset(() if found.scaling is None else found.scaling.factors)
    block.transformation = msgspec.structs.replace(
        found, scaling=Scaling(code, factors, centres), unsettled=found.unsettled | changed
    )


def _factor(block: BlockState, word: ProfileWord) -> float:
    """Return a factor; whole numbers that cannot be plain factors are thousandths."""
    factor = word.value
    if "." not in word.text:
        if abs(factor) < LEAST_THOUSANDTHS:
            block.faults.add(
                "MC188",
                f"{word.letter}{word.text} is a factor on some controllers, and thousandths on others",
                word.span,
                f"write {word.letter}{word.text}.0, or thousandths from {LEAST_THOUSANDTHS:g} on",
            )
            return 1.0
        factor /= 1000.0
    if not LEAST_FACTOR <= abs(factor) <= GREATEST_FACTOR:
        block.faults.add(
            "MC116",
            f"{word.letter}{word.text} is no factor from {LEAST_FACTOR:g} to {GREATEST_FACTOR:g}",
            word.span,
            "a negative one mirrors",
        )
    return factor


def _unmirror(block: BlockState, action: Action) -> None:
    """Remove the mirrors of the named axes, or all (G50.1)."""
    found = block.transformation
    scaling = found.scaling
    named = frozenset(word.axis for word in action.axes)
    _only(block, action, "", frozenset({0, 1, 2}))
    if scaling is None or scaling.code != "G51.1":
        return
    if found.rotation is not None:
        _refuse(block, action, "G50.1", msgspec.structs.replace(found, scaling=None))
        return
    gone = frozenset(scaling.factors) & (named or frozenset(scaling.factors))
    kept = {axis: factor for axis, factor in scaling.factors.items() if axis not in gone}
    block.transformation = msgspec.structs.replace(
        found,
        scaling=msgspec.structs.replace(scaling, factors=kept) if kept else None,
        unsettled=found.unsettled | gone,
    )


def _only(block: BlockState, action: Action, letters: str, axes: frozenset[int]) -> None:
    """Report words that a code does not take (MC112)."""
    for word in (*action.words.values(), *action.axes):
        own = word.letter in letters or word.letter in "ST" if word.axis < 0 else word.axis in axes
        if not own and (word.axis >= 0 or word.letter in OFFSET_LETTERS + "R"):
            block.faults.add("MC112", f"{action.code} does not take {word.letter}", word.span, "take it out")


def _places(block: BlockState, action: Action, axes: frozenset[int]) -> dict[int, float]:
    """Return an action's axis words as coordinates in the program's zero [m]."""
    found: dict[int, float] = {}
    for word in action.axes:
        if word.axis in found:
            block.refuse_twice(word)
        elif word.axis in axes:
            found[word.axis] = word.value * length_scale(block.modal.inch)
    return found


def linear(block: BlockState, action: Action, axes: tuple[int, ...]) -> bool:
    """Return whether the program may use these axes and all are linear; report others."""
    found = [block.usable_axis(axis, action) for axis in axes]
    rotary = [axis.index for axis in found if axis is not None and axis.type is not AxisType.LINEAR]
    if rotary:
        block.faults.add(
            "MC188", f"{action.code} is for linear axes: axis {rotary[0]} is rotary", action.span, ""
        )
    return not rotary and None not in found
