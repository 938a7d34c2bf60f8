"""Find the axes whose encoder a line needs before it can be interpreted (D-14, D-25)."""

from __future__ import annotations

from mcserver.gcode.profiles.codes import DRILLING, SPLINES, THREADING, TIP_CONTROL
from mcserver.gcode.profiles.frame import LENGTH_AXIS
from mcserver.gcode.semantics.block_state import Setup
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.text.command_table import Kind
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.syntax import Command, Setting
from mcserver.gcode.text.words import INCREMENTAL_LETTERS, Word

# codes that depend on the positions of X, Y and Z: G10 and G92 in a rotated system, where X and Y depend on
# both; G68, which without words rotates about the axes' position; cycles and curves
_FROM_XYZ = frozenset({"G10", "G92", "G68", "REPEAT"}) | DRILLING | SPLINES | THREADING


def find_axes_to_sync(
    parsed: ParsedLine, setup: Setup, modal: ModalState, commanded: CommandedState
) -> frozenset[int]:
    """Return the axes of the line whose path start, or base of increments, is unknown.

    For an arc all of X Y Z count: its plane is chosen later, and an axis too many costs only the wait.
    """
    unsynced = commanded.unsynced
    needed: set[int] = set()
    tool, incremental, motion = modal.tool, modal.incremental, modal.motion
    for group in parsed.groups:
        for command in group:
            tool, incremental = _modes_after(command, tool, incremental)
            kind = None if command.spec is None else command.spec.kind
            if kind is Kind.MOVE and command.spec is not None:
                motion = command.spec.number
            elif kind is Kind.DIRECT and command.spec is not None and command.spec.number == 1020:
                needed |= {axis for axis in _increments(command, incremental) if unsynced.get(axis)}
                continue
            elif not (kind is None and command.moves):
                continue
            acts = command.moves or any(
                isinstance(item, Word) and item.letter in "IJKR" for item in command.items
            )
            if not acts:
                continue
            # a straight rapid starts at the axes' positions, as G01 does
            rapid = motion == 0 and not setup.machine.dialect.straight_rapids
            if tool is not None:
                chain = setup.chains.get(tool, ())
                # a rapid is solved from the commanded joints, whatever stopped them
                needed |= {axis for axis in chain if axis in unsynced and (unsynced[axis] or not rapid)}
            elif rapid:
                needed |= {axis for axis in _increments(command, incremental) if unsynced.get(axis)}
            else:
                named = {item.axis for item in command.items if isinstance(item, Word)}
                if motion in (2, 3):
                    named |= {0, 1, 2}
                needed |= {axis for axis in named if axis in unsynced}
    led = modal.frame is not None and modal.frame.tip_tool is not None
    if modal.frame is not None and modal.frame.plane is not None and parsed.groups:
        # the tool has to be still square to the tilted plane
        facing = modal.frame.plane.facing
        needed |= set() if facing is None else set(facing.turns)
    actions = () if parsed.profile is None else parsed.profile.actions
    codes = {action.code for action in actions}
    if led or codes & (TIP_CONTROL | {"G53.1"}):
        # the tip's position depends on all axes of its tool
        needed |= {axis for chain in setup.chains.values() for axis in chain}
    # the encoder determines offsets, and where G28 starts
    needed |= {word.axis for action in actions for word in action.axes}
    spindle = setup.machine.dialect.spindle
    if codes & {"G28", "G29", "G30"}:
        # the spindle has no target in them, and continues to turn
        needed |= set(unsynced) - {spindle}
    if codes & _FROM_XYZ:
        needed |= {0, 1, 2}
    if codes & {"RETRACT", "RECOVER"}:
        needed |= {setup.machine.dialect.letters["E"], LENGTH_AXIS}
    if spindle is not None and "M19" in codes:
        # it is stopped, and turns to the angle from there
        needed.add(spindle)
    if parsed.groups and modal.frame is not None and modal.frame.cycle is not None and motion is None:
        # a canned cycle starts at its axis's height
        needed |= {0, 1, 2}
    if modal.transformation is not None:
        # a rotation couples axes
        words = (item for group in parsed.groups for command in group for item in command.items)
        needed |= modal.transformation.coupled(
            frozenset(each.axis for each in words if isinstance(each, Word))
        )
    if parsed.profile is not None and parsed.profile.polar:
        needed |= {0, 1}
    needed &= set(unsynced)
    return frozenset(needed)


def _modes_after(command: Command, tool: int | None, incremental: bool) -> tuple[int | None, bool]:
    for item in command.items:
        if isinstance(item, Setting):
            number = item.spec.number
            if number in (90, 91):
                incremental = number == 91
            elif number == 1050:
                tool = None
        elif item.letter == "T" and item.value % 1.0 == 0.0:
            tool = int(item.value)
    return tool, incremental


def _increments(command: Command, incremental: bool) -> set[int]:
    return {
        item.axis
        for item in command.items
        if isinstance(item, Word) and item.axis >= 0 and (incremental or item.letter in INCREMENTAL_LETTERS)
    }
