"""Interpret parsed lines as canonical motion; modal state is kept between lines."""

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
from mcserver.gcode.semantics.tilted_planes import lose_plane
from mcserver.gcode.semantics.tip_moves import tip_coordinates
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.gcode.text.command_table import Kind
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.words import Word
from mcserver.machine.dialect_section import Dialect
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import AxisLine, AxisOperation, Canonical, OutputLine, PauseLine


class Interpreter:
    """Interprets one program: its modal state and commanded positions (D-10).

    Args:
        machine: has the axes and tools that the program names.
        kinematics: of its tools; None without tools.
        positions: commanded positions at the start [m or rad]; by default the drives' initial ones.
        lease: axes that the program may use; by default all.
        modal: initial state of a program that starts in its middle.
        frame: initial work offsets if ``modal`` is None (D-62).
        machine_coordinates: until `begin_program`, read lines in the reference's dialect and in axis
            positions, whatever the machine's profile and ``frame``.
        switches: of the operator (D-98); block delete is left to the reader of the text (`Switches.read`).
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
        # the program's initial state, while lines of its approach or of a jog are read
        self._program = self._modal if machine_coordinates else None
        if machine_coordinates:
            self._modal = INITIAL
            self._parse = reader_of(Dialect(channels=machine.dialect.channels))
        self._batches = BatchInterpreter(self._setup)

    @property
    def modal(self) -> ModalState:
        """Modal state between lines, from which another interpreter can start."""
        return self._modal

    @property
    def program_modal(self) -> ModalState:
        """As `modal`; while lines of an approach are read, the state from which the program starts."""
        return self._program or self._modal

    @property
    def frame(self) -> Frame | None:
        """Work offsets in force, after the program's end the last ones; None: never any."""
        return self._frame

    def begin_program(self) -> None:
        """Read the next lines as a program of the machine; positions stay."""
        if self._program is not None:
            self._modal, self._program = self._program, None
            self._parse = reader_of(self._setup.machine.dialect)

    @property
    def machine(self) -> Machine:
        """The machine whose programs are read."""
        return self._setup.machine

    @property
    def switches(self) -> Switches:
        """The operator's switches."""
        return self._setup.switches

    @property
    def computes(self) -> bool:
        """Whether lines may have expressions, parameters and O-words (D-80); not in an approach or jog."""
        return self._program is None and self._setup.machine.dialect.computes

    @property
    def unsynced(self) -> Container[int]:
        """Axes whose commanded position is unknown until the encoder has been read."""
        return self._commanded.unsynced

    def guess_positions(self) -> None:
        """Treat positions as guesses, after a line that could not be computed; for checks only."""
        for axis in self._commanded.positions:
            self._commanded.mark_guessed(axis)

    @property
    def positions(self) -> Mapping[int, float]:
        """Commanded positions of all axes [m or rad], by axis number."""
        return dict(self._commanded.positions)

    @property
    def compensation(self) -> Compensation | None:
        """Cutter compensation in force after the last line (D-85)."""
        return self._compensation

    @property
    def held_line(self) -> int | None:
        """Number of the line whose move is held back until the next one is known; None without one."""
        held = None if self._compensation is None else self._compensation.held
        return None if held is None else held.line.line

    @property
    def _one_by_one(self) -> bool:
        """Whether lines cannot be read in columns."""
        modal = self._modal
        frame = modal.frame
        by_surface = frame is not None and frame.surface is not None
        beside = self._compensation is not None or modal.transformation is not None
        beside = beside or modal.control_points is not None or modal.per_turn or bool(modal.coupled)
        beside = beside or modal.diameter or modal.pace != 1.0
        return self._ended or self._setup.dynamics is not None or by_surface or beside

    @property
    def coordinates(self) -> Mapping[int, float]:
        """The program's position by axis [m or rad]: as `positions`, but X Y Z of the tip under G43.4."""
        positions = self.positions
        frame = self._modal.frame
        if frame is None or frame.tip_tool is None:
            return positions
        return {**positions, **dict(enumerate(tip_coordinates(self._setup, frame, positions)))}

    def axes_of(self, axis: int) -> tuple[int, ...]:
        """Return the axes that determine a coordinate: the axis itself, under G43.4 those of the tool."""
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
            message = "no G5.3 ends the curve that begins here"
            hint = "write G5.3 behind its last control point"
            raise ProgramRejected([Diagnostic("MC189", message, points.line, hint=hint)])

    def finish(self) -> list[Canonical]:
        """Return the move held back at the end of a text without M2, and what follows it."""
        released = release(self._compensation)
        self._compensation = None
        return released

    @property
    def ended(self) -> bool:
        """Whether M02 or M30 was read; later lines are ignored."""
        return self._ended

    def interpret(self, parsed: ParsedLine) -> list[Canonical]:
        """Interpret a line; the result is empty if it only changes modal state, and after the program's end.

        Raises:
            ProgramRejected: with every fault of the line; the state is as before it (D-04).
        """
        if self._ended or _idle(parsed):
            return []
        interpreted, values = self._read(parsed)
        faults_of(interpreted.block).raise_if_any()
        self._commit(interpreted)
        return values

    def interpret_text(self, text: str, number: int) -> list[Canonical]:
        """Parse and interpret one line.

        Raises:
            ProgramRejected: with all faults of text, grammar and meaning.
        """
        return self.interpret(self._parse(text, number))

    def parse(self, text: str, number: int) -> ParsedLine:
        """Parse a line in the machine's dialect; faults are stored in `ParsedLine.faults`."""
        return self._parse(text, number)

    def capture_before(self, parsed: ParsedLine) -> AxisLine | None:
        """Return the capture of all leased axes to execute before the program's first move (D-67), or None.

        Only on machines with ``capture = "auto"``, and once per program.
        """
        if not self._capture_due or self._ended or self._program is not None or not _moves(parsed):
            return None
        self._capture_due = False
        axes = tuple(sorted(self._setup.leased))
        self._commanded.invalidate(axes)
        return AxisLine(parsed.number, AxisOperation.CAPTURE, axes)

    def pause_before(self, parsed: ParsedLine) -> list[Canonical]:
        """Return the pause before all motion of this line, such as for a tool change, or an empty list.

        The rest of the line has to be interpreted after the pause, without it (`without_pause`). The state
        stays as it is.

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
        """Continue after a pause.

        Args:
            positions: of axes that were moved meanwhile, by number [m or rad]: base of increments and path
                start.
            frame: with work offsets and tools changed meanwhile; None: unchanged.
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

        Saves the caller from gathering lines in vain: attempts are rare after parts without batches.
        """
        one_by_one = self._one_by_one or self._capture_due or self._program is not None
        return 0 if one_by_one else self._batches.window(number)

    def interpret_batch(
        self, texts: Sequence[str], number: int, most: int = MAX_LINES
    ) -> InterpretedBatch | None:
        """Parse and interpret the longest batch at the beginning of ``texts``.

        Values and state are bit for bit those of `interpret_text` line by line, but for the last bits of a
        tool's joints. What ends a batch is left to `interpret_text`: other codes, a fault, a line on which a
        tool's joints may not go evenly, an axis whose start has to be read from the encoder. A failed attempt
        costs a few microseconds and suppresses further ones for some lines.

        Args:
            texts: consecutive lines without line ends.
            number: of the first line.
            most: maximum count of lines to take.

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

    def check_line(self, parsed: ParsedLine) -> tuple[tuple[Diagnostic, ...], Sequence[Canonical]]:
        """Return all faults of the line, and its values as far as known; continue from the best guess.

        For checks only.
        """
        if self._ended or _idle(parsed):
            return (), ()
        plane_lost = self._commanded.plane_lost
        interpreted, values = self._read(parsed)
        self._commit(interpreted)
        found = faults_of(interpreted.block).in_reading_order()
        return tuple(each for each in found if not (plane_lost and each.code == "MC201")), values

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
        if parsed.profile is not None and parsed.profile.tilting and block.faulty:
            lose_plane(block, parsed.profile.tilting)
        return interpreted, values

    def _commit(self, interpreted: BlockInterpreter) -> None:
        self._modal = interpreted.block.modal
        self._frame = self._modal.frame or self._frame
        self._commanded = interpreted.block.commanded
        self._compensation = interpreted.block.compensation
        self._ended = interpreted.ended

    def axes_to_sync(self, parsed: ParsedLine) -> frozenset[int]:
        """Return the axes whose encoder readings determine where this line starts (D-14, D-25); mostly none.

        These are axes that the line names, or of a tool that it uses, with a capture, speed, torque or servo
        command since their last move. Before `interpret`, all motion has to end, the axes have to be at rest,
        and `sync_positions` needs their readings.
        """
        if self._ended or not self._commanded.unsynced:
            return frozenset()
        found = find_axes_to_sync(parsed, self._setup, self._modal, self._commanded)
        if found and (self._compensation is not None or _compensates(parsed)):
            # a rotation couples both axes of the plane
            found |= self._commanded.unsynced.keys() & set(PLANES[self._modal.plane or 17])
        return found

    def sync_positions(self, positions: Mapping[int, float]) -> None:
        """Set encoder readings [m or rad] (D-14, D-25).

        After a capture, speed or torque command the reading becomes base of increments and path start; after
        G1020 only path start: the base stays the commanded end.
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
    """Return a line's values without the pause, which has ended."""
    pause = next((value for value in values if isinstance(value, PauseLine)), None)
    return [value for value in values if value is not pause]


def _idle(parsed: ParsedLine) -> bool:
    """Return whether the line has neither code nor bodies."""
    return parsed.blank and not parsed.faults and not bodies_in(parsed.text)


def _may_pause(parsed: ParsedLine) -> bool:
    """Return whether the line has a code that can pause the program."""
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
    """Return whether the line switches cutter compensation on."""
    return parsed.profile is not None and any(each.code in COMPENSATING for each in parsed.profile.actions)


def _moves(parsed: ParsedLine) -> bool:
    """Return whether the line has anything that moves axes."""
    if parsed.profile is not None and any(action.code in MOVING for action in parsed.profile.actions):
        return True
    return any(command.moves for group in parsed.groups for command in group) or any(
        isinstance(item, Word) and item.letter in "IJKR"
        for group in parsed.groups
        for command in group
        for item in command.items
    )
