"""Find the programs that a call names, or refuse it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

from mcserver.errors import Refused
from mcserver.service.program import Program

AnyProgram = TypeVar("AnyProgram", bound=Program)


def find_program(programs: Mapping[str, AnyProgram], program_id: str) -> AnyProgram:
    """Return a program of this start of the server.

    Raises:
        ServiceError: MC503 the program does not exist.
    """
    program = programs.get(program_id)
    if program is None:
        raise Refused(
            "MC503",
            f"the server has opened no program {program_id} since it started",
            "`programs` lists those before, too: mcctl continue goes on with an interrupted one",
            program=program_id,
        )
    return program


def owned_program(programs: Mapping[str, AnyProgram], client: str, program_id: str) -> AnyProgram:
    """Return a program that belongs to ``client``.

    Raises:
        ServiceError: MC503 the program does not exist, MC504 it is another client's.
    """
    program = find_program(programs, program_id)
    if program.client != client:
        raise Refused(
            "MC504",
            f"{program_id} belongs to {program.client}",
            "open a program of your own",
            program=program_id,
            client=program.client,
        )
    return program


def open_programs(programs: Mapping[str, Program], program_id: str | None) -> list[Program]:
    """Return one program, or all with possibly running motion, the oldest first.

    Raises:
        ServiceError: MC503 no such program, MC517 it has ended.
    """
    if program_id is None:
        return [program for program in programs.values() if not program.over]
    program = find_program(programs, program_id)
    if program.over:
        raise Refused("MC517", f"{program_id} has ended: {program.state}", "", state=program.state)
    return [program]
