"""Expand a program in Fanuc's macro B, while it runs, to plain lines (D-91 to D-93).

A line of the main program carries its own number when first reached; lines that run again, or in a
subprogram, carry that of the furthest line reached so far. So the line numbers of motion never decrease. If
the next step needs lines that have not arrived (a subprogram after M30, the block that GOTO names), the
expansion waits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from mcserver.gcode.computing.expansion import DEEPEST_CALL, Expansion, Frame
from mcserver.gcode.computing.expressions import NULL, ComputingError
from mcserver.gcode.computing.line_template import Setting
from mcserver.gcode.computing.machine_values import Source, Unsettled
from mcserver.gcode.computing.macro_lines import (
    LOCALS,
    MOST_REPEATS,
    MacroProgram,
    Step,
    blank_comments,
    program_number,
)
from mcserver.gcode.computing.o_words import MOST_CHARACTERS, MOST_LINES, Instruction, Routine
from mcserver.gcode.computing.parameters import ComputedState, ParameterTable
from mcserver.gcode.line_faults import Origin, Span
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.source import split_lines

_COMMON = (range(100, 200), range(500, 1000))
# they keep values of earlier programs, so that one without is a mistake
_KEPT = _COMMON[1]
_ALARM = 3000
_COUNTED_TWICE = 10_000
# numbered parameters of positions, the first of nine: in the machine's zero, or not
_POSITIONS: Mapping[int, bool] = MappingProxyType({5001: False, 5021: True, 5041: False})
# the same as LinuxCNC's: a probe's result, origins of work coordinate systems, and the fitted tool
_SHARED = (range(5061, 5070), range(5221, 5330), range(5400, 5401))
_MODAL: Mapping[int, Callable[[Callable[[str], float]], float]] = MappingProxyType(
    {
        4001: lambda of: of("_motion_mode") / 10.0 if of("_motion_mode") <= 30.0 else 0.0,
        4002: lambda of: of("_plane") / 10.0,
        4003: lambda of: 90.0 if of("_absolute") else 91.0,
        4005: lambda of: 93.0 if of("_inverse_time") else 94.0 + of("_units_per_rev"),
        4006: lambda of: 21.0 if of("_metric") else 20.0,
        4010: lambda of: 98.0 if of("_retract_old_z") else 99.0,
        4014: lambda of: of("_coord_system") / 10.0,
        4109: lambda of: of("_feed"),
        4119: lambda of: of("_rpm"),
        4120: lambda of: of("_selected_tool"),
    }
)


class _NeedsText(Exception):
    """The next step needs lines that have not arrived; ``met`` tests for them, ``what`` describes them."""

    def __init__(self, what: str, met: Callable[[], bool]) -> None:
        super().__init__()
        self.what = what
        self.met = met


@dataclass(slots=True, eq=False)
class _Call(Frame):
    """A running program, its runs left, and the arguments of each run (None: M98)."""

    routine: MacroProgram
    times: int = 1
    arguments: tuple[float, ...] | None = None


class MacroExpansion(Expansion):
    """Expands one program in macro B; see `Expansion`."""

    def __init__(self, interpreter: Interpreter, source: Source = Source.MACHINE) -> None:
        self._main = MacroProgram("", 1)
        self._current = self._main
        self._programs: dict[str, MacroProgram] = {}
        self._lines: dict[int, str] = {}
        self._characters = 0
        # of the main program: whether a line with code has come, whether its first lines were discarded
        self._begun = self._forgotten = False
        self._reached = self._last = 0
        self._met: Callable[[], bool] | None = None
        self._wants = ""
        self._repeating = self._given = self._ran_out = False
        self._back: tuple[Instruction, str] | None = None
        super().__init__(interpreter, source)
        # the first is the main program and is never removed
        self._calls = [_Call(self._main)]
        self._frames = self._calls  # type: ignore[assignment]
        self._calls[0].at = len(self._main.code)
        self._note()

    def _table(self, kept: ComputedState) -> ParameterTable:
        return ParameterTable(kept, LOCALS, NULL, self._interpreter.machine.dialect.persistent)

    def _restore(self, kept: ComputedState) -> None:
        for number, text in sorted(kept.subprograms.items()):
            self._append(text, number)
        self._reached = self._last
        self._parameters = self._table(kept)

    # ------------------------------------------------------------ state

    @property
    def idle(self) -> bool:
        """Whether the next line can be read without expansion."""
        return not (self.running or self.head or self._main.in_loop) and self._current is self._main

    @property
    def running(self) -> bool:
        """Whether `next` has to be called before the next `take`."""
        if self._ready is not None:
            return True
        more = self._given or len(self._calls) > 1 or self._calls[0].at < len(self._main.code)
        return more and self._met is None and not self._ran_out

    @property
    def in_block(self) -> bool:
        """Whether a line is running whose effects cannot be undone."""
        return self.head > 0 and self._met is None

    def kept(self) -> ComputedState | None:
        """Return parameters and text, between two lines of the main program; None if there are none.

        Raises:
            ProgramRejected: MC167 the line before waits for later text.
        """
        if self.head:
            raise self._rejected(
                ComputingError(
                    "MC167",
                    f"line {self.head} goes by {self._wants or 'text'}, which stands behind the line to start"
                    " at: nothing says how it leaves the machine",
                    (0, 0),
                    f"start at line {self.head} or before it"
                    + (f", or put {self._wants} into [dialect] subroutines" * self._wants.startswith("O")),
                ),
                self.head,
            )
        self._texts = self._lines
        return super().kept()

    def _note(self) -> None:
        """Update `head` and `through`."""
        main, code = self._calls[0], self._main.code
        pending = main.at < len(code)
        after = code[main.at].line if pending else self._last + 1
        if after > self._reached:
            self._repeating = False
        within = len(self._calls) > 1 or self._met is not None or self._repeating
        if not within and (not code or code[-1].line <= self._reached):
            self.head, self.through = 0, max(self.through, self._reached)
        elif within or self._given or after <= self._reached:
            self.head, self.through = self._reached, self._reached - 1
        else:
            self.head, self.through = after * pending, after - 1

    # ------------------------------------------------------------ text

    def passed(self, texts: Sequence[str], number: int) -> None:
        """Note lines that were read without `take`; the first is line ``number``."""
        for line, text in enumerate(texts, number):
            self._append(text, line)
            self._calls[0].at = len(self._main.code)
            self._reached = line
        self._note()

    def close(self) -> None:
        """Note that the text has ended: `next` continues what waited for more text, or refuses it."""
        self._current.closed = True
        for program in self._programs.values():
            program.closed = True
        self._main.closed = True
        self._met = None

    def drop(self) -> None:
        """Discard what is running, and the last line if nothing of it has run."""
        self._ready, self._met, self._given = None, None, False
        self._due.clear()
        del self._parameters.scopes[1:], self._calls[1:]
        if not self.head and self._last == self._given_number > 0:
            self._main.cut(self._last)
            self._lines.pop(self._last, None)
            self._reached = self._last = self._last - 1
        self._calls[0].at = len(self._main.code)

    def _compute(self, text: str, number: int) -> bool:
        """Accept a line; every line is compiled."""
        if self._begun and program_number(text) is not None and self._current is self._main and self.idle:
            # nothing waits for later lines
            self._ran_out = self._tolerant
            if self._tolerant:
                self._append(text, number)
            raise ComputingError(
                "MC182",
                "the program runs on into its subprograms",
                (1, len(text) + 1),
                "write M30 ahead of them",
            )
        self._append(text, number)
        if self._met is not None and self._met():
            self._met = None
        self._note()
        return True

    def _append(self, text: str, number: int) -> None:
        if len(self._lines) >= MOST_LINES or self._characters + len(text) > MOST_CHARACTERS:
            self._forget(len(text))
        name = program_number(text)
        if name is None or not self._begun:
            self._current.add(text, number)
            bare = blank_comments(text).strip()
            self._begun |= bool(bare) and name is None and not bare.startswith("%")
        else:
            self._begin(name, number, len(text))
        if self._current is self._main:
            self._last = number
        self._lines[number] = text
        self._characters += len(text)

    def _begin(self, name: str, number: int, length: int) -> None:
        before = self._programs.get(name)
        if before is not None or name in self._interpreter.machine.dialect.subroutines:
            place = f"line {before.first}" if before and not before.file else "the machine's folder"
            raise ComputingError("MC181", f"O{name} stands in {place} already", (1, length + 1), "rename one")
        self._current.closed = True
        self._current = self._programs[name] = MacroProgram(name, number)

    def _forget(self, length: int) -> None:
        """Discard the lines of the main program so far, to which nothing jumps back any more."""
        needed = self._current is not self._main or self._main.in_loop or self._last > self._reached
        if needed and not self._tolerant:
            raise self._too_much(length)
        self._forgotten = True
        self._lines.clear()
        self._characters = 0
        if needed:
            # a check reports it once, and continues after what waits
            self._abandon()
            self._met = None
            self._reached = self._last
        self._main.clear()
        self._calls[0].at = 0
        if needed:
            raise self._too_much(length)

    def _too_much(self, length: int) -> ComputingError:
        return ComputingError(
            "MC164",
            f"more than {MOST_LINES} lines or {MOST_CHARACTERS >> 20} MB of macro B are to be kept",
            (1, length + 1),
            "write subprograms and loops ahead of the long part",
        )

    # ------------------------------------------------------------ run

    def next(self) -> ParsedLine | Unsettled | None:
        """Return the next plain line, as `Expansion.next`."""
        self._given = False
        try:
            found = super().next()
            self._given = isinstance(found, ParsedLine)
        except _NeedsText as needed:
            self._met, self._wants, found = needed.met, needed.what, None
        finally:
            self._note()
        return found

    @property
    def _counted(self) -> int:
        return self._reached

    def _loop(self) -> tuple[Instruction, str]:
        return super()._loop() if self._back is None else self._back

    def _step(self, frame: Frame, step: Instruction) -> ParsedLine | None:
        assert isinstance(frame, _Call)
        assert isinstance(step, Step)
        if len(self._calls) == 1:
            self._reached = max(self._reached, step.line)
        if step.kind == "line" and step.template is None:
            frame.at += 1
            if not step.text:
                return None
            parsed = self._interpreter.parse(step.text, self._reached)
            if step.line != self._reached or self._repeating or frame.routine.file:
                parsed.origin = Origin(step.line, file=frame.routine.file)
            return parsed
        if step.kind == "goto":
            self._go(frame, step, frame.routine, frame.at + 1)
        elif step.kind in ("program", "macro"):
            self._call(frame, step)
        elif step.kind == "end":
            self._return(frame, step)
        else:
            at = frame.at
            found = super()._step(frame, step)
            if step.kind == "test" and frame.at < 0:
                frame.at = at
                if frame.routine.closed:
                    raise ComputingError("MC181", "the END of this loop is missing", step.span, "add it")
                raise _NeedsText("the END of a loop", lambda: step.target >= 0 or frame.routine.closed)
            if step.kind == "jump" and step.target <= at:
                self._turn_back(frame.routine, frame.routine.code[step.target])
            return found
        return None

    def _turn_back(self, program: MacroProgram, loop: Instruction) -> None:
        self._back = loop, program.file
        self._repeating |= len(self._calls) == 1

    def _whole(self, value: float, what: str, step: Step) -> int:
        if math.isnan(value):
            return 0
        if abs(value - round(value)) > 1e-6 or value < 1.0:
            raise ComputingError("MC181", f"{what}{value:g} is no number", step.span, "write a whole one")
        return round(value)

    def _go(self, frame: _Call, step: Step, program: MacroProgram, start: int) -> None:
        """Jump to a block of a program: the next one of that number, else the first."""
        number = self._whole(step.values[0](self), "N", step)
        if not number:
            self._abandon()
            return
        at = program.labels.get(number, [])
        ahead = [each for each in at if each >= start]
        if not ahead and not program.closed:
            raise _NeedsText(
                f"block N{number}", lambda: program.labels.get(number, [-1])[-1] >= start or program.closed
            )
        if not at:
            hint = "the number must stand in the same program"
            if self._forgotten and program is self._main:
                hint = f"of lines further back than {MOST_LINES} nothing is kept: use WHILE or a subprogram"
            raise ComputingError("MC183", f"there is no block N{number}", step.span, hint)
        frame.at = (ahead or at)[0]
        if not ahead:
            self._turn_back(program, step)

    def _call(self, frame: Frame, step: Instruction) -> None:
        assert isinstance(step, Step)
        number = self._whole(step.values[0](self), "P", step)
        given = step.values[1](self) if len(step.values) > 1 else 1.0
        times = 0 if given == 0.0 else self._whole(given, "L", step)
        if len(step.values) == 1 and step.kind == "program" and number >= _COUNTED_TWICE:
            times, number = divmod(number, _COUNTED_TWICE)
        if not number:
            self._abandon()
            return
        program = self._programs.get(str(number))
        if program is None:
            found = self._of_file(str(number), step)
            assert found is None or isinstance(found, MacroProgram)
            program = found
        if program is None and self._current.closed:
            files = self._interpreter.machine.dialect.subroutines
            known = ", ".join(f"O{each}" for each in sorted({*self._programs, *files})[:20]) or "none"
            raise ComputingError(
                "MC165",
                f"there is no subprogram O{number}",
                step.span,
                f"write O{number} … M99 behind M30 in this file, or name the folder of its file in the "
                f"machine file: [dialect] subroutines; there is {known}",
            )
        if program is None:
            raise _NeedsText(f"O{number}", lambda: str(number) in self._programs or self._current.closed)
        if times > MOST_REPEATS:
            raise ComputingError("MC164", f"{times} repetitions of O{number}", step.span, "9999 at most")
        if len(self._calls) > DEEPEST_CALL:
            raise ComputingError(
                "MC164", f"calls stand more than {DEEPEST_CALL} deep", step.span, "does it call itself?"
            )
        arguments: tuple[float, ...] | None = None
        if step.kind == "macro":
            each = {at: value(self) for at, value in step.arguments.items()}
            arguments = tuple(each.get(at, NULL) for at in range(1, LOCALS + 1))
        frame.at += 1
        if times:
            self._calls.append(_Call(program, times=times, arguments=arguments))
            if arguments is not None:
                self._parameters.scopes.append(self._parameters.scope(arguments))

    def _compile_file(self, name: str, text: str) -> Routine:
        program = MacroProgram(name, 1)
        begun = False
        for number, line in enumerate(split_lines(text), start=1):
            here = program_number(line)
            bare = blank_comments(line).strip()
            try:
                if here is not None and (begun or here != name):
                    raise ComputingError("MC181", f"O{here} is another program", (1, len(line) + 1))
                if begun:
                    program.add(line, number)
                elif here is None and bare and not bare.startswith("%"):
                    raise ComputingError("MC181", f"O{name} is missing ahead of this line", (1, 2))
            except ComputingError as error:
                error.line = number
                raise
            begun |= here is not None
        program.closed = True
        self._programs[name] = program
        return program

    def _return(self, frame: _Call, step: Step) -> None:
        """End a subprogram at M99, or repeat it."""
        if len(self._calls) == 1:
            if not step.values:
                raise ComputingError(
                    "MC182",
                    "M99 lets the main program begin again, for ever",
                    step.span,
                    "end it with M30; a subprogram begins with its number, such as O1000",
                )
            self._go(frame, step, self._main, frame.at + 1)
            return
        if frame.times > 1:
            frame.times -= 1
            frame.at = 0
            self._turn_back(frame.routine, step)
            if frame.arguments is not None:
                self._parameters.scopes[-1] = self._parameters.scope(frame.arguments)
            return
        caller = self._calls[-2]
        if step.values:
            self._go(caller, step, caller.routine, caller.at)
        if len(self._calls) == 1:
            return  # abandoned
        self._calls.pop()
        if frame.arguments is not None:
            self._parameters.scopes.pop()

    def _end_routine(self) -> bool:
        """Wait for more lines, or refuse a program without an end before the next one."""
        frame = self._calls[-1]
        program = frame.routine
        if program is self._main and (self._current is program or self._ran_out):
            return False
        if not program.closed:
            raise _NeedsText("the M99", lambda: frame.at < len(program.code) or program.closed)
        self._abandon()
        self._ran_out = program is self._main
        word = "M30" if program is self._main else "M99"
        error = ComputingError(
            "MC182",
            f"behind this line a program begins, and no {word} ends this one",
            (1, 2),
            f"write {word}",
        )
        raise self._rejected(error, program.last, program.file)

    # ------------------------------------------------------------ parameters

    def numbered(self, number: int, span: Span) -> float:
        """Return a numbered parameter (`expressions.Values`)."""
        if number <= LOCALS or number in _COMMON[0]:
            return self._parameters.numbered(number)
        if number in _KEPT:
            if self._parameters.has(number):
                return self._parameters.numbered(number)
            hint = "set it first, here or in an earlier program on this server"
            raise ComputingError("MC162", f"#{number} has no value yet", span, hint)
        if number in _MODAL:
            return _MODAL[number](lambda name: self.measured.named(name, span) or 0.0)
        for first, absolute in _POSITIONS.items():
            if first <= number < first + 9:
                return self.measured.position(number - first, span, absolute=absolute)
        found = None
        if any(number in each for each in _SHARED):
            found = self.measured.numbered(number, span)
        if found is None:
            raise ComputingError("MC162", f"#{number} is not known here", span, "see docs/dialect.md, D-93")
        return found

    def _check_setting(self, setting: Setting) -> None:
        number, span = setting.number, setting.parameter.span
        if number == _ALARM:
            frame = self._calls[-1]
            step = frame.routine.code[frame.at]
            assert isinstance(step, Step)
            said = step.text.partition("(")[2].partition(")")[0].strip()
            raise ComputingError(
                "MC184",
                f"the program stops itself with alarm {_ALARM + setting.value:g}{said and f': {said}'}",
                span,
                "see the conditions that lead to its line",
            )
        if number > LOCALS and not any(number in each for each in _COMMON):
            raise ComputingError("MC162", f"#{number} is not set here", span, "see docs/dialect.md, D-93")
        super()._check_setting(setting)


def expansion_of(interpreter: Interpreter, source: Source = Source.MACHINE) -> Expansion:
    """Return the expansion for a program, by the macro language of its machine's dialect."""
    language = MacroExpansion if interpreter.machine.dialect.fanuc else Expansion
    return language(interpreter, source)
