"""Faults of the command line, and which exit code each kind of fault has.

Codes::

    MC010  the program cannot be read
    MC011  the program is too large
    MC012  the output's kind is unknown
    MC013  the output cannot be written there
    MC014  the output could not be written to its end
    MC015  standard output could not be written
    MC016  an optional part is not installed
    MC017  an option's value does not fit
    MC018  a file that an option names is missing
    MC019  a fault of the program itself
    MC028  the computer has no memory, threads, processes or descriptors left for it
"""

from __future__ import annotations

import enum

from mcserver.errors import ConfigurationError, McError, NobodyAnswers, ProgramRejected, UsageFault


class ExitCode(enum.IntEnum):
    """What scripts rely on (interfaces: commands)."""

    OK = 0
    FAILED = 1
    USAGE = 2
    CONFIGURATION = 3
    REJECTED = 4
    NOBODY_ANSWERS = 5


class OutputFault(McError):
    """A result that could not be written (exit code 1)."""


class OutOfResources(McError):
    """The computer, or a limit of the process, does not give what is needed (exit code 1)."""


def exit_code_of(error: McError) -> ExitCode:
    """Return the exit code that tells a script what kind of error this is."""
    if isinstance(error, UsageFault):
        return ExitCode.USAGE
    if isinstance(error, NobodyAnswers):
        return ExitCode.NOBODY_ANSWERS
    if isinstance(error, ConfigurationError):
        return ExitCode.CONFIGURATION
    if isinstance(error, ProgramRejected):
        return ExitCode.REJECTED
    return ExitCode.FAILED
