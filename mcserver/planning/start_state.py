"""What lives outside of a program and decides where and how it starts, in one value.

The planner and `mcserver.simulation` take a program's start from this value alone. A piece of state
that has to count there becomes a field of it, and an approval compares fields: so none can be left out of the
comparison.
"""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from mcserver.gcode.profiles.frame import Frame, tool_table
from mcserver.gcode.semantics.modal import ModalState
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.gcode.text.words import AXIS_LETTERS
from mcserver.machine.dialect_section import CodeWait, Cutter
from mcserver.machine.machine_file import Machine
from mcserver.machine.work_systems import ANGLE, SYSTEM_NUMBERS
from mcserver.motion.canonical import MESH_OF_FILE, MeshUse
from mcserver.units import DEGREE, MM


class PauseEnd(msgspec.Struct, frozen=True):
    """What others have changed while a program stood at a pause.

    Attributes:
        positions: of the axes that stand elsewhere since, by number [m or rad].
        frame: work offsets and tools of then; None: they are those of before.
        line: of the pause. nth: how often the program has paused at this line until then, from 1.
        over: the pause has ended; else the program stood at it still, ahead of all that its line does.
    """

    positions: Mapping[int, float] = {}
    frame: Frame | None = None
    line: int = 0
    nth: int = 0
    over: bool = True


class StartState(msgspec.Struct, frozen=True):
    """Where a program starts.

    Attributes:
        positions: of all axes, by number [m or rad]: the setpoint, or the encoder's of an axis without
        energy.
        energized: axes that hold their position. unsettled: axes that turn, push or still move by
            themselves; one at a speed of 0 does not.
        homed: axes that know where they are.
        frame: work offsets; None: none were ever set.
        modal: state behind the lines before its first; None: a program's own beginning.
        inputs, outputs: values in the order of the machine's.
        pauses: of a program that began so and was recorded: what others changed at its pauses, in order.
        switches: of the operator.
        tool: in the spindle of a machine whose shapers go by it; 0: none, or nobody has said.
        mesh: what holds of the mesh of the bed.
        machine_file, cutters: of a program that began so and was recorded: digest of the machine file
            (`machine_digest`), and the tool table in it.
    """

    positions: Mapping[int, float]
    energized: frozenset[int] = frozenset()
    unsettled: frozenset[int] = frozenset()
    homed: frozenset[int] = frozenset()
    frame: Frame | None = None
    modal: ModalState | None = None
    inputs: tuple[float, ...] = ()
    outputs: tuple[float, ...] = ()
    pauses: tuple[PauseEnd, ...] = ()
    switches: Switches = AS_WRITTEN
    tool: int = 0
    mesh: frozenset[MeshUse] = MESH_OF_FILE
    machine_file: str = ""
    cutters: Mapping[int, Cutter] = {}

    @classmethod
    def of(cls, machine: Machine, frame: Frame | None = None, switches: Switches = AS_WRITTEN) -> StartState:
        """Return the state of a machine that nobody has used: as its file has it, all axes homed."""
        systems = machine.dialect.systems
        return cls(
            positions={axis.index: axis.initial_position for axis in machine.axes},
            homed=frozenset(axis.index for axis in machine.axes),
            frame=Frame(systems=systems) if frame is None and systems else frame,
            inputs=tuple(each.initial for each in machine.inputs),
            outputs=tuple(each.initial for each in machine.outputs),
            switches=switches,
        )

    def at(self, positions: Mapping[int, float]) -> StartState:
        """Return the state with some axes elsewhere [m or rad]."""
        return msgspec.structs.replace(self, positions={**self.positions, **positions})


class Awaited(msgspec.Struct, frozen=True):
    """An input that lines had waited for by ``[dialect.waits]``, while what it answers for has stayed on, or
    off.

    Attributes:
        wait: input and times. outputs: columns that the code had set. spindle: axis that it turned.
    """

    wait: CodeWait
    outputs: frozenset[int]
    spindle: int | None = None


class StateBefore(msgspec.Struct, frozen=True):
    """The state before a line of a program.

    Attributes:
        modal: the modal state. positions: commanded ends [m or rad], by axis number.
        unknown: axes whose place only the encoder gave as the program ran: after a probe, a speed or a torque
            command, or without energy.
        energized: axes that hold a position or follow a command. speeds: of axes under G1030 or the spindle,
            0 where it was stopped [m/s or rad/s]. torques: of axes under G1040 [N·m].
        outputs: values by column. scaled: columns of lasers whose power goes with the speed.
        ended: an M02 or M30 stands before the line. awaited: in the order of the program.
        threads: lines whose axes followed the spindle. mesh: what held of the mesh of the bed.
    """

    modal: ModalState
    positions: Mapping[int, float]
    unknown: frozenset[int]
    energized: frozenset[int]
    speeds: Mapping[int, float]
    torques: Mapping[int, float]
    outputs: Mapping[int, float]
    ended: bool
    scaled: frozenset[int] = frozenset()
    awaited: tuple[Awaited, ...] = ()
    threads: frozenset[int] = frozenset()
    mesh: frozenset[MeshUse] = MESH_OF_FILE


