"""Expand a program that computes to plain lines, which the interpreter reads, as it runs (D-83).

Lines of blocks of O-words and of subprograms have the number of the line in the main program from which they
run: so the line numbers of what moves never fall, and a line is done when all that it runs has ended.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

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
    may_be_statement,
    read_statement,
    saves,
    shown_name,
)
from mcserver.gcode.computing.parameters import ComputedState, ParameterTable, check_own
from mcserver.gcode.computing.saved_state import restoring_line, state_of
from mcserver.gcode.line_faults import Origin, Span, in_file
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.source import split_lines
from mcserver.motion.canonical import Canonical

# Steps of one program: an endless loop is found.
MOST_STEPS = 1_000_000
# Steps between two looks at what else is to be done.
BITE = 500
# Calls within calls.
DEEPEST_CALL = 30
# Lines of all subprograms together.
MOST_SUBPROGRAM_LINES = 100_000
_ENDLESS_HINT = (
    "is there a loop whose condition never changes? A program that repeats for ever is not run here"
)


class Frame:
    """A routine under way: the next instruction, and what its repetitions still have to do."""

    __slots__ = ("at", "left", "routine")

    def __init__(self, routine: Routine) -> None:
        self.routine = routine
        self.at = 0
        self.left: dict[int, int] = {}


class Expansion:
    """The lines of one program, expanded.

    Lines are taken one by one (`take`); while it is `running`, `next` gives plain lines to be interpreted.

    Args:
        interpreter: of the program; what is computed may ask for its state.
        source: where values come from that are measured as the program runs.

    Attributes:
        head: line of the main program whose block is gathered or runs, 0: none.
        through: the last line that was taken and, where it belongs to a block, has ended.
        assumed: what a check has assumed, in words, and the line.
    """

    def __init__(self, interpreter: Interpreter, source: Source = Source.MACHINE) -> None:
        self._interpreter = interpreter
        self._tolerant = source is Source.ASSUMED
        self._parameters = self._table(ComputedState())
        self._subprograms: dict[str, Routine] = {}
        self._texts: dict[int, str] = {}
        self._gathered: dict[int, str] = {}
        self.measured = MachineValues(interpreter, source, self._assume)
        self.assumed: dict[str, int] = {}
        self.head = 0
        self.through = 0
        self._compiler: BlockCompiler | None = None
        # of a check: the block has a faulty O-word
        self._broken = False
        self._frames: list[Frame] = []
        self._ready: ParsedLine | None = None
        self._due: list[Setting] = []
        self._line = 0
        # of the line that was given last, taken or not
        self._given_number = 0
        self._steps = 0
        self._said: set[tuple[str, int, int]] = set()
        kept = interpreter.modal.computed
        if kept is not None:
            self._restore(kept)

    def _restore(self, kept: ComputedState) -> None:
        """Go on as `kept` was."""
        for number, text in sorted(kept.subprograms.items()):
            self._compute(text, number)
        self._parameters = self._table(kept)
        self.through = 0

    def _table(self, kept: ComputedState) -> ParameterTable:
        return ParameterTable(kept)

    # ------------------------------------------------------------ state

    @property
    def idle(self) -> bool:
        """Whether the next line of the text is read as it stands: no block is gathered, none runs."""
        return not self.head and self._ready is None and not self._frames

    @property
    def running(self) -> bool:
        """Whether `next` has more to give before another line is taken."""
        return self._ready is not None or bool(self._frames)

    @property
    def in_block(self) -> bool:
        """Whether a block runs: what it has done cannot be taken back."""
        return bool(self._frames) and self.head > 0

    def kept(self) -> ComputedState | None:
        """Return the parameters and subprograms between two lines of the main program; None: there are none.

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
        """Note lines that were read without being taken, the first of them is ``number``."""

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
        """Forget what is gathered or runs; nothing of a line under way is set."""
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
        """Take a line; False where it has to be read as it stands."""
        statement = read_statement(text, number) if may_be_statement(text) else None
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
        if statement is None:
            compiler.add_line(text, number)
        else:
            compiler.add_statement(statement)
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
        """Line of the main program that what runs counts as."""
        return self.head or self._line

    def next(self) -> ParsedLine | Unsettled | None:
        """Return the next plain line; None: there is none now, and more only while it is `running`.

        Of a line that was given before it is taken that it has been interpreted. `Unsettled`: the motion
        before has to end first; then the same line is asked for again.

        Raises:
            ProgramRejected: MC116, MC162 … MC165, MC168; a check may go on.
        """
        if self._ready is not None:
            ready, self._ready = self._ready, None
            return ready
        self._set_due()
        for _ in range(BITE):
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
                # of a program that comes to no end only the first loop is named
                place = (error.code, *((0, 0) if error.code == "MC164" else (step.line, error.span[0])))
                if place not in self._said:
                    self._said.add(place)
                    raise rejected from None
                continue
            if found is not None:
                return found
        return None

    def interpreted(self, values: Iterable[Canonical]) -> None:
        """Note what the last line gave."""
        self.measured.interpreted(values)

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
        """Return where the innermost loop that runs begins, or what runs; and the file that has it."""
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
                # what it depends on could not be computed: a check says nothing more about the block
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
        """Carry out one of M70 to M73, each for the call that it stands in (D-138)."""
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
        """Evaluate a line; what it sets is set when it has been interpreted."""
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
                f"write o{shown_name(name)} sub … endsub ahead of it; there is {known}",
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
        """Return the subprogram of a file of the machine's; None: there is none of that name."""
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
        """End a routine that has no instructions left; False where nothing more can run now."""
        frame = self._frames.pop()
        if self._frames:
            self._parameters.scopes.pop()
        elif self.head:
            self._end_block(frame.routine.last)
        return True

    def _abandon(self) -> None:
        """Skip the rest of a block, of which a check cannot know what it does."""
        self._interpreter.guess_positions()
        del self._frames[1:], self._parameters.scopes[1:]
        self._frames[0].at = len(self._frames[0].routine.code)

    def _go_on(self, frame: Frame, step: Instruction, error: ComputingError) -> None:
        """Go on behind a fault, in a check."""
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
