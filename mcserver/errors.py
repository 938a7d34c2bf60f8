"""Errors and diagnostics, each with a stable code and a remedy.

Code ranges::

    MC0xx  command line, machine file, this computer
    MC1xx  words, grammar, modal state, geometry and time of one program
    MC2xx  limits of the machine, found before anything moves
    MC3xx  tools and inverse kinematics
    MC4xx  running: drives, following error, exact stop, lost processes
    MC5xx  service: programs, leases, numbering, protocol

The error tree::

    McError
     +-- UsageFault            an argument that cannot be meant as it stands (exit code 2)
     +-- NobodyAnswers         no server where one was expected (exit code 5)
     +-- ConfigurationError    a machine file that does not fit (exit code 3)
     +-- ProgramRejected       a program with faults, nothing of the line moved (exit code 4)
     |    +-- RejectedLines    the same for lines sent to a running program, with its numbers
     +-- RuntimeFault          the job failed while running (exit code 1)
     +-- ServiceError          a request that the service refuses
          +-- Refused          the same, with the values that its code promises
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import msgspec

Severity = Literal["error", "warning"]
# remedy of MC025
NEEDS_LINUX = "run it on Linux; check, simulate, plot, lsp, mcp and mcctl run here"


class Edit(msgspec.Struct, frozen=True):
    """A certain remedy: characters of the diagnostic's line and what replaces them.

    Attributes:
        column, end_column: code points from 1, end exclusive.
        text: the replacement.
    """

    column: int
    end_column: int
    text: str


class Diagnostic(msgspec.Struct, frozen=True, omit_defaults=False):
    """One fault of a program, placed in its text.

    Attributes:
        code: stable code such as ``MC104``.
        severity: ``error`` or ``warning``.
        line: line of the file, from 1 (0: no line).
        column, end_column: code points from 1, end exclusive (0: no column).
        message: one sentence that says what is wrong, with the values.
        hint: what to change; empty where nothing useful is known.
        tool, residual_mm, axis: set by faults of inverse kinematics and of single axes.
        edit: the remedy, if a single one is certain.
    """

    code: str
    message: str
    line: int = 0
    column: int = 0
    end_column: int = 0
    hint: str = ""
    severity: Severity = "error"
    tool: int | None = None
    residual_mm: float | None = None
    axis: int | None = None
    edit: Edit | None = None

    def as_json(self) -> dict[str, object]:
        """Return the form of ``--json``: optional values are left out where they do not apply."""
        shown: dict[str, object] = {
            "code": self.code,
            "severity": self.severity,
            "line": self.line,
            "column": self.column,
            "end_column": self.end_column,
            "message": self.message,
            "hint": self.hint,
        }
        for name in ("tool", "residual_mm", "axis"):
            value = getattr(self, name)
            if value is not None:
                shown[name] = value
        if self.edit is not None:
            shown["edit"] = msgspec.structs.asdict(self.edit)
        return shown


class McError(Exception):
    """Base of all errors of this package; carries a stable code and a remedy."""

    def __init__(self, code: str, message: str, hint: str = "") -> None:
        # of an error that was made of another one's text
        message = message.removeprefix(f"{code}: ")
        super().__init__(f"{code}: {message}" + (f" ({hint})" if hint else ""))
        self.code = code
        self.message = message
        self.hint = hint

    def __reduce__(self) -> tuple[Any, ...]:
        """Come whole out of a worker process, whatever the arguments of the class are."""
        return self.__class__.__new__, (self.__class__, *self.args), self.__dict__


class UsageFault(McError):
    """An argument that cannot be meant as it stands: a missing file, an unknown suffix (exit code 2)."""


class NobodyAnswers(McError):
    """No server where one was expected (exit code 5)."""


class ConfigurationError(McError):
    """A machine file or option that does not fit."""


class ServiceError(McError):
    """A request that the service refuses; the state is as it was before."""


class Refused(ServiceError):
    """A request that the service refuses, with the values that its code promises (docs/keyspace.md)."""

    def __init__(self, code: str, message: str, hint: str = "", **details: object) -> None:
        super().__init__(code, message, hint)
        self.details = details


class RuntimeFault(McError):
    """A fault while running; motion has been stopped in a coordinated way."""

    def __init__(
        self, code: str, message: str, hint: str = "", *, line: int = 0, axis: int | None = None
    ) -> None:
        super().__init__(code, message, hint)
        self.line = line
        self.axis = axis

    def diagnostic(self) -> Diagnostic:
        return Diagnostic(
            code=self.code, message=self.message, hint=self.hint, line=self.line, axis=self.axis
        )


class ProgramRejected(McError):
    """Faults of a program; nothing of the faulty line moves (D-04)."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics = tuple(diagnostics)
        first = self.diagnostics[0]
        super().__init__(first.code, first.message, first.hint)


class RejectedLines(ProgramRejected):
    """Lines sent to a running program were taken up to a faulty one; ``details`` has the numbers."""

    def __init__(self, diagnostics: Iterable[Diagnostic], **details: object) -> None:
        super().__init__(diagnostics)
        self.details = details