def changes_between(
    machine: Machine,
    before: StartState,
    now: StartState,
    *,
    axes: tuple[int, ...],
    inputs: frozenset[int],
    tolerance: Mapping[int, float],
) -> list[str]:
    """Name what has changed of all that a simulation started from, in sentences for people.

    Args:
        axes: of the program: others play no part. inputs: columns of those that it reads.
        tolerance: how far each axis may be from where it was [m or rad].
    """
    found: list[str] = []
    for axis in axes:
        distance = now.positions[axis] - before.positions[axis]
        if not abs(distance) <= tolerance[axis]:
            found.append(
                f"{axis_word(machine, axis)} stands {_length(machine, axis, distance)} from where it was"
            )
        for name, then, today in (
            ("energized", before.energized, now.energized),
            ("homed", before.homed, now.homed),
            ("moving by itself", before.unsettled, now.unsettled),
        ):
            if (axis in then) != (axis in today):
                found.append(f"{axis_word(machine, axis)} is {'' if axis in today else 'not '}{name} now")
    found += [
        f"{system} {axis} moved by {distance}"
        for system, axis, distance in frame_changes(machine, before.frame, now.frame)
    ]
    if _beyond_systems(before.frame) != _beyond_systems(now.frame) or before.modal != now.modal:
        found.append("the modal state that it starts with is another one")
    then_kept, now_kept = ((each or Frame()).parameters for each in (before.frame, now.frame))
    found += [
        f"the parameter #{number} has another value"
        for number in sorted(then_kept.keys() | now_kept.keys())
        if then_kept.get(number) != now_kept.get(number)
    ]
    if before.tool != now.tool:
        found.append(f"tool {before.tool} was in the spindle, and tool {now.tool} is")
    if before.mesh != now.mesh:
        found.append("another mesh of the bed counts")
    for column, (channel, then_value, value) in enumerate(
        zip(machine.inputs, before.inputs, now.inputs, strict=True)
    ):
        if column in inputs and then_value != value:
            found.append(f'the input "{channel.name}" was {then_value:g} and is {value:g}')
    for output, then_value, value in zip(machine.outputs, before.outputs, now.outputs, strict=True):
        if then_value != value:
            found.append(f'the output "{output.name}" was {then_value:g} and is {value:g}')
    return found


def frame_changes(machine: Machine, before: Frame | None, now: Frame | None) -> list[tuple[str, str, str]]:
    """Return which work coordinate systems are elsewhere, and which tools are others, in words.

    Returns:
        The system, the axis and the distance; ``T3``, ``length`` or ``diameter`` and by how much.
    """
    then = {} if before is None else before.systems
    today = {} if now is None else now.systems
    found = []
    for name, number in SYSTEM_NUMBERS.items():
        for axis in (each.index for each in machine.axes):
            distance = today.get(number, {}).get(axis, 0.0) - then.get(number, {}).get(axis, 0.0)
            if distance:
                found.append((name, axis_word(machine, axis), _length(machine, axis, distance)))
        turn = today.get(number, {}).get(ANGLE, 0.0) - then.get(number, {}).get(ANGLE, 0.0)
        if turn:
            found.append((name, "turned about Z", f"{turn / DEGREE:.6g} deg"))
    had, has = tool_table(machine, before), tool_table(machine, now)
    for tool in sorted(had.keys() | has.keys()):
        was, is_now = had.get(tool, Cutter(0.0)), has.get(tool, Cutter(0.0))
        for word, by in (
            ("length", is_now.length - was.length),
            ("diameter", is_now.diameter - was.diameter),
        ):
            if by:
                found.append((f"T{tool}", word, f"{by / MM:.6g} mm"))
    return found


def axis_word(machine: Machine, axis: int) -> str:
    """Return the letter that programs have for an axis, ``[7]`` without one."""
    letters = {**machine.dialect.letters, **AXIS_LETTERS}
    return next((letter for letter, number in letters.items() if number == axis), f"[{axis}]")


def _beyond_systems(frame: Frame | None) -> Frame:
    return msgspec.structs.replace(frame or Frame(), systems={}, cutters={}, worn=frozenset(), parameters={})


def _length(machine: Machine, axis: int, distance: float) -> str:
    kind = machine.axes[machine.column_of(axis)].type
    return f"{distance / kind.si_per_unit:.6g} {kind.unit}"
