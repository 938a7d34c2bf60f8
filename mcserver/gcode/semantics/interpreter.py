"""Interpret parsed lines as canonical motion, with modal state between them."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence

import msgspec
from mckinematics.pose import Kinematics

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.fast_path.batches import MAX_LINES, BatchInterpreter
from mcserver.gcode.fast_path.interpreted_batch import InterpretedBatch
from mcserver.gcode.notices import bodies_in
from mcserver.gcode.profiles.codes import COMPENSATING, MOVING, PRINTER_STOPS
from mcserver.gcode.profiles.diameters import counts_diameters, in_radii
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.profiles.reader import reader_of
from mcserver.gcode.semantics.arc_plane import PLANES
from mcserver.gcode.semantics.block_interpreter import BlockInterpreter, faults_of
from mcserver.gcode.semantics.block_state import BlockState, set_up
from mcserver.gcode.semantics.commanded_state import CommandedState
from mcserver.gcode.semantics.compensation import compensate, release
from mcserver.gcode.semantics.compensation_state import Compensation
from mcserver.gcode.semantics.modal import INITIAL, ModalState, initial_modal, with_tables
from mcserver.gcode.semantics.position_sync import find_axes_to_sync
from mcserver.gcode.semantics.program_bodies import read_bodies
from mcserver.gcode.semantics.tip_moves import tip_coordinates
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.gcode.text.command_table import Kind
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.words import Word
from mcserver.machine.dialect_section import Dialect
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import AxisLine, AxisOperation, Canonical, OutputLine, PauseLine


class Interpreter:
    """The interpreter of one program: its modal state and commanded positions (D-10).

    Args:
        machine: has the axes and tools that the program names.
        kinematics: of its tools; None where it has none.
        positions: commanded positions at the start [m or rad]; the drives' initial ones by default.
        lease: axes that the program may use; all by default.
        modal: state to start from, for a program that goes on from its middle.
        frame: work offsets to start from where ``modal`` is None (D-62).
        machine_coordinates: read lines as the reference has them, in positions of the axes whatever the
            machine's profile and ``frame`` say, until `begin_program`.
        switches: of the operator (D-98); block delete is for who reads the text (`Switches.read`).
    """

    def __init__(
        self,
        machine: Machine,
        *,
        kinematics: Kinematics | None = None,
        positions: Mapping[int, float] | None = None,
        lease: frozenset[int] | None = None,
        modal: ModalState | None = None,
        frame: Frame | None = None,
        machine_coordinates: bool = False,
        switches: Switches = AS_WRITTEN,
    ) -> None:
        self._setup = set_up(machine, kinematics, lease, switches)
        initial = {axis.index: axis.initial_position for axis in machine.axes}
        self._commanded = CommandedState({**initial, **(positions or {})})
        self._modal = initial_modal(machine, frame) if modal is None else modal
        self._frame = self._modal.frame
        self._ended = False
        self._compensation: Compensation | None = None
        self._capture_due = machine.dialect.auto_capture
        self._parse = reader_of(machine.dialect)
        # what the program begins with, while lines of its approach or of a jog are read
        self._program = self._modal if machine_coordinates else None
        if machine_coordinates:
            self._modal = INITIAL
            self._parse = reader_of(Dialect(channels=machine.dialect.channels))
        self._batches = BatchInterpreter(self._setup)

    @property
    def modal(self) -> ModalState:
        """Return the modal state between lines, from which another interpreter can start."""
        return self._modal

    @property
    def frame(self) -> Frame | None:
        """Return the work offsets in force, behind the program's end those it left; None: never any."""
        return self._frame

    def begin_program(self) -> None:
        """Read the lines to come as the machine's programs; positions stay as they are."""
        if self._program is not None:
            self._modal, self._program = self._program, None
            self._parse = reader_of(self._setup.machine.dialect)

    @property
    def machine(self) -> Machine:
        """Return the machine whose programs are read."""
        return self._setup.machine

    @property
    def switches(self) -> Switches:
        """Return the operator's switches."""
        return self._setup.switches

    @property
    def computes(self) -> bool:
        """Whether lines may hold expressions, parameters and O-words (D-80): not on the way to the first."""
        return self._program is None and self._setup.machine.dialect.computes

    @property
    def unsynced(self) -> Container[int]:
        """Axes whose commanded position is only known once the encoder has been read."""
        return self._commanded.unsynced

    def guess_positions(self) -> None:
        """Let positions be guesses, behind a line that could not be computed. For checks only."""
        for axis in self._commanded.positions:
            self._commanded.mark_guessed(axis)

    @property
    def positions(self) -> Mapping[int, float]:
        """Commanded positions of all axes [m or rad], by axis number."""
        return dict(self._commanded.positions)

    @property
    def compensation(self) -> Compensation | None:
        """Return the cutter compensation in force behind the last line (D-85)."""
        return self._compensation

    @property
    def held_line(self) -> int | None:
        """Number of the line whose move is held until the next one is known; None: none is."""
        held = None if self._compensation is None else self._compensation.held
        return None if held is None else held.line.line

    @property
    def _one_by_one(self) -> bool:
        """Whether lines are not read in columns."""
        modal = self._modal
        frame = modal.frame
        by_tip = frame is not None and (frame.tip_tool is not None or frame.surface is not None)
        beside = self._compensation is not None or modal.transformation is not None
        beside = beside or modal.control_points is not None or modal.per_turn or bool(modal.coupled)
        beside = beside or modal.diameter or modal.pace != 1.0
        return self._ended or self._setup.dynamics is not None or by_tip or beside

    @property
    def coordinates(self) -> Mapping[int, float]:
        """Where the program is, by axis [m or rad]: as `positions`, but under G43.4 the tip's X Y Z."""
        positions = self.positions
        frame = self._modal.frame
        if frame is None or frame.tip_tool is None:
            return positions
        return {**positions, **dict(enumerate(tip_coordinates(self._setup, frame, positions)))}

    def axes_of(self, axis: int) -> tuple[int, ...]:
        """Return the axes that a coordinate of the program depends on: itself, under G43.4 the tool's."""
        frame = self._modal.frame
        tool = None if frame is None else frame.tip_tool
        return (axis,) if tool is None else (axis, *self._setup.chains[tool])

    def check_closed(self) -> None:
        """Note that the text has ended.

        Raises:
            ProgramRejected: MC189 a curve is not closed.
        """
        points = self._modal.control_points
        if points is not None:
            self._modal = msgspec.structs.replace(self._modal, control_points=None)
            raise ProgramRejected(
                [
                    Diagnostic(
                        code="MC189",
                        line=points.line,
                        message="no G5.3 ends the curve that begins here",
                        hint="write G5.3 behind its last control point",
                    )
                ]
            )

    def finish(self) -> list[Canonical]:
        """Return what is held, behind the last line of a text that has no M2."""
        released = release(self._compensation)
        self._compensation = None
        return released

    @property
    def ended(self) -> bool:
        """Return True behind M02 or M30; what follows is not read."""
        return self._ended

    def interpret(self, parsed: ParsedLine) -> list[Canonical]:
        """Interpret a line; the result is empty if it only changes modal state, and after the program's end.

        Raises:
            ProgramRejected: with every fault of the line; the state is as before it (D-04).
        """
        if self._ended:
            return []
        if _idle(parsed):
            return []
        return self._interpret_block(parsed)

    def interpret_text(self, text: str, number: int) -> list[Canonical]:
        """Parse and interpret one line.

        Raises:
            ProgramRejected: with its faults of text, grammar and meaning together.
        """
        return self.interpret(self._parse(text, number))

    def parse(self, text: str, number: int) -> ParsedLine:
        """Parse a line in the machine's dialect; faults are kept in `ParsedLine.faults`."""
        return self._parse(text, number)

    def capture_before(self, parsed: ParsedLine) -> AxisLine | None:
        """Return the capture of all leased axes that the program's first move needs ahead of it (D-67).

        Only on machines with ``capture = "auto"``, and once a program.
        """
        if not self._capture_due or self._ended or self._program is not None or not _moves(parsed):
            return None
        self._capture_due = False
        axes = tuple(sorted(self._setup.leased))
        self._commanded.invalidate(axes)
        return AxisLine(parsed.number, AxisOperation.CAPTURE, axes)

    def pause_before(self, parsed: ParsedLine) -> list[Canonical]:
        """Return the pause that comes ahead of all motion of this line, such as a tool change; empty: none.

        What follows it in the line has to be interpreted when the pause has ended, without the pause
        (`without_pause`). The state stays as it is.

        Raises:
            ProgramRejected: with every fault of the line.
        """
        if self._ended or self._program is not None or not _may_pause(parsed):
            return []
        interpreted, values = self._read(parsed)
        faults_of(interpreted.block).raise_if_any()
        for value in values:
            if isinstance(value, PauseLine):
                return [value]
            if not isinstance(value, OutputLine):
                break
        return []

    def end_pause(self, positions: Mapping[int, float], frame: Frame | None) -> None:
        """Go on behind a pause.

        Args:
            positions: of axes that were moved meanwhile, by number [m or rad]: bases of increments and starts
                of paths. frame: with work offsets and tools that were changed; None: they were not.
        """
        self._commanded.invalidate(positions)
        self.sync_positions(positions)
        transformation = self._modal.transformation
        if transformation is not None:
            self._modal = msgspec.structs.replace(
                self._modal,
                transformation=transformation.without(positions if frame is None else transformation.axes),
            )
        if frame is not None:
            self._modal = with_tables(self._modal, self._setup.machine, frame)
            self._frame = self._modal.frame or self._frame

    def batch_window(self, number: int) -> int:
        """Return how many lines from line ``number`` on `interpret_batch` would read; 0: no attempt now.

        Saves the caller from gathering lines in vain: after parts without batches attempts are rare.
        """
        one_by_one = self._one_by_one or self._capture_due or self._program is not None
        return 0 if one_by_one else self._batches.window(number)

    def interpret_batch(
        self, texts: Sequence[str], number: int, most: int = MAX_LINES
    ) -> InterpretedBatch | None:
        """Parse and interpret the longest batch of lines that ``texts`` begins with.

        Values and state are bit for bit those of `interpret_text` line by line. Whatever ends a batch is left
        to `interpret_text`: other codes, a fault, a tool in force, an axis whose start only the encoder
        gives. A failed attempt costs a few microseconds and suppresses the next ones for some lines.

        Args:
            texts: consecutive lines without their ends.
            number: of the first of them.
            most: lines that may be taken.

        Returns:
            The batch; None below `mcserver.gcode.fast_path.interpreted_batch.MIN_LINES`.
        """
        if self._one_by_one:
            return None
        found = self._batches.interpret(texts, number, self._modal, self._commanded, most)
        if found is None:
            return None
        self._modal = found.modal
        self._frame = found.modal.frame or self._frame
        return found

    def _interpret_block(self, parsed: ParsedLine) -> list[Canonical]:
        interpreted, values = self._read(parsed)
        faults_of(interpreted.block).raise_if_any()
        self._commit(interpreted)
        return values

    def check(self, parsed: ParsedLine) -> tuple[Diagnostic, ...]:
        """Return every fault of the line and go on from the best guess of what it meant. For checks only."""
        return self.check_line(parsed)[0]

    def check_line(self, parsed: ParsedLine) -> tuple[tuple[Diagnostic, ...], Sequence[Canonical]]:
        """Return every fault of the line, and its values as far as known; go on from the best guess.

        For checks only.
        """
        if self._ended:
            return (), ()
        if _idle(parsed):
            return (), ()
        interpreted, values = self._read(parsed)
        self._commit(interpreted)
        return faults_of(interpreted.block).in_reading_order(), values

    def _read(self, parsed: ParsedLine) -> tuple[BlockInterpreter, list[Canonical]]:
        if counts_diameters(parsed, self._modal.diameter):
            parsed = in_radii(parsed)
        block = BlockState(self._setup, parsed, self._modal, self._commanded, self._compensation)
        interpreted = BlockInterpreter(block)
        interpreted.read()
        if not interpreted.ended:
            read_bodies(block)
        values = interpreted.values
        if block.compensation is not None:
            values = compensate(block, self._modal, self._commanded.path_starts(), values)
        return interpreted, values

    def _commit(self, interpreted: BlockInterpreter) -> None:
        self._modal = interpreted.block.modal
        self._frame = self._modal.frame or self._frame
        self._commanded = interpreted.block.commanded
        self._compensation = interpreted.block.compensation
        self._ended = interpreted.ended

    def axes_to_sync(self, parsed: ParsedLine) -> frozenset[int]:
        """Return the axes whose encoder decides where this line starts (D-14, D-25); empty for most lines.

        The line names such an axis, or uses a tool of it, and a capture, speed, torque or servo command has
        come since its last move. Before `interpret` all earlier motion has to end, the axes have to come to
        rest, and `sync_positions` needs their readings.
        """
        if self._ended or not self._commanded.unsynced:
            return frozenset()
        found = find_axes_to_sync(parsed, self._setup, self._modal, self._commanded)
        if found and (self._compensation is not None or _compensates(parsed)):
            # one axis of the plane takes the other along
            found |= self._commanded.unsynced.keys() & set(PLANES[self._modal.plane or 17])
        return found

    def sync_positions(self, positions: Mapping[int, float]) -> None:
        """Take over encoder readings [m or rad] (D-14, D-25).

        After a capture, a speed or a torque command the reading becomes the base of increments and the start
        of paths; after G1020 only the start of paths: the base stays the commanded end.
        """
        commanded = self._commanded
        for axis, position in positions.items():
            if axis not in commanded.positions:
                continue
            if commanded.unsynced.pop(axis, True):
                if position != commanded.positions[axis]:
                    commanded.stale.update(self._setup.tools_of[axis])
                commanded.positions[axis] = position
                commanded.starts.pop(axis, None)
            elif position == commanded.positions[axis]:
                commanded.starts.pop(axis, None)
            else:
                commanded.starts[axis] = position


