"""Find every fault of a program without running it (D-04)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import msgspec
from mckinematics.pose import Kinematics

from mcserver.errors import Diagnostic, ProgramRejected
from mcserver.gcode.computing.expansion import Expansion
from mcserver.gcode.computing.machine_values import Source
from mcserver.gcode.computing.macro_expansion import expansion_of
from mcserver.gcode.profiles.codes import CONSEQUENCES, LATHE, SPINDLE
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.interpreter import Interpreter
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.gcode.text.line_window import BLOCK, LineWindow
from mcserver.gcode.text.parser import ParsedLine
from mcserver.gcode.text.profile_words import ProfileWord, ProfileWords
from mcserver.gcode.text.source import split_lines
from mcserver.machine.dialect_section import CodeOutput
from mcserver.machine.machine_file import Machine
from mcserver.motion.canonical import (
    AxisLine,
    Canonical,
    DwellGroup,
    FeedGroup,
    MotionLine,
    PathBatch,
    ProbeLine,
    ThreadLine,
)

# this many changes of S while cutting mean a laser, not a spindle
CHANGES_OF_A_BEAM = 5
# a G4 this long was meant in milliseconds [s]
LONG_WAIT = 100.0
# refused codes and macros: reported once each, with the count of lines
_OF_CODES = frozenset({"MC110", "MC141", "MC145"})
# of tilted planes; also reported once
_SAID_ONCE = _OF_CODES | {"MC175"}
MOST_FAULTS = 20_000  # a file with more is not one for this machine, and its faults must not fill the memory
_COMMENTS = re.compile(r"\([^()]*\)?|;.*|%.*")


def check_program(
    text: str, machine: Machine, kinematics: Kinematics | None = None, *, at_rest: bool = False
) -> list[Diagnostic]:
    """Find every fault of a whole text as `check_lines` does."""
    return check_lines(split_lines(text), machine, kinematics, at_rest=at_rest)


def check_lines(
    lines: Iterable[str],
    machine: Machine,
    kinematics: Kinematics | None = None,
    *,
    positions: Mapping[int, float] | None = None,
    lease: frozenset[int] | None = None,
    at_rest: bool = False,
    frame: Frame | None = None,
    switches: Switches = AS_WRITTEN,
) -> list[Diagnostic]:
    """Find every fault of a program, line by line whatever its length; tools' paths are solved too.

    After a faulty line the check continues from a best guess: a motion's end counts as reached if it is
    known, and a feed or tool that could not be read causes no further faults in the lines that use it.

    Args:
        lines: without their ends.
        positions: where the axes start [m or rad]; the drives' initial positions by default.
        lease: axes that the program may use; all by default.
        at_rest: no axis is energized at the start, so warn of a first move on such axes (MC144).
        frame: work offsets at the start; None: the machine file's. switches: of the operator.

    Returns:
        The faults in reading order; the check ends after `MOST_FAULTS` (MC158).
    """
    interpreter = Interpreter(
        machine, kinematics=kinematics, positions=positions, lease=lease, frame=frame, switches=switches
    )
    survey = _Survey(machine, at_rest)
    try:
        window = LineWindow(lines)
        survey.empty = len(window.first) < BLOCK and not any(map(_code, window.first))
        expansion = expansion_of(interpreter, Source.ASSUMED)
        while not window.ended and not interpreter.ended and survey.room:
            _check_next(interpreter, expansion, window, survey)
    except ProgramRejected as rejected:
        # not text, or a line too long for any machine: other faults would be guesses
        return list(rejected.diagnostics)
    if not interpreter.ended:
        try:
            expansion.close()
        except ProgramRejected as rejected:
            survey.faults(rejected.diagnostics)
        _check_expanded(interpreter, expansion, survey)
        try:
            interpreter.check_closed()
        except ProgramRejected as rejected:
            survey.faults(rejected.diagnostics)
    for value in interpreter.finish():
        survey.value(value)
    survey.faults(_warnings_of(expansion.assumed))
    return survey.diagnostics(window.done)


def _check_next(interpreter: Interpreter, expansion: Expansion, window: LineWindow, survey: _Survey) -> None:
    """Check the next line with everything that it runs, or as many lines as can be read in columns."""
    number = window.done + 1
    most = interpreter.batch_window(number) if expansion.idle else 0
    if most:
        batch = interpreter.interpret_batch(window.peek(most), number)
        if batch is not None:
            for each in batch.values:
                if isinstance(each, PathBatch):
                    survey.batch(each)
                else:
                    survey.value(each)
            survey.without_effect(batch.without_effect)
            expansion.passed(window.peek(batch.taken), number)
            window.drop(batch.taken)
            return
    text = window.peek(1)[0]
    window.drop(1)
    try:
        expansion.take(text, number)
    except ProgramRejected as rejected:
        survey.faults(rejected.diagnostics)
    _check_expanded(interpreter, expansion, survey)


def _check_expanded(interpreter: Interpreter, expansion: Expansion, survey: _Survey) -> None:
    """Check the plain lines that the last line has expanded to."""
    while expansion.running and not interpreter.ended and survey.room:
        try:
            parsed = expansion.next()
        except ProgramRejected as rejected:
            survey.faults(rejected.diagnostics)
            continue
        if isinstance(parsed, ParsedLine):
            _check_line(interpreter, expansion, parsed, survey)


def _check_line(interpreter: Interpreter, expansion: Expansion, parsed: ParsedLine, survey: _Survey) -> None:
    capture = interpreter.capture_before(parsed)
    if capture is not None:
        survey.value(capture)
    faults, values = interpreter.check_line(parsed)
    expansion.measured.interpreted(values)
    survey.faults(faults if parsed.origin is None else survey.unreported(faults))
    if parsed.profile is not None:
        survey.profile_words(parsed.profile, parsed.number)
    for value in values:
        survey.value(value)


def _code(line: str) -> bool:
    return bool(_COMMENTS.sub("", line).strip("\ufeff \t"))


class _Survey:
    """Findings of a check: faults by line, and those reported once for the whole program.

    Attributes:
        empty: the file has no code.
    """

    def __init__(self, machine: Machine, at_rest: bool) -> None:
        self._at_rest = at_rest
        self.empty = False
        self._dialect = machine.dialect
        self._lasers = frozenset(at for at, each in enumerate(machine.outputs) if each.laser)
        self._found: list[Diagnostic] = []
        self._warnings: list[Diagnostic] = []
        # by message: index of its first fault, and count of lines
        self._refusals: dict[str, tuple[int, int]] = {}
        self._turning = False
        # code, line and column of faults of computed lines
        self._places: set[tuple[str, int, int]] = set()
        # M3 or M4 has switched on an output that follows S; first line and count of changes of S since then
        self._beam = False
        self._beam_changes = (0, 0)
        self._computes = 0
        # by code: its first line, and count of lines
        self._without_effect: dict[str, tuple[int, int]] = {}
        self._energized: set[int] = set()
        self._loose: tuple[int, tuple[int, ...]] | None = None
        # number of the last T; line and tool of the first M6
        self._tool = 0
        self._first_tool: tuple[int, int] | None = None

    def unreported(self, faults: Iterable[Diagnostic]) -> list[Diagnostic]:
        """Return the faults of a computed line that are new: a loop runs it many times."""
        found = []
        for fault in faults:
            place = fault.code, fault.line, fault.column
            if place not in self._places:
                self._places.add(place)
                found.append(fault)
        return found

    @property
    def room(self) -> bool:
        """Whether there is room for further faults."""
        return len(self._found) < MOST_FAULTS

    def faults(self, faults: Iterable[Diagnostic]) -> None:
        """Add the faults of a line; for a program that computes, only the fault that it does."""
        for fault in faults:
            if fault.code == "MC140":
                self._computes += 1
                if self._computes == 1:
                    self._found = [fault]
            elif fault.code in _SAID_ONCE and not (self._computes or self._dialect.reference):
                self._refused(fault)
            elif fault.severity == "warning":
                if len(self._warnings) < MOST_FAULTS:
                    self._warnings.append(fault)
            elif not self._computes:
                self._found.append(fault)

    def _refused(self, fault: Diagnostic) -> None:
        """Add a refused code, once for the program, at its first line."""
        first, count = self._refusals.get(fault.message, (len(self._found), 0))
        self._refusals[fault.message] = first, count + 1
        if count:
            return
        if fault.message.partition(":")[0] in LATHE and not self._turning:
            self._turning = True
            message = "this is a program for a lathe, which this machine's profile does not read"
            hint = "G50, G71, X in diameters and G99 mean something else here"
            self._found.append(Diagnostic("MC147", message, fault.line, hint=hint))
            first += 1
            self._refusals[fault.message] = first, 1
        self._found.append(fault)

    def profile_words(self, words: ProfileWords, line: int) -> None:
        """Note the codes of a line that have no effect on this machine."""
        codes, outputs = list(words.ignored), self._dialect.outputs
        self._follow_beam({action.code for action in words.actions}, line)
        for action in words.actions:
            code = action.code
            if code == "T":
                self._tool = int(action.words["T"].value)
            elif code == "G4" and "P" in action.words:
                self._long_dwell(action.words["P"], line)
            elif code == "M6" and self._first_tool is None and self._dialect.tool_change == "pause":
                self._first_tool = line, self._tool
            # if outputs are mapped to one of M3 to M5, the others are refused, not without effect
            same = SPINDLE if code in SPINDLE else {code}
            mapped = (
                bool(same & self._dialect.mapped)
                if code != "S"
                else any(map(_follows_speed, outputs.values()))
            )
            idle = (code in ("M3", "M4", "M5", "S") and self._dialect.spindle is None and not mapped) or (
                action.code == "M6" and self._dialect.tool_change == "ignore"
            )
            if idle:
                codes.append(action.code)
        self.without_effect({code: (line, codes.count(code)) for code in codes})

    def _long_dwell(self, word: ProfileWord, line: int) -> None:
        """Warn of a P that was probably meant in milliseconds (MC129)."""
        seconds = word.value * self._dialect.dwell_unit
        if self._dialect.dwell_unit < 1.0 or seconds < LONG_WAIT or len(self._warnings) >= MOST_FAULTS:
            return
        hint = 'if its post writes milliseconds, say so in the machine file: [dialect] dwell = "ms"'
        self._warnings.append(_warning("MC129", f"G4 P{word.text} waits {seconds:g} s", line, hint))

    def _follow_beam(self, codes: set[str], line: int) -> None:
        """Count changes of S at which motion stops while an output that follows S is on (D-73).

        A laser's output keeps to the path and is not counted.
        """
        switching = codes & SPINDLE
        if switching:
            outputs = self._dialect.outputs
            on = any(_follows_speed(outputs.get(code, ()), self._lasers) for code in codes & {"M3", "M4"})
            self._beam = on and self._dialect.profile != "printer"
        elif self._beam and "S" in codes:
            first, count = self._beam_changes
            self._beam_changes = first or line, count + 1

    def without_effect(self, words: Mapping[str, tuple[int, int]]) -> None:
        """Add codes and letters without effect, each with its first line and count of lines."""
        for code, (line, more) in words.items():
            first, count = self._without_effect.get(code, (line, 0))
            self._without_effect[code] = first, count + more

    def value(self, value: Canonical) -> None:
        """Track which axes are energized."""
        if isinstance(value, AxisLine):
            if value.operation.energized:
                self._energized |= set(value.axes)
            elif value.operation.energized is False:
                self._energized -= set(value.axes)
        elif isinstance(value, ProbeLine | ThreadLine):
            self.motion(value.axes, value.line)
        elif isinstance(value, MotionLine):
            for group in value.groups:
                if isinstance(group, FeedGroup):
                    self.motion(group.axes, value.line)
                elif not isinstance(group, DwellGroup):
                    self._energized |= set(group.axes)

    def batch(self, batch: PathBatch) -> None:
        """Note the first line of a batch that moves axes which are not energized."""
        if self._loose is None:
            found = batch.first_beyond(self._energized)
            if found is not None:
                self.motion(found[1], found[0])

    def motion(self, axes: tuple[int, ...], line: int) -> None:
        """Note the first G01-G03 on axes which are not energized."""
        if self._loose is None and not self._energized.issuperset(axes):
            self._loose = line, tuple(sorted(set(axes) - self._energized))

    def diagnostics(self, last: int) -> list[Diagnostic]:
        """Return all findings in the program's order; ``last``: the last line that was read."""
        if self._computes:
            # nothing is known of its words and their effects: further faults would be guesses
            (fault,) = self._found
            lines = "a line of it" if self._computes == 1 else f"{self._computes} lines of it"
            return [msgspec.structs.replace(fault, message=f"{fault.message} ({lines})")]
        for message, (index, count) in self._refusals.items():
            if count > 1:
                fault = self._found[index]
                self._found[index] = msgspec.structs.replace(fault, message=f"{message} ({count} lines)")
        said = list(self._warnings)
        if not self.room:
            message = f"the check ends here, with {len(self._found)} faults"
            hint = "is it a file for this machine? See the profile of its dialect"
            said.append(Diagnostic("MC158", message, last, hint=hint))
        if self._loose is not None and self._at_rest and not self._found:
            line, axes = self._loose
            names = ", ".join(str(axis) for axis in axes)
            message = f"nothing before this move energizes {'axes' if axes[1:] else 'axis'} {names}"
            hint = 'write G1010 ahead of it, or set [dialect] capture = "auto" in the machine file'
            said.append(_warning("MC144", message, line, hint, axes[0]))
        if self.empty and self._at_rest and not self._found:
            message = "the file has no code: nothing would run"
            said.append(_warning("MC157", message, 1, "is it the right file?"))
        if self._first_tool is not None and self._first_tool[1] > 0:
            line, tool = self._first_tool
            message = f"the program begins with tool {tool}, which counts as fitted: no pause here"
            hint = 'fit it before the start, or let M6 ask: [dialect] tool_change = "ask"'
            said.append(_warning("MC154", message, line, hint))
        line, changes = self._beam_changes
        if changes >= CHANGES_OF_A_BEAM:
            said.append(
                _warning(
                    "MC148",
                    f"S changes on {changes} lines while M3 or M4 is on: the motion stops at each, with the "
                    "output on, and G00 does not switch it off",
                    line,
                    "right for a spindle; a laser burns there: give its [[output]] in the machine file "
                    "laser = true. M67 E Q changes an output without a stop",
                )
            )
        if self._without_effect:
            first = min(line for line, _ in self._without_effect.values())
            counted = (f"{code} ({count})" for code, (_, count) in sorted(self._without_effect.items()))
            message = f"accepted without effect on this machine: {', '.join(counted)}"
            hint = "; ".join(["the numbers in brackets count their lines", *self._consequences()])
            said.append(_warning("MC142", message, first, hint))
        found = self._of_turning() if self._turning else self._found
        return sorted([*found, *said], key=lambda each: each.line) if said else found

    def _consequences(self) -> list[str]:
        """Describe the effects on the print of codes without effect."""
        if self._dialect.profile != "printer":
            return []
        return [
            f"{', '.join(of)}: {what}"
            for pattern, what in CONSEQUENCES
            if (of := sorted(code for code in self._without_effect if pattern.match(code)))
        ]

    def _of_turning(self) -> list[Diagnostic]:
        """Return the faults of a lathe's program: only its lathe codes, from which all others follow."""
        kept = [each for each in self._found if each.code in ("MC147", *_OF_CODES)]
        hidden = len(self._found) - len(kept)
        if not hidden:
            return kept
        rest = f"; {hidden} more fault{'s' * (hidden > 1)} of it {'are' if hidden > 1 else 'is'} not shown"
        return [
            msgspec.structs.replace(each, message=each.message + rest) if each.code == "MC147" else each
            for each in kept
        ]


def _warning(code: str, message: str, line: int, hint: str, axis: int | None = None) -> Diagnostic:
    return Diagnostic(code, message, line, hint=hint, severity="warning", axis=axis)


def _follows_speed(settings: tuple[CodeOutput, ...], but: frozenset[int] = frozenset()) -> bool:
    return any(each.value is None and each.column not in but for each in settings)


def _warnings_of(assumed: Mapping[str, int]) -> list[Diagnostic]:
    """Return warnings for the values that a check assumed (MC166)."""
    said = "what the program does depends on what it measures; this check assumes:"
    hint = "as it runs, or is simulated, it may take another way"
    return [_warning("MC166", f"{said} {what}", line, hint) for what, line in assumed.items()]
