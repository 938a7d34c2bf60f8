"""Collect the faults of a line before it takes effect (D-04)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import NamedTuple

import msgspec

from mcserver.errors import Diagnostic, Edit, ProgramRejected, Severity

Span = tuple[int, int]


class Origin(NamedTuple):
    """Source of a computed line.

    Attributes:
        line: in the text, or in a file of the machine's. columns: maps columns to those of that line.
        file: its name; empty: the text itself.
    """

    line: int
    columns: Callable[[Span], Span] = lambda span: span
    file: str = ""


# a code's title is the first line of a rendered diagnostic; the message has the values
TITLES: Mapping[str, str] = MappingProxyType(
    {
        "MC100": "the program is no text",
        "MC101": "the letter O stands where a digit 0 is meant",
        "MC102": "this is not a number",
        "MC103": "this is not a word",
        "MC104": "the chord is longer than the diameter",
        "MC105": "this character cannot stand in code",
        "MC106": "the comment's parentheses do not match",
        "MC107": "the comma group is empty",
        "MC108": "there is no such axis",
        "MC109": "the axis is outside the program's lease",
        "MC110": "unknown code",
        "MC111": "the word stands twice in one command",
        "MC112": "the command does not take this word",
        "MC113": "the words belong to no command",
        "MC114": "one axis is moved twice in one line",
        "MC115": "these commands cannot stand together",
        "MC116": "the number is out of range",
        "MC117": "the line number does not fit",
        "MC118": "a word is missing",
        "MC120": "the feed rate must be above zero",
        "MC121": "no feed rate is in force",
        "MC122": "G94 has no speed for these axes",
        "MC123": "the feed is per revolution",
        "MC128": "there are no turns for a feed per turn",
        "MC129": "the dwell is long",
        "MC130": "the arc is not defined",
        "MC131": "the offset lies outside the arc's plane",
        "MC132": "the arc's plane is not clear",
        "MC133": "the arc's start and end radius differ",
        "MC134": "an arc with R needs two different points",
        "MC135": "the arc's radius is zero",
        "MC136": "the number of turns does not fit",
        "MC137": "an arc needs linear axes",
        "MC138": "the axis follows no path",
        "MC139": "the arc all but closes",
        "MC140": "the program computes",
        "MC141": "this is not done here",
        "MC142": "codes without effect",
        "MC143": "there is no such entry",
        "MC144": "the axes are not energized",
        "MC145": "a macro of another controller",
        "MC146": "the canned cycle cannot be drilled",
        "MC154": "the first tool counts as fitted",
        "MC147": "the program is for a lathe",
        "MC148": "the motion stops with the beam on",
        "MC150": "there is no such input or output",
        "MC151": "the output cannot have this value",
        "MC152": "M66 does not say what it waits for",
        "MC156": "the file has a line that no machine takes",
        "MC157": "there is no code",
        "MC158": "too many faults",
        "MC159": "M4 does not go with a tool's speed",
        "MC160": "the expression cannot be read",
        "MC161": "the O-words do not fit together",
        "MC162": "there is no such parameter",
        "MC163": "the expression has no value",
        "MC164": "the program computes too much",
        "MC165": "there is no such subprogram",
        "MC166": "measured values are assumed",
        "MC167": "the program cannot start at this line",
        "MC168": "a measured value is not known",
        "MC169": "the cutter would cut into the part",
        "MC170": "this does not go with cutter compensation",
        "MC171": "the machine cannot lead a tip",
        "MC172": "this does not go with tool centre point control",
        "MC173": "the pitch is that of no thread",
        "MC174": "an offset counts while its system is to be turned",
        "MC175": "this does not go with a tilted plane",
        "MC176": "the tool cannot be turned there",
        "MC177": "the machine has no spindle that a thread can follow",
        "MC178": "the spindle does not turn for the thread",
        "MC179": "the thread is too fast for the axes",
        "MC180": "the thread cannot be made like this",
        "MC181": "the macro statement cannot be read",
        "MC182": "the program has no end where it needs one",
        "MC183": "there is no such block",
        "MC184": "the program stops itself with an alarm",
        "MC185": "this does not go with turned or scaled coordinates",
        "MC186": "controllers differ in where this goes",
        "MC187": "controllers differ in this position",
        "MC188": "the words of a rotation, a scaling or polar coordinates do not fit",
        "MC189": "the curve cannot be made like this",
        "MC194": "the retraction cannot be made",
        "MC198": "there is one block delete switch",
        "MC199": "this means something else on another controller",
        "MC155": "the probing move cannot be made",
        "MC153": "words of two codes would be mixed up",
        "MC201": "the move leaves the axis's travel",
        "MC202": "the speed is above the axis's limit",
        "MC203": "constant surface speed cannot be kept here",
        "MC204": "the body cannot be read",
        "MC205": "the machine judges no bodies",
        "MC206": "a program brings no files",
        "MC207": "the program brings too many bodies",
        "MC208": "the state cannot be saved, or not be brought back",
        "MC310": "there is no such tool",
        "MC311": "the tool takes no orientation",
        "MC312": "axes cannot be named while a tool is in force",
        "MC313": "tools need inverse kinematics",
        "MC314": "a joint cannot be held still on the path",
        "MC345": "the axis follows another one",
        "MC346": "the axis cannot be coupled",
        "MC347": "the program cannot start where an axis follows another one",
    }
)


def in_file(fault: Diagnostic, file: str, line: int) -> Diagnostic:
    """Return a fault of a called file as a fault of the calling line."""
    message = f"{file}, line {fault.line}: {fault.message}"
    return msgspec.structs.replace(fault, message=message, line=line, column=0, end_column=0, edit=None)


class FaultList:
    """Collects the diagnostics of one line, in the order in which they are reported."""

    __slots__ = ("found", "line", "origin")

    def __init__(self, line: int, origin: Origin | None = None) -> None:
        self.line = line
        self.origin = origin
        self.found: list[Diagnostic] = []

    def add(
        self,
        code: str,
        message: str,
        span: Span,
        hint: str = "",
        *,
        axis: int | None = None,
        tool: int | None = None,
        residual_mm: float | None = None,
        edit: Edit | None = None,
        severity: Severity = "error",
    ) -> None:
        """Report a fault; ``span`` is (column, end column), from 1, end exclusive. Warnings stop nothing.

        ``edit`` is given only if there is one certain remedy: the line then means what its writer meant.
        """
        self.found.append(
            Diagnostic(
                code=code,
                message=message,
                line=self.line,
                column=span[0],
                end_column=span[1],
                hint=hint,
                axis=axis,
                tool=tool,
                residual_mm=residual_mm,
                edit=edit,
                severity=severity,
            )
        )

    def in_reading_order(self) -> tuple[Diagnostic, ...]:
        """Return the diagnostics by column; for a computed line, in columns of its source."""
        found = self.found
        if self.origin is not None:
            line, columns, file = self.origin
            placed = ((fault, *columns((fault.column, fault.end_column))) for fault in found)
            found = [
                msgspec.structs.replace(fault, line=line, column=first, end_column=last, edit=None)
                for fault, first, last in placed
            ]
            if file:
                found = [in_file(fault, file, self.line) for fault in found]
        return tuple(sorted(found, key=lambda fault: (fault.column, fault.end_column)))

    def raise_if_any(self) -> None:
        """Raise if the line has a fault.

        Raises:
            ProgramRejected: with every fault of the line.
        """
        errors = tuple(fault for fault in self.in_reading_order() if fault.severity == "error")
        if errors:
            raise ProgramRejected(errors)
