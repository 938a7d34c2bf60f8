"""The mesh of a printer's bed: Marlin's G29 and M420, Klipper's BED_MESH macros (D-144)."""

from __future__ import annotations

import re
from collections.abc import Mapping, Set

from mcserver.gcode.line_faults import FaultList, Span
from mcserver.gcode.profiles.cycle_motion import CycleMotion
from mcserver.gcode.semantics.block_state import BlockState
from mcserver.gcode.text.profile_words import Action, ProfileWord
from mcserver.machine.axis import Axis
from mcserver.machine.coupled_errors import Mesh
from mcserver.motion.canonical import Canonical, MeshLine, MeshUse, ProbeKind, ProbeLine

# P1 of Marlin's unified bed leveling probes, X Y W H C say where: here it is the whole bed
_WORDS = {"G29": "PXYWHC", "M420": "SVT"}
# P3 fills in points that were not probed: there are none
_USES: Mapping[str, Mapping[float, MeshUse | None]] = {
    "P": {1.0: MeshUse.MET, 3.0: None, 3.1: None, 3.2: None, 3.13: None},
    "S": {0.0: MeshUse.OFF, 1.0: MeshUse.ON},
}
_PARAMETER = re.compile(r"[ \t]+([A-Z_]+)[ \t]*=[ \t]*([^ \t=]+)")
# what Klipper's macros may say: where its points are and what is made of them, which the machine file says
_CALIBRATE = frozenset(
    {"PROFILE", "ADAPTIVE", "ADAPTIVE_MARGIN", "MESH_MIN", "MESH_MAX", "PROBE_COUNT", "ALGORITHM"}
)
_MACROS: Mapping[str, Set[str]] = {
    "BED_MESH_CALIBRATE": _CALIBRATE,
    "BED_MESH_CLEAR": frozenset[str](),
    "BED_MESH_PROFILE": {"LOAD"},
}


def bed_mesh_macro(name: str, code: str, span: Span, faults: FaultList) -> Action | None:
    """Return a line of Klipper's as the action of Marlin's that does it; None: it does nothing here.

    Args:
        span: of its name. faults: parameters that it does not take are reported there.
    """
    taken, given = _MACROS.get(name), _PARAMETER.findall(code, span[1] - 1)
    if taken is None or (name == "BED_MESH_PROFILE" and {each for each, _ in given} & {"SAVE", "REMOVE"}):
        return None
    rest = _PARAMETER.sub("", code[span[1] - 1 :]).strip()
    if rest or not {each for each, _ in given} <= taken:
        hint = f"it takes {', '.join(sorted(taken)) or 'nothing'}"
        faults.add("MC113", f"{name} does not take this", (span[1] + 1, len(code.rstrip()) + 1), hint)
        return None
    if name == "BED_MESH_CALIBRATE":
        return Action("G29", span, {})
    on = float(name == "BED_MESH_PROFILE")
    if on and not given:
        faults.add("MC113", f"{name} says nothing to be done", span, "give LOAD=NAME")
        return None
    return Action("M420", span, {"S": ProfileWord("S", on, f"{on:g}", -1, span)})


def set_bed_mesh(block: BlockState, action: Action) -> list[Canonical]:
    """Carry out G29 and M420; faults are reported."""
    use = _use(block, action)
    number = block.setup.machine.dialect.mesh_axis
    axis = None if number is None else block.usable_axis(number, action)
    # without a mesh these codes do not act
    mesh = None if axis is None or axis.compensation is None else axis.compensation.mesh
    if use is None or axis is None or mesh is None:
        return []
    if any(block.usable_axis(each, action) is None for each in mesh.axes):
        return []
    if use is MeshUse.MET:
        return _probed(block, axis, mesh)
    return [MeshLine(block.parsed.number, use, (*mesh.axes, axis.index))]


def _use(block: BlockState, action: Action) -> MeshUse | None:
    """Return what a line does; None: nothing, or it has a fault."""
    words, taken = action.words, _WORDS[action.code]
    if words.keys() == {"A"} and action.code == "G29":
        return MeshUse.ON
    for word in words.values():
        if word.letter not in taken:
            hint = f"it takes {' '.join(taken)}; points and heights are those of the machine file"
            block.faults.add("MC113", f"{action.code} takes no {word.letter}", word.span, hint)
    letter = "P" if action.code == "G29" else "S"
    chosen = words.get(letter)
    if block.faults.found or chosen is None:
        return MeshUse.MET if letter == "P" and not block.faults.found else None
    # firmware differs in what a letter without its number is
    bare = chosen.span[1] - chosen.span[0] == 1
    if bare or chosen.value not in _USES[letter]:
        said = f"{letter} without a number" if bare else f"{letter}{chosen.text}"
        hint = f"give {' or '.join(f'{letter}{value:g}' for value in _USES[letter])}"
        block.faults.add("MC116", f"{action.code} {said} is not done here", chosen.span, hint)
        return None
    return _USES[letter][chosen.value]


def _probed(block: BlockState, of: Axis, mesh: Mesh) -> list[Canonical]:
    """Return the way over the points and down at each, row by row, there and back."""
    probe, axis, (along, across) = mesh.probe, of.index, mesh.axes
    assert probe is not None
    motion, number = CycleMotion(block), block.parsed.number
    # a Z that goes to a height of its own is lifted no longer, as by G28
    block.frame = block.frame.unlifted
    if block.commanded.positions[axis] < probe.above:
        motion.rapid({axis: probe.above})
    length = probe.above - probe.deepest
    for row, second in enumerate(mesh.second):
        for first in mesh.first[:: 1 if row % 2 == 0 else -1]:
            motion.rapid({along: first - probe.offset[0], across: second - probe.offset[1]})
            motion.rapid({axis: probe.above})
            motion.lines.append(
                ProbeLine(
                    line=number,
                    kind=ProbeKind.TOWARDS,
                    axes=(axis,),
                    targets=(probe.deepest,),
                    speed=min(probe.speed, of.max_velocity),
                    requested=length / probe.speed,
                    length=length,
                    mesh=True,
                )
            )
            block.end_at(axis, probe.deepest)
            motion.rapid({axis: probe.above})
    motion.lines.append(MeshLine(number, MeshUse.MET, (*mesh.axes, axis)))
    return motion.lines
