"""Programs that are open: whose they are, and what cannot be done at a machine meanwhile."""

from __future__ import annotations

from collections.abc import Sequence

from mcclient import Machine, MotionError, ProgramStatus
from mcclient.broken_off import is_by_hand

from mcserver.web.formatting import is_live
from mcserver.web.link import MachineLink
from mcserver.web.machine_words import program_name
from mcserver.web.translation import t


def who(link: MachineLink, program: ProgramStatus) -> str:
    """Return whose a program is: of those of this page the person's name, where it is known."""
    job = next((job for job in link.jobs.begun if job.program == program.program), None)
    if job is not None:
        return job.user
    if link.machine is None or program.client != link.machine.client:
        return program.client
    _, said, person = program.name.rpartition(" by ")
    return person if said and is_by_hand(program.name) else t("this page")


async def run_at_rest(link: MachineLink, machine: Machine, name: str, line: str, why: str) -> None:
    """Run a line as a program of its own, now: it would wait for the axes, and act where they are by then.

    Raises:
        MotionError: MC512 as `refusal_of`; what the server says of the line.
    """
    refuse_open(link, await machine.programs(ended=False), why)
    async with machine.program(name, at_pause=True) as program:
        await program.send(line)


def refusal_text(refusal: MotionError | None) -> str:
    """Return what stands beside buttons that do nothing now; empty: they do."""
    return "" if refusal is None else f"{refusal.message} [{refusal.code}]: {refusal.hint}"


def refuse_open(link: MachineLink, programs: Sequence[ProgramStatus], why: str) -> None:
    """Raise what `refusal_of` returns."""
    refusal = refusal_of(link, programs, why)
    if refusal is not None:
        raise refusal


def refusal_of(link: MachineLink, programs: Sequence[ProgramStatus], why: str) -> MotionError | None:
    """Return the refusal (MC512) where a program is open; None where none is, or it stands at a pause.

    Args:
        why: what speaks against it, such as ``zero is set where the axes stand``.
    """
    live = [each for each in programs if is_live(each)]
    # what waits for the axes of one at a pause waits on
    standing = ("paused", "queued") if any(each.state == "paused" for each in live) else ()
    program = next((each for each in live if each.state not in standing), None)
    if program is None:
        return None
    return MotionError(
        "MC512",
        t(
            "{program} of {client} is {state}: {why}",
            program=program_name(program.name or program.program),
            client=who(link, program),
            state=t(program.state),
            why=t(why),
        ),
        t("wait for its end, or abort it"),
    )
