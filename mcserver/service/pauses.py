"""Programs at a pause: what others may do meanwhile, and how the programs continue (D-05).

At M00, M01 and a tool change a program lends its axes that are at rest, so that a person can jog, home, probe
and set the zero with the new tool. The pause ends only when all are returned; then the program continues from
the axes' positions, with the work offsets and tools then in force. Changes are journaled, for whoever
continues the program later.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import msgspec

from mcserver.errors import Refused
from mcserver.executor.fault_codes import FaultCode
from mcserver.gcode.profiles.frame import Frame
from mcserver.machine.machine_file import Machine
from mcserver.planning.start_state import PauseEnd, StartState, axis_word
from mcserver.service.journal import Journal
from mcserver.service.leases import LeaseTable
from mcserver.service.program import Program


class _Pause(msgspec.Struct, frozen=True):
    """A pause of a program.

    Attributes:
        state: of the machine when it began. line: of the pause. nth: of consecutive pauses there, from 1.
        ahead: before any motion of the line.
    """

    state: StartState
    line: int
    nth: int
    ahead: bool


class Pauses:
    """Lends axes when pauses begin, and takes them back when they end.

    Args:
        programs: all, by id. state: returns the machine's present state.
    """

    def __init__(
        self,
        machine: Machine,
        leases: LeaseTable,
        programs: Mapping[str, Program],
        journal: Journal,
        state: Callable[[], StartState],
    ) -> None:
        self._machine = machine
        self._leases = leases
        self._programs = programs
        self._journal = journal
        self._state = state
        # last pause of each program that has not ended
        self._pauses: dict[str, _Pause] = {}

    def began(self, program: Program, line: int, lent: int) -> None:
        """Lend axes of a program that has reached a pause; ``lent``: mask of columns."""
        before = self._pauses.get(program.program)
        nth = before.nth + 1 if before is not None and before.line == line else 1
        ahead = program.progress.started < line
        self._pauses[program.program] = _Pause(self._state(), line, nth, ahead)
        axes = [axis.index for column, axis in enumerate(self._machine.axes) if lent >> column & 1]
        self._leases.lend(program.program, axes)

    def without_kept(self, axes: Sequence[int]) -> tuple[int, ...]:
        """Remove the axes that a program at a pause does not lend, such as a spindle that keeps turning."""
        kept: set[int] = set()
        for name in self._pauses:
            grant = self._leases.grant_of(name)
            if grant is not None and self._programs[name].paused:
                kept |= grant.axes - self._leases.lent(name)
        return tuple(axis for axis in axes if axis not in kept)

    def refuse_lent(self, program: Program) -> None:
        """Refuse to end a pause while axes of the program are in use, or at positions that are not allowed.

        Raises:
            ServiceError: MC460 an approved run may not continue from an axis's position; MC512 another
                program has an axis, or it is moving.
        """
        borrower = self._leases.borrower(program.program)
        if borrower is not None:
            other = self._programs[borrower]
            raise Refused(
                "MC512",
                f"axes of {program.program} are moved by {other.label}",
                "wait for its end, or abort it, then resume",
                program=other.program,
                client=other.client,
                name=other.name,
            )
        state, lent = self._state(), self._leases.lent(program.program)
        for axis in sorted(state.unsettled & lent):
            raise Refused(
                "MC512",
                f"{axis_word(self._machine, axis)} moves by itself",
                f"wait until it rests, or stop it: mcctl send --at-pause 'G1002 P{axis}', then resume",
                axis=axis,
            )
        envelope = program.envelope
        for axis in sorted(lent):
            column = self._machine.column_of(axis)
            if (
                envelope is not None
                and not envelope.low[column] <= state.positions[axis] <= envelope.high[column]
            ):
                raise Refused(
                    f"MC{int(FaultCode.ENVELOPE_POSITION)}",
                    f"{axis_word(self._machine, axis)} stands outside of what was approved of this run",
                    "jog it back to where the run has paused, then resume",
                    axis=axis,
                )

    def end(self, program: Program) -> PauseEnd:
        """Take back what a program lends; return the changes."""
        pause = self._pauses[program.program]
        now = self._state()
        positions = {
            axis: now.positions[axis]
            for axis in sorted(self._leases.lent(program.program))
            if now.positions[axis] != pause.state.positions[axis]
        }
        self._leases.take_back(program.program)
        end = PauseEnd(positions, self._changed_frame(pause, now), pause.line, pause.nth)
        if positions or end.frame is not None:
            self._record(program, end)
        return end

    def offsets_changed(self) -> None:
        """Journal new work offsets and tools for programs at a pause, in case they are continued later."""
        for name, pause in self._pauses.items():
            program = self._programs[name]
            if program.paused and pause.ahead:
                frame = self._changed_frame(pause, self._state())
                self._record(program, PauseEnd({}, frame, pause.line, pause.nth, over=False))

    def forget(self, program: Program) -> None:
        """Remove a program that has ended."""
        self._pauses.pop(program.program, None)

    def _changed_frame(self, pause: _Pause, now: StartState) -> Frame | None:
        return None if now.frame == pause.state.frame else now.frame

    def _record(self, program: Program, end: PauseEnd) -> None:
        origin = program.origin
        if origin is None:
            return
        others = [each for each in origin.pauses if (each.line, each.nth) != (end.line, end.nth)]
        program.origin = msgspec.structs.replace(origin, pauses=(*others, end))
        self._journal.program_begun(program.program, program.origin)
