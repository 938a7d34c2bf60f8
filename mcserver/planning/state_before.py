"""Rebuild the machine's state before a line of a program from the text alone, without motion."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice

import msgspec
import numpy as np
from mckinematics.pose import Kinematics

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.computing.machine_values import Source
from mcserver.gcode.computing.macro_expansion import expansion_of
from mcserver.gcode.profiles.codes import SPINDLE
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.interpreter import Interpreter, without_pause
from mcserver.gcode.text.line_window import LineWindow
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.profile_words import Action
from mcserver.machine.dialect_section import Dialect
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import (
    AxisLine,
    Canonical,
    DwellGroup,
    Group,
    MeshLine,
    MotionLine,
    OutputLine,
    PathBatch,
    PauseLine,
    ProbeLine,
    SpeedGroup,
    ThreadLine,
    TorqueGroup,
)
from mcserver.planning.start_state import Awaited, PauseEnd, StartState, StateBefore


class _Pauses:
    """Changes by others at the pauses of a program, applied as lines are read."""

    def __init__(self, interpreter: Interpreter, ends: Iterable[PauseEnd]) -> None:
        self._interpreter = interpreter
        self._ends = {(each.line, each.nth): each for each in ends}
        self._line, self._nth = 0, 0

    def passed(self, values: Iterable[Canonical]) -> None:
        """Apply the changes at the pauses among some values."""
        for value in values:
            if isinstance(value, PauseLine):
                self._nth = self._nth + 1 if value.line == self._line else 1
                self._line = value.line
                end = self._ends.get((self._line, self._nth))
                if end is not None and end.over:
                    self._interpreter.end_pause(end.positions, end.frame)

    def stood_at(self, line: int) -> None:
        """Apply the changes at a pause before a line at which the program ended."""
        for end in self._ends.values():
            if end.line == line and not end.over:
                self._interpreter.end_pause(end.positions, end.frame)


class _Effects:
    """Effects of lines on axes and outputs, accumulated value by value."""

    def __init__(self, origin: StartState) -> None:
        self.energized = set(origin.energized)
        self.unknown: set[int] = set()
        # axes whose position follows from the text
        self.placed: set[int] = set()
        self.speeds: dict[int, float] = {}
        self.torques: dict[int, float] = {}
        self.outputs = dict(enumerate(origin.outputs))
        self.scaled: set[int] = set()
        self.threads: set[int] = set()
        self.mesh = origin.mesh
        # by the code that waited; waits without an output or spindle are under ""
        self.awaited: dict[str, Awaited] = {}

    def wait(self, actions: Iterable[Action], dialect: Dialect) -> None:
        """Note what the codes of a line wait for, after what they set."""
        for action in actions:
            code, wait = action.code, dialect.waits.get(action.code)
            if code in SPINDLE or code == "M19":
                for each in SPINDLE:
                    self.awaited.pop(each, None)
            if wait is None:
                continue
            outputs = frozenset(each.column for each in dialect.outputs.get(code, ()))
            key = code if outputs or code in SPINDLE else ""
            self.awaited.pop(key, None)
            self.awaited[key] = Awaited(wait, outputs, dialect.spindle if code in SPINDLE else None)

    def take(self, value: Canonical | PathBatch, *, incremental: bool) -> None:
        """Apply a value; ``incremental``: the ends of its moves are increments."""
        if isinstance(value, AxisLine):
            if value.operation.energized:
                self.energized.update(value.axes)
            else:
                if value.operation.energized is False:
                    self.energized.difference_update(value.axes)
                self._lose(value.axes)
        elif isinstance(value, PathBatch):
            self._place(value.axes, incremental=incremental)
            if value.outputs is not None:
                given = value.outputs.values[np.isfinite(value.outputs.values)]
                for column, scaled in value.outputs.outputs if given.size else ():
                    self._set(column, float(given[-1]), scaled=scaled)
        elif isinstance(value, MotionLine):
            for group in value.groups:
                self._group(group, incremental=incremental)
        elif isinstance(value, ProbeLine):
            self._lose(value.axes)
        elif isinstance(value, MeshLine):
            self.mesh = value.use.behind(self.mesh)
        elif isinstance(value, ThreadLine):
            self.threads.add(value.line)
            self._place(value.axes, incremental=incremental)
        elif isinstance(value, OutputLine):
            for each in value.settings:
                self._set(each.column, each.value, scaled=each.scaled)

    def _set(self, column: int, value: float, *, scaled: bool) -> None:
        if bool(value) is not bool(self.outputs.get(column)):
            # a wait for a heater to be hot no longer counts once the heater is off
            gone = [code for code, each in self.awaited.items() if column in each.outputs]
            for code in gone:
                del self.awaited[code]
        self.outputs[column] = value
        (self.scaled.add if scaled and value else self.scaled.discard)(column)

    def _group(self, group: Group, *, incremental: bool) -> None:
        if isinstance(group, DwellGroup):
            return
        self.energized.update(group.axes)
        if not isinstance(group, SpeedGroup | TorqueGroup):
            self._place(group.axes, incremental=incremental)
            return
        self._lose(group.axes)
        if isinstance(group, SpeedGroup):
            self.speeds.update(zip(group.axes, group.velocities, strict=True))
        else:
            self.torques.update(zip(group.axes, group.torques, strict=True))

    def _place(self, axes: tuple[int, ...], *, incremental: bool) -> None:
        for axis in axes:
            self.speeds.pop(axis, None)
            self.torques.pop(axis, None)
        if not incremental:
            self.unknown.difference_update(axes)
            self.placed.update(axes)

    def _lose(self, axes: tuple[int, ...]) -> None:
        self.unknown.update(axes)
        for axis in axes:
            self.speeds.pop(axis, None)
            self.torques.pop(axis, None)


def state_before(
    lines: Iterable[str],
    number: int,
    machine: Machine,
    origin: StartState,
    *,
    kinematics: Kinematics | None = None,
    lease: frozenset[int] | None = None,
) -> StateBefore:
    """Rebuild the state before line ``number`` of a program from the lines before it.

    Args:
        lines: the whole program, or at least the lines before ``number``. number: from 1.
        origin: the machine as the program began. lease: its axes; None: all.

    Raises:
        ProgramRejected: a line before it has a fault; MC167 the line stands in a block of O-words,
            or under cutter compensation; MC347 an axis follows another one there; MC168 a line before it went
            by what was measured.
    """
    interpreter = Interpreter(
        machine,
        kinematics=kinematics,
        positions=origin.positions,
        lease=lease,
        frame=origin.frame,
        switches=origin.switches,
    )
    effects = _Effects(origin)
    pauses = _Pauses(interpreter, origin.pauses)
    window = LineWindow(islice(lines, number - 1))
    expansion = expansion_of(interpreter, Source.NOWHERE)
    while not window.ended and not interpreter.ended:
        at = window.done + 1
        most = interpreter.batch_window(at) if expansion.idle else 0
        incremental = interpreter.modal.incremental
        run = interpreter.interpret_batch(window.peek(most), at) if most else None
        if run is not None:
            for line in run.values:
                effects.take(line, incremental=incremental or run.modal.incremental)
            expansion.passed(window.peek(run.taken), at)
            window.drop(run.taken)
            continue
        expansion.take(window.peek(1)[0], at)
        window.drop(1)
        while expansion.running and not interpreter.ended:
            parsed = expansion.next()
            if not isinstance(parsed, ParsedLine):
                continue
            capture = interpreter.capture_before(parsed)
            if capture is not None:
                effects.take(capture, incremental=False)
            pause = interpreter.pause_before(parsed)
            pauses.passed(pause)
            values = interpreter.interpret(parsed)
            expansion.measured.interpreted(values)
            pauses.passed(without_pause(values) if pause else values)
            polar = parsed.profile is not None and parsed.profile.polar
            for value in values:
                effects.take(value, incremental=polar or interpreter.modal.builds_on_places)
            if parsed.profile is not None:
                effects.wait(parsed.profile.actions, machine.dialect)
    pauses.stood_at(number)
    compensation, modal = interpreter.compensation, interpreter.modal
    if compensation is not None:
        raise _not_here(
            "MC167",
            number,
            f"cutter compensation is on here, since line {compensation.line}",
            f"start at line {compensation.line}, or behind the move that leads out",
        )
    if modal.coupled:
        follower, since = modal.coupled[0]
        raise _not_here(
            "MC347",
            number,
            f"axis {follower} follows another one here, since line {since}",
            f"start at line {since}, or behind the G1061 that ends it",
        )
    surface = None if modal.frame is None else modal.frame.surface
    spindle = machine.dialect.spindle
    if surface is not None and spindle is not None and effects.speeds.get(spindle):
        raise _not_here(
            "MC167",
            number,
            f"the radius leads the spindle here, since line {surface.line} (G96)",
            f"start at line {surface.line}, or behind G97",
        )
    if spindle is not None and spindle not in effects.placed and spindle not in effects.speeds:
        # the position of a spindle is undefined before M19 or a word that names it
        effects.energized.discard(spindle)
    if not interpreter.ended:
        modal = msgspec.structs.replace(modal, computed=expansion.kept())
    if modal.frame is not None or expansion.lasting:
        # what the program sets itself is what differs from these
        frame = msgspec.structs.replace(modal.frame or Frame(), parameters=expansion.lasting)
        modal = msgspec.structs.replace(modal, frame=frame)
    return StateBefore(
        modal=modal,
        positions=interpreter.positions,
        unknown=frozenset(effects.unknown),
        energized=frozenset(effects.energized),
        speeds=effects.speeds,
        torques=effects.torques,
        outputs=effects.outputs,
        scaled=frozenset(effects.scaled),
        ended=interpreter.ended,
        awaited=tuple(effects.awaited.values()),
        threads=frozenset(effects.threads),
        mesh=effects.mesh,
    )


def _not_here(code: str, line: int, message: str, hint: str) -> ProgramRejected:
    return ProgramRejected([Diagnostic(code=code, line=line, message=message, hint=hint)])