def without_pause(values: Sequence[Canonical]) -> list[Canonical]:
    """Return the values of a line without the pause that has ended."""
    pause = next((value for value in values if isinstance(value, PauseLine)), None)
    return [value for value in values if value is not pause]


def _idle(parsed: ParsedLine) -> bool:
    """Return True if the line neither does nor brings anything."""
    return parsed.blank and not parsed.faults and not bodies_in(parsed.text)


def _may_pause(parsed: ParsedLine) -> bool:
    """Return True if the line holds a code that can pause the program."""
    if parsed.profile is not None and any(
        action.code == "M6" or PRINTER_STOPS.get(action.code) for action in parsed.profile.actions
    ):
        return True
    return any(
        command.spec is not None and command.spec.kind is Kind.PROGRAM
        for group in parsed.groups
        for command in group
    )


def _compensates(parsed: ParsedLine) -> bool:
    """Return True if the line switches cutter compensation on."""
    return parsed.profile is not None and any(each.code in COMPENSATING for each in parsed.profile.actions)


def _moves(parsed: ParsedLine) -> bool:
    """Return True if the line holds anything that moves axes."""
    if parsed.profile is not None and any(action.code in MOVING for action in parsed.profile.actions):
        return True
    return any(command.moves for group in parsed.groups for command in group) or any(
        isinstance(item, Word) and item.letter in "IJKR"
        for group in parsed.groups
        for command in group
        for item in command.items
    )
