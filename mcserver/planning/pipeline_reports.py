"""What a pipeline reports of the lines that it plans."""

from __future__ import annotations

import enum

import msgspec

from mcserver.errors import Diagnostic


class ReportKind(enum.Enum):
    """What a pipeline reports."""

    PLANNED = "planned"  # the line is being planned: `requested_s`, `feed_length` are known
    SOLVED = "solved"  # inverse kinematics has solved the line: `planning_s`
    BOUND = "bound"  # a limit has stretched the line: `bound_by`
    REJECTED = "rejected"  # a fault in the line; nothing of it moves, nothing after it is read
    FINISHED = "finished"  # all that was submitted has been handed over, the end of the program included


class Report(msgspec.Struct, frozen=True):
    """One report of the planner about a line.

    Attributes:
        requested_s: time that the line asks for [s], or None.
        bound_by: the limit that stretched it, such as ``axis 2 acceleration``, or None.
        feed_length: linear length of its G01-G03 commands [m].
        planning_s: time that inverse kinematics took [s].
    """

    kind: ReportKind
    line: int
    requested_s: float | None = None
    bound_by: str | None = None
    feed_length: float = 0.0
    planning_s: float = 0.0
    diagnostics: tuple[Diagnostic, ...] = ()
