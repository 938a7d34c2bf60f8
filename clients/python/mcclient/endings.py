"""How a program can end, as errors that say what was accepted, what was done and how to go on."""

from __future__ import annotations

from typing import NamedTuple

from mcclient.errors import (
    MotionError,
    NobodyAnswers,
    ProgramAborted,
    ProgramClosed,
    ProgramFaulted,
    ProgramInterrupted,
    ProgramRejected,
)
from mcclient.types import Diagnostic, Fault


class Extent(NamedTuple):
    """How far a program came."""

    program: str
    accepted: int
    done: int


def ending(
    state: str, extent: Extent, fault: Fault | None, diagnostics: tuple[Diagnostic, ...], reason: str = ""
) -> MotionError | None:
    """Return the error for a program that has ended in this state; None where it has ended well."""
    if state == "finished":
        return None
    if state == "faulted":
        fault = fault or Fault("MC400", "a fault of the machine ended the program")
        return ProgramFaulted(fault, **extent._asdict())
    if state == "rejected":
        return rejected(diagnostics[0].line if diagnostics else extent.accepted + 1, extent, diagnostics)
    if state == "interrupted":
        return interrupted(extent)
    why = f" ({reason})" if reason else ""
    return ProgramAborted(
        "MC535",
        f"the program was aborted{why}; lines through {extent.done} are done",
        "once the machine is clear, open another one with machine.program()",
        **extent._asdict(),
    )


def rejected(line: int, extent: Extent, diagnostics: tuple[Diagnostic, ...]) -> ProgramRejected:
    first = diagnostics[0] if diagnostics else Diagnostic("MC100", f"line {line} was rejected", line=line)
    return ProgramRejected(
        first.code,
        first.message,
        first.hint,
        **extent._asdict(),
        diagnostics=diagnostics or (first,),
        line=line,
    )


def interrupted(extent: Extent) -> ProgramInterrupted:
    following = extent.done + 1
    more = f", line {following} of {extent.accepted} may have begun" if following <= extent.accepted else ""
    return ProgramInterrupted(
        "MC534",
        f"the server that ran the program went away; lines through {extent.done} are done{more}",
        f"once the machine is clear, machine.continue_program({extent.program!r}), or mcctl continue",
        **extent._asdict(),
    )


def closed(state: str, extent: Extent) -> ProgramClosed:
    return ProgramClosed(
        "MC536",
        f"the program takes no more lines: it is {state}",
        "open another one with machine.program()",
        **extent._asdict(),
    )


def gone(error: NobodyAnswers, extent: Extent) -> NobodyAnswers:
    return NobodyAnswers(
        error.code,
        f"{error.message}; of program {extent.program} lines through {extent.accepted} were accepted "
        f"and through {extent.done} done",
        "once the server is back, mcctl programs tells how far it came",
        details=extent._asdict(),
    )
