"""Expand a program that computes, while it runs, to plain lines for the interpreter (D-83).

Lines in blocks of O-words and in subprograms carry the number of the main program's line that runs them. So
the line numbers of motion never decrease, and a line is done when everything that it runs has ended.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import msgspec

from mcserver.errors import ProgramRejected
from mcserver.gcode.computing.expressions import ComputingError, Value
from mcserver.gcode.computing.line_template import Setting
from mcserver.gcode.computing.machine_values import MachineValues, Source, Unsettled
from mcserver.gcode.computing.o_words import (
    BlockCompiler,
    Instruction,
    Routine,
    Statement,
    call_routine,
    file_routine,
    line_routine,
    read_statement,
    saves,
    shown_name,
)
from mcserver.gcode.computing.parameters import ComputedState, ParameterTable, check_own, stays
from mcserver.gcode.computing.saved_state import restoring_line, state_of
from mcserver.gcode.line_faults import Origin, Span, in_file
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.source import split_lines

# Steps that one program may take; more are an endless loop.
MOST_STEPS = 1_000_000
# Steps per call of `Expansion.next`, so that the caller can serve others in between.
STEPS_PER_CALL = 500
# Depth of nested calls.
DEEPEST_CALL = 30
# Lines of all subprograms together.
MOST_SUBPROGRAM_LINES = 100_000
_ENDLESS_HINT = (
    "is there a loop whose condition never changes? A program that repeats for ever is not run here"
)


@dataclass(slots=True, eq=False)
class Frame:
    """A routine that runs: its next instruction, and the turns left of its repeat loops."""

    routine: Routine
    at: int = 0
    left: dict[int, int] = field(default_factory=dict)


class Expansion:
    """Expands one program.

    `take` accepts one line at a time; while `running`, `next` returns plain lines to interpret.

    Args:
        interpreter: of the program; expressions may read its state.
        source: of values that are measured while the program runs.

    Attributes:
        head: line of the main program at which the block that is collected or running begins; 0: none.
        through: last line that was taken and is complete, with its block if it belongs to one.
        assumed: what a check has assumed, in words, and the line.
    """

    def __init__(self, interpreter: Interpreter, source: Source = Source.MACHINE) -> None:
        self._interpreter = interpreter
        self._tolerant = source is Source.ASSUMED
        self._parameters = self._table(ComputedState(self._stayed()))
        self._subprograms: dict[str, Routine] = {}
        self._texts: dict[int, str] = {}
        self._gathered: dict[int, str] = {}
        self.measured = MachineValues(interpreter, source, self._assume)
        self.assumed: dict[str, int] = {}
        self.head = 0
        self.through = 0
        self._compiler: BlockCompiler | None = None
        # in a check: the block being collected has a faulty O-word
        self._broken = False
        self._frames: list[Frame] = []
        self._ready: ParsedLine | None = None
        self._due: list[Setting] = []
        self._line = 0
        # number of the line last passed to `take`, accepted or not
        self._given_number = 0
        self._steps = 0
        self._said: set[tuple[str, int, int]] = set()
        kept = interpreter.program_modal.computed
        if kept is not None:
            self._restore(kept)

    def _restore(self, kept: ComputedState) -> None:
        """Restore parameters and subprograms from a saved state."""
        for number, text in sorted(kept.subprograms.items()):
            self._compute(text, number)
        self._parameters = self._table(kept)
        self.through = 0

    def _table(self, kept: ComputedState) -> ParameterTable:
        return ParameterTable(kept, persistent=self._interpreter.machine.dialect.persistent)

    def _stayed(self) -> dict[int, float]:
        """Return the parameters of earlier programs, but those that no longer stay on this machine."""
        frame, persistent = self._interpreter.frame, self._interpreter.machine.dialect.persistent
        kept = {} if frame is None else frame.parameters
        return {number: value for number, value in kept.items() if stays(number, persistent)}

    # ------------------------------------------------------------ state

    @property
    def lasting(self) -> Mapping[int, float]:
        """The parameters that stay for later programs (D-81), the same object until one is set."""
        return self._parameters.lasting()

    @property
    def idle(self) -> bool:
        """Whether the next line can be read without expansion: no block is being collected or running."""
        return not self.head and self._ready is None and not self._frames

    @property
    def running(self) -> bool:
        """Whether `next` has to be called before the next `take`."""
        return self._ready is not None or bool(self._frames)

    @property
    def in_block(self) -> bool:
        """Whether a block is running, whose effects cannot be undone."""
        return bool(self._frames) and self.head > 0

    def kept(self) -> ComputedState | None:
        """Return parameters and subprograms, between two lines of the main program; None if there are none.

        Raises:
            ProgramRejected: MC167 a block is not closed here.
        """
        if self.head:
            raise self._rejected(
                ComputingError(
                    "MC167",
                    f"the line stands in the block of O-words that begins in line {self.head}",
                    (0, 0),
                    f"start at line {self.head}",
                ),
                self.head,
            )
        found = self._parameters.kept()
        found = msgspec.structs.replace(found, subprograms=dict(self._texts))
        return None if found == ComputedState() else found

    # ------------------------------------------------------------ text

    def passed(self, texts: Sequence[str], number: int) -> None:
        """Note lines that were read without `take`; the first is line ``number``."""

    def take(self, text: str, number: int) -> None:
        """Take the next line; not while it is `running`.

        Raises:
            ProgramRejected: MC140, MC160, MC161, MC164; the line is not taken.
        """
        self._given_number = number
        try:
            self._take(text, number)
        except ComputingError as error:
            self._broken |= self._tolerant and self.head > 0 and error.code == "MC161"
            if not self.head:
                self.through = number
            raise self._rejected(error, number) from None

    def close(self) -> None:
        """Note that the text has ended.

        Raises:
            ProgramRejected: MC161 a block is not closed.
        """
        compiler = self._compiler
        if compiler is not None:
            head, broken = self.head, self._broken
            self.drop()
            if not broken:
                raise self._rejected(compiler.unclosed(), head)

    def drop(self) -> None:
        """Discard the block that is collected or running; the current line sets no parameters."""
        self._compiler, self._broken, self._ready = None, False, None
        self._frames.clear()
        self._due.clear()
        self._gathered.clear()
        del self._parameters.scopes[1:]
        self.head = 0

    def _take(self, text: str, number: int) -> None:
        text = self._interpreter.switches.read(text)
        if not self._interpreter.computes or not self._compute(text, number):
            self._ready = self._interpreter.parse(text, number)
        if not self.head:
            self.through = number

    def _compute(self, text: str, number: int) -> bool:
        """Accept a line that computes; return False for a plain line."""
        statement = read_statement(text, number)
        if self._compiler is not None:
            self._gather(text, number, statement)
        elif statement is not None and statement.word in ("sub", "while", "do", "if", "repeat"):
            if statement.word == "sub" and statement.name in self._subprograms:
                before = self._subprograms[statement.name]
                place = before.file or f"line {before.first}"
                raise ComputingError(
                    "MC161", f"the subprogram stands in {place} already", statement.span, "rename one"
                )
            self._compiler = BlockCompiler(statement)
            self._gathered = {number: text}
            self.head = number
        elif statement is not None:
            self._start(call_routine(statement))
            self.head = number
        elif saves(text) or (("#" in text or "[" in text) and not text.lstrip().startswith("%")):
            self._start(line_routine(text, number))
            self._line = number
        else:
            return False
        return True

    def _gather(self, text: str, number: int, statement: Statement | None) -> None:
        compiler = self._compiler
        assert compiler is not None
        compiler.add(text, number, statement)
        self._gathered[number] = text
        if not compiler.closed:
            return
        routine, self._compiler = compiler.routine, None
        if not routine.name:
            if self._broken:
                self._end_block(number)
            else:
                self._start(routine)
        else:
            if len(self._texts) + len(self._gathered) > MOST_SUBPROGRAM_LINES:
                raise ComputingError(
                    "MC164", f"subprograms have more than {MOST_SUBPROGRAM_LINES} lines", (1, len(text) + 1)
                )
            self._subprograms[routine.name] = routine
            self._texts.update(self._gathered)
            self._end_block(number)
        self._gathered = {}

    def _start(self, routine: Routine) -> None:
        self._frames = [Frame(routine)]

    def _end_block(self, last: int) -> None:
        self.head, self.through, self._broken = 0, max(self.through, last), False

    # ------------------------------------------------------------ run

    @property
    def _counted(self) -> int:
        """Line number of the main program under which the running line counts."""
        return self.head or self._line

    def next(self) -> ParsedLine | Unsettled | None:
        """Return the next plain line; None if there is none now, and while `running` ask again.

        The line returned before counts as interpreted. `Unsettled`: the motion so far has to end first;
        the next call then tries the same line again.

        Raises:
            ProgramRejected: MC116, MC162 … MC165, MC168; a check may go on.
        """
        if self._ready is not None:
            ready, self._ready = self._ready, None
            return ready
        self._set_due()
        for _ in range(STEPS_PER_CALL):
            if not self._frames:
                return None
            frame = self._frames[-1]
            if frame.at >= len(frame.routine.code):
                if not self._end_routine():
                    return None
                continue
            step = frame.routine.code[frame.at]
            try:
                self._count()
                found = self._step(frame, step)
            except Unsettled as unsettled:
                return unsettled
            except ComputingError as error:
                rejected = self._rejected(error, step.line, frame.routine.file)
                if not self._tolerant:
                    raise rejected from None
                self._go_on(frame, step, error)
                # report an endless program's loop once
                place = (error.code, *((0, 0) if error.code == "MC164" else (step.line, error.span[0])))
                if place not in self._said:
                    self._said.add(place)
                    raise rejected from None
                continue
            if found is not None:
                return found
        return None

    def _count(self) -> None:
        self._steps += 1
        if self._steps > MOST_STEPS:
            loop, file = self._loop()
            self._frames[0].at = len(self._frames[0].routine.code)
            del self._frames[1:]
            raise ComputingError(
                "MC164",
                f"the program comes to no end: after {MOST_STEPS} steps it is in this loop",
                loop.span,
                _ENDLESS_HINT,
                loop.line,
                file,
            )

    def _loop(self) -> tuple[Instruction, str]:
        """Return where the innermost running loop begins, or else the running step; and the file it is in."""
        for frame in reversed(self._frames):
            code = frame.routine.code
            starts = [
                each.target
                for at, each in enumerate(code)
                if each.kind in ("jump", "again") and 0 <= each.target <= frame.at <= at
            ]
            if starts:
                return code[max(starts)], frame.routine.file
        return self._frames[-1].routine.code[0], self._frames[-1].routine.file

    def _step(self, frame: Frame, step: Instruction) -> ParsedLine | None:
        if step.kind == "line":
            return self._give(frame, step)
        if step.kind == "test":
            value = step.values[0](self)
            if math.isnan(value):
                # its value could not be computed: a check reports nothing more about the block
                self._abandon()
                return None
            frame.at = frame.at + 1 if value != 0.0 else step.target
        elif step.kind == "jump":
            frame.at = step.target
        elif step.kind == "repeat":
            value = step.values[0](self)
            left = 0 if math.isnan(value) else round(value)
            frame.left[frame.at] = left
            frame.at = frame.at + 1 if left > 0 else step.target
        elif step.kind == "again":
            frame.left[step.target - 1] -= 1
            frame.at = step.target if frame.left[step.target - 1] > 0 else frame.at + 1
        elif step.kind == "call":
            self._call(frame, step)
        elif step.kind == "state":
            frame.at += 1
            return self._save_or_restore(frame, step)
        else:
            returned = bool(step.values)
            value = step.values[0](self) if returned else 0.0
            self._parameters.set_named("_value", value)
            self._parameters.set_named("_value_returned", float(returned))
            frame.at = len(frame.routine.code)
            if self._parameters.scopes[-1].returns:
                return self._restore_state(frame, step)
        return None

    def _save_or_restore(self, frame: Frame, step: Instruction) -> ParsedLine | None:
        """Execute one of M70 to M73, whose saved state belongs to the call they are in (D-138)."""
        scope = self._parameters.scopes[-1]
        if step.name == "M71":
            scope.saved, scope.returns = None, False
        elif step.name == "M72":
            return self._restore_state(frame, step)
        elif step.name == "M73" and len(self._parameters.scopes) == 1:
            raise ComputingError(
                "MC208", "M73 stands outside of a subprogram", step.span, "write M70 and M72"
            )
        else:
            scope.saved, scope.returns = state_of(self._interpreter, step.span), step.name == "M73"
        return None

    def _restore_state(self, frame: Frame, step: Instruction) -> ParsedLine | None:
        saved = self._parameters.scopes[-1].saved
        if saved is None:
            hint = "write M70 ahead of it, in the same subprogram; a start behind M70 does not know it"
            raise ComputingError("MC208", "no state is saved here", step.span, hint)
        codes = restoring_line(saved, self._interpreter, step.span)
        if not codes:
            return None
        parsed = self._interpreter.parse(codes, self._counted)
        parsed.origin = Origin(step.line, lambda _: step.span, frame.routine.file)
        return parsed

    def _give(self, frame: Frame, step: Instruction) -> ParsedLine | None:
        """Evaluate a line; the parameters that it sets are set once it has been interpreted."""
        assert step.template is not None
        plain = step.template.evaluate(self)
        for setting in plain.settings:
            self._check_setting(setting)
        frame.at += 1
        self._due = plain.settings
        if plain.text is None:
            self._interpreter.guess_positions()
            return None
        if not plain.text.strip():
            self._set_due()
            return None
        parsed = self._interpreter.parse(plain.text, self._counted)
        parsed.origin = Origin(step.line, plain.columns.span, frame.routine.file)
        return parsed

    def _set_due(self) -> None:
        due, self._due = self._due, []
        for setting in due:
            self._set(setting)

    def _call(self, frame: Frame, step: Instruction) -> None:
        name = step.name if isinstance(step.name, str) else self._computed_name(step.name, step)
        routine = self._subprograms.get(name) or self._of_file(name, step)
        if routine is None:
            files = self._interpreter.machine.dialect.subroutines
            known = ", ".join(sorted({*self._subprograms, *files})[:20]) or "none"
            raise ComputingError(
                "MC165",
                f"there is no subprogram {name} above this line",
                step.span,
                f"write o{shown_name(name)} sub … endsub ahead of it, or name the folder of its file in the "
                f"machine file: [dialect] subroutines; there is {known}",
            )
        if len(self._frames) > DEEPEST_CALL:
            raise ComputingError(
                "MC164", f"calls stand more than {DEEPEST_CALL} deep", step.span, "does it call itself?"
            )
        arguments = tuple(value(self) for value in step.values)
        frame.at += 1
        self._frames.append(Frame(routine))
        self._parameters.scopes.append(self._parameters.scope(arguments))

    def _of_file(self, name: str, step: Instruction) -> Routine | None:
        """Return the subprogram in a file of the machine's; None if there is no file of that name."""
        text = self._interpreter.machine.dialect.subroutines.get(name)
        if text is None:
            return None
        number = 0
        try:
            lines = split_lines(text)
            for number, line in enumerate(lines, start=1):
                lines[number - 1] = self._interpreter.switches.read(line)
            number = 0
            routine = self._compile_file(name, "\n".join(lines))
        except ComputingError as error:
            message = f"{shown_name(name)} of the machine's folder, line {error.line or number}: {error}"
            raise ComputingError(error.code, message, step.span, error.hint) from None
        routine.file = f"{shown_name(name)} of the machine's folder"
        return routine

    def _compile_file(self, name: str, text: str) -> Routine:
        routine = self._subprograms[name] = file_routine(name, text)
        return routine

    def _computed_name(self, number: Value, step: Instruction) -> str:
        value = number(self)
        if math.isnan(value) or value != round(value):
            raise ComputingError("MC165", f"there is no subprogram {value:g}", step.span, "numbers are whole")
        return str(round(value))

    def _end_routine(self) -> bool:
        """End a routine that has no instructions left; return False if nothing more can run now."""
        frame = self._frames.pop()
        if self._frames:
            self._parameters.scopes.pop()
        elif self.head:
            self._end_block(frame.routine.last)
        return True

    def _abandon(self) -> None:
        """Skip the rest of a block whose effect a check cannot know."""
        self._interpreter.guess_positions()
        del self._frames[1:], self._parameters.scopes[1:]
        self._frames[0].at = len(self._frames[0].routine.code)

    def _go_on(self, frame: Frame, step: Instruction, error: ComputingError) -> None:
        """Continue a check after a fault."""
        if step.kind == "line" and error.code != "MC164":
            assert step.template is not None
            frame.at += 1
            self._interpreter.guess_positions()
            for setting in step.template.settings_unknown(self):
                self._set(setting)
        else:
            self._abandon()

    # ------------------------------------------------------------ parameters

    def numbered(self, number: int, span: Span) -> float:
        """Return a numbered parameter (`expressions.Values`)."""
        found = self.measured.numbered(number, span)
        return self._parameters.numbered(number) if found is None else found

    def named(self, name: str, span: Span) -> float:
        """Return a named parameter (`expressions.Values`)."""
        found = self._parameters.named(name)
        if found is None:
            found = self._predefined(name, span)
        if found is None:
            hint = f"set it first, or ask EXISTS[#<{name}>]"
            if name.startswith(("_ini[", "_hal[")):
                hint = "LinuxCNC's INI file and HAL pins are not here: set a parameter of another name"
            raise ComputingError("MC162", f"#<{name}> has no value yet", span, hint)
        return found

    def exists(self, name: str) -> bool:
        """Return whether a named parameter has a value (`expressions.Values`)."""
        return self._parameters.named(name) is not None or self._predefined(name, (1, 2)) is not None

    def _predefined(self, name: str, span: Span) -> float | None:
        if not name.startswith("_"):
            return None
        own = {
            "_line": float(self._frames[-1].routine.code[self._frames[-1].at].line) if self._frames else 0.0,
            "_call_level": float(len(self._frames) - 1),
            "_value": 0.0,
            "_value_returned": 0.0,
        }
        return own[name] if name in own else self.measured.named(name, span)

    def _check_setting(self, setting: Setting) -> None:
        name, span = setting.parameter.name, setting.parameter.span
        if not name:
            check_own(setting.number, span)
        elif self._parameters.named(name) is None and self._predefined(name, span) is not None:
            raise ComputingError("MC162", f"#<{name}> is only read, never set", span, "rename it")

    def _set(self, setting: Setting) -> None:
        parameter = setting.parameter
        if parameter.name:
            self._parameters.set_named(parameter.name, setting.value, parameter.span)
        elif setting.number:
            self._parameters.set_numbered(setting.number, setting.value)

    def _assume(self, what: str) -> None:
        line = self._frames[-1].routine.code[self._frames[-1].at].line if self._frames else 0
        self.assumed.setdefault(what, line)

    def _rejected(self, error: ComputingError, line: int, file: str = "") -> ProgramRejected:
        line, file = (error.line, error.file) if error.line else (line, file)
        fault = error.diagnostic(line)
        return ProgramRejected([in_file(fault, file, self._counted) if file else fault])
