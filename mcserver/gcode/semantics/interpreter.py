"""The interpreter: parsed lines in, canonical motion out, modal state between them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from mckinematics.pose import Kinematics

from mcserver.errors import Diagnostic
from mcserver.gcode.fast_path.block import PlainMoves
from mcserver.gcode.fast_path.runs import MOST, PlainRuns
from mcserver.gcode.semantics.block_interpreter import LineMeaning, faults_of
from mcserver.gcode.semantics.block_state import Draft, set_up
from mcserver.gcode.semantics.commanded_state import Commanded
from mcserver.gcode.semantics.modal import INITIAL, ModalState
from mcserver.gcode.semantics.position_sync import axes_to_observe
from mcserver.gcode.text.parser import ParsedLine, scan_line
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import Canonical, PlainRun


class Interpreter:
    """One program's modal state and commanded positions (D-10).

    Args:
        machine: whose axes and tools the program names.
        kinematics: of its tools; None where it has none.
        positions: commanded positions at the start [m or rad]; the drives' initial ones by default.
        lease: axes that the program may use; all by default.
        modal: state to start from, for a program that goes on from its middle.
    """

    def __init__(
        self,
        machine: Machine,
        *,
        kinematics: Kinematics | None = None,
        positions: Mapping[int, float] | None = None,
        lease: frozenset[int] | None = None,
        modal: ModalState = INITIAL,
    ) -> None:
        self._setup = set_up(machine, kinematics, lease)
        initial = {axis.index: axis.initial_position for axis in machine.axes}
        self._commanded = Commanded({**initial, **(positions or {})})
        self._modal = modal
        self._ended = False
        self._plain = PlainMoves(self._setup)
        self._runs = PlainRuns(self._setup)

    @property
    def modal(self) -> ModalState:
        """The modal state between lines, which can be given to another interpreter."""
        return self._modal

    @property
    def positions(self) -> Mapping[int, float]:
        """Commanded ends of all axes [m or rad], by axis number."""
        return dict(self._commanded.positions)

    @property
    def ended(self) -> bool:
        """Whether M02 or M30 has come; what follows is not read."""
        return self._ended

    def interpret(self, parsed: ParsedLine) -> list[Canonical]:
        """What the line does, in order; empty where it only changes modal state, and after the program's end.

        Raises:
            ProgramRejected: with every fault of the line; the state is as before it (D-04).
        """
        if self._ended:
            return []
        plain = parsed.plain
        if plain is not None:
            quick = self._plain.interpret(parsed.number, plain, self._modal, self._commanded)
            if quick is not None:
                self._modal, line = quick
                return [line]
        elif parsed.blank and not parsed.faults:
            return []
        return self._interpret_generally(parsed)

    def interpret_text(self, text: str, number: int) -> list[Canonical]:
        """Parses and interprets one line.

        Raises:
            ProgramRejected: with the faults of its text and of its meaning together.
        """
        return self.interpret(scan_line(text, number))

    def run_window(self, number: int) -> int:
        """How many lines from line ``number`` on `interpret_run` would look at; 0: it would not look at all.

        So that nobody has to gather lines in vain: after programs' parts that hold no runs it looks seldom.
        """
        return 0 if self._ended else self._runs.window(number)

    def interpret_run(
        self, texts: Sequence[str], number: int, most: int = MOST
    ) -> tuple[PlainRun, int] | None:
        """Parses and interprets the longest run of alike plain lines that ``texts`` begins with.

        Its values and the state after it are bit for bit those of `interpret_text` line by line, which is the
        way to go for everything that ends a run: lines of other words, whatever has a fault, a tool in force,
        axes whose start the encoder decides. A trial in vain costs a few microseconds at most, and next to
        nothing for some lines after it.

        Args:
            texts: consecutive lines without their ends.
            number: of the first of them.
            most: lines that may be taken.

        Returns:
            The run and how many of ``texts`` it took, blank lines too; None where they would be fewer than
            `plain_runs.LEAST`.
        """
        if self._ended:
            return None
        found = self._runs.interpret(texts, number, self._modal, self._commanded, most)
        if found is None:
            return None
        self._modal, run, taken = found
        return run, taken

    def _interpret_generally(self, parsed: ParsedLine) -> list[Canonical]:
        meaning = self._read(parsed)
        faults_of(meaning.draft).raise_if_any()
        self._commit(meaning)
        return meaning.values

    def survey(self, parsed: ParsedLine) -> tuple[Diagnostic, ...]:
        """Every fault of the line; then goes on from the best guess of what it meant. For checks only."""
        if self._ended:
            return ()
        if parsed.plain is not None and not parsed.faults:
            quick = self._plain.interpret(parsed.number, parsed.plain, self._modal, self._commanded)
            if quick is not None:
                self._modal = quick[0]
                return ()
        elif parsed.blank and not parsed.faults:
            return ()
        meaning = self._read(parsed)
        self._commit(meaning)
        return faults_of(meaning.draft).in_reading_order()

    def _read(self, parsed: ParsedLine) -> LineMeaning:
        meaning = LineMeaning(Draft(self._setup, parsed, self._modal, self._commanded))
        meaning.read()
        return meaning

    def _commit(self, meaning: LineMeaning) -> None:
        self._modal = meaning.draft.modal
        self._commanded = meaning.draft.commanded
        self._ended = meaning.ended

    def encoder_axes(self, parsed: ParsedLine) -> frozenset[int]:
        """Axes whose encoder decides where this line starts (D-14, D-25); none for most lines.

        Such an axis is named by the line, or belongs to a tool that it uses, and a capture, speed, torque or
        servo command has come since its last move. Let all that came before end, bring the axes to rest, and
        `observe` them before `interpret`.
        """
        if self._ended or not self._commanded.unsettled:
            return frozenset()
        return axes_to_observe(parsed, self._setup, self._modal, self._commanded)

    def observe(self, positions: Mapping[int, float]) -> None:
        """Tells where axes stand [m or rad] (D-14, D-25).

        After a capture, a speed or a torque command the reading becomes the base of increments and the start
        of paths; after G1020 only the start of paths: the base stays the commanded end.
        """
        commanded = self._commanded
        for axis, position in positions.items():
            if axis not in commanded.positions:
                continue
            if commanded.unsettled.pop(axis, True):
                if position != commanded.positions[axis]:
                    commanded.stale.update(self._setup.tools_of[axis])
                commanded.positions[axis] = position
                commanded.starts.pop(axis, None)
            elif position == commanded.positions[axis]:
                commanded.starts.pop(axis, None)
            else:
                commanded.starts[axis] = position


class Resumption(NamedTuple):
    """Where a program stands before one of its lines.

    Attributes:
        modal: the modal state.
        positions: commanded ends [m or rad].
    """

    modal: ModalState
    positions: Mapping[int, float]


def modal_before(
    lines: Iterable[str],
    number: int,
    machine: Machine,
    *,
    kinematics: Kinematics | None = None,
    positions: Mapping[int, float] | None = None,
) -> Resumption:
    """The state before line ``number`` of a program, rebuilt by reading the lines before it; nothing moves.

    Args:
        lines: the whole program, or at least the lines before ``number``.
        number: from 1.
        positions: where the program started; the drives' initial positions by default.

    Raises:
        ProgramRejected: a line before it has a fault.
    """
    interpreter = Interpreter(machine, kinematics=kinematics, positions=positions)
    for at, text in enumerate(lines, start=1):
        if at >= number:
            break
        interpreter.interpret_text(text, at)
    return Resumption(interpreter.modal, interpreter.positions)
