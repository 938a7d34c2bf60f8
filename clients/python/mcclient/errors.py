"""Errors, each with a stable code and a remedy.

The error tree, with the exit code that ``mcctl`` gives::

    MotionError
     +-- ConfigurationError     an endpoint or option that Zenoh refuses (3)
     +-- NobodyAnswers          no machine there, or no longer (5)
     |    +-- NoAnswerInTime    a machine is there, but a request got no answer within its deadline (5)
     +-- SeveralMachines        more than one machine is there and none was named (2)
     +-- ProtocolError          an answer that this version does not understand (1)
     +-- RequestRefused         the server refuses; the state is as it was before (1, a wrong value 2)
     +-- ProgramError           about one program; says what was accepted and done
          +-- ProgramRejected     a line with faults; nothing of it moved (4)
          +-- ProgramFaulted      a fault of the machine ended it (1)
          +-- ProgramAborted      an operator, or the loss of this client's link, ended it (1)
          +-- ProgramInterrupted  the server that ran it went away (1)
          +-- ProgramClosed       it takes no more lines: closed or ended (1)

Codes MC100 to MC529 and MC550 to MC559 come from the server (docs/wire/errors.md), MC530 to MC539 from here:
MC530 nobody answers, MC531 several machines, MC532 no answer in time, MC533 not understood, MC534
interrupted, MC535 aborted, MC536 closed, MC537 configuration, MC538 a line that cannot be sent, MC539 the
client is closed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mcclient.types import Diagnostic, Fault


class MotionError(Exception):
    """Base of all errors of this package.

    Attributes:
        code: stable code such as ``MC505``.
        message: one sentence.
        hint: the remedy; empty where nothing useful is known.
        line, column: place in the program, from 1; 0: none.
        diagnostics: faults of G-code; empty where the error is about something else.
        details: values that the code promises.
    """

    exit_code = 1

    def __init__(
        self,
        code: str,
        message: str,
        hint: str = "",
        *,
        details: Mapping[str, Any] | None = None,
        diagnostics: Sequence[Diagnostic] = (),
        line: int = 0,
    ) -> None:
        # of an error that was made of another one's text
        message = message.removeprefix(f"{code}: ")
        super().__init__(f"{code}: {message}" + (f" ({hint})" if hint else ""))
        self.code = code
        self.message = message
        self.hint = hint
        self.details = dict(details or {})
        self.diagnostics = tuple(diagnostics)
        first = self.diagnostics[0] if self.diagnostics else None
        self.line = line or (first.line if first else 0)
        self.column = first.column if first else 0


class ConfigurationError(MotionError):
    """An endpoint or option that Zenoh refuses."""

    exit_code = 3


class NobodyAnswers(MotionError):
    """No machine is there, or it is no longer there."""

    exit_code = 5


class NoAnswerInTime(NobodyAnswers):
    """The machine is there, but the request got no answer within its deadline; it may have been carried
    out.
    """


class SeveralMachines(MotionError):
    """More than one machine is there and none was named; ``details["machines"]`` lists them."""

    exit_code = 2


class ProtocolError(MotionError):
    """An answer that this version does not understand."""


class RequestRefused(MotionError):
    """The server refuses the request; the state is as it was before."""

    WRONG_VALUES = frozenset({"MC500", "MC501", "MC507", "MC511", "MC513"})

    @property
    def is_wrong_value(self) -> bool:
        """Whether another value would have been taken."""
        return self.code in self.WRONG_VALUES


class ProgramError(MotionError):
    """About one program.

    Attributes:
        program: its id.
        accepted: lines through this number were taken by the server.
        done: lines through this number have surely ended.
    """

    def __init__(
        self,
        code: str,
        message: str,
        hint: str = "",
        *,
        program: str,
        accepted: int,
        done: int,
        diagnostics: Sequence[Diagnostic] = (),
        line: int = 0,
    ) -> None:
        super().__init__(code, message, hint, diagnostics=diagnostics, line=line)
        self.program = program
        self.accepted = accepted
        self.done = done


class ProgramRejected(ProgramError):
    """A line with faults; nothing of that line has moved. ``diagnostics`` say where and why."""

    exit_code = 4


class ProgramFaulted(ProgramError):
    """A fault of the machine ended the program; ``fault`` has axis and line."""

    def __init__(self, fault: Fault, *, program: str, accepted: int, done: int) -> None:
        super().__init__(
            fault.code,
            fault.message,
            fault.hint or "clear the fault with reset, then capture the axes (G1010)",
            program=program,
            accepted=accepted,
            done=done,
            line=fault.line,
        )
        self.fault = fault


class ProgramAborted(ProgramError):
    """The program was stopped before its end; the message says why."""


class ProgramInterrupted(ProgramError):
    """The server that ran the program went away.

    Lines through ``done`` have surely ended, the one after may have begun. Axes have no energy. To go on:
    ``machine.continue_program(error.program)``.
    """


class ProgramClosed(ProgramError):
    """The program takes no more lines."""


def closed_client() -> MotionError:
    """Make the error of whoever waits for, or asks something of, a client that was closed."""
    return MotionError("MC539", "this client has been closed", "connect again: Machine.connect()")
