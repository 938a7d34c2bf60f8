"""Continue in the middle of a program: its state there from its own earlier lines, and the approach."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Sequence

import msgspec

from mcserver.errors import ProgramRejected, Refused, ServiceError
from mcserver.gcode.profiles.frame import Frame
from mcserver.gcode.semantics.modal import ModalState, with_frame
from mcserver.gcode.switches import AS_WRITTEN, Switches
from mcserver.machine.machine_file import Machine
from mcserver.machine.work_systems import ANGLE, SYSTEM_NUMBERS
from mcserver.planning.client import ProcessPlanning
from mcserver.planning.start_state import StartState, StateBefore
from mcserver.service.approach import Approach, Need, free_axes, plan_approach
from mcserver.service.journal import KnownText
from mcserver.service.journal_reader import (
    RecordedProgram,
    read_lines_before,
    read_lines_near,
    read_recorded,
)
from mcserver.service.program_table import ProgramTable
from mcserver.service.reports import ProgramStatus
from mcserver.service.start_of_programs import turning_and_pushing
from mcserver.units import DEGREE

# Difference below which work offsets are the same [m or rad].
SAME_OFFSET = 1e-9
# Lines shown before and after the first one.
EXCERPT = 6


class Start(msgspec.Struct, frozen=True):
    """A start at a line.

    Attributes:
        before: lines before it. state: after them; None: there are none.
        origin: the machine when the program began; None: unknown, and assumed to be as now.
        switches: of the operator. thread: line in whose thread the program may have been broken off; 0:
            none.
    """

    before: Sequence[str]
    state: StateBefore | None
    origin: StartState | None
    switches: Switches
    thread: int = 0


class Recovering:
    """Reads what is needed to continue a program. All methods run in the loop.

    Args:
        written: waits until everything journaled so far can be read.
    """

    def __init__(
        self,
        machine: Machine,
        planning: ProcessPlanning,
        table: ProgramTable,
        written: Callable[[], Awaitable[None]],
    ) -> None:
        self._machine = machine
        self._planning = planning
        self._table = table
        self._path = table.options.journal
        self._written = written

    async def recorded(self, program: str, *, last: bool = True) -> RecordedProgram:
        """Read a program that has ended, or with ``last`` the program that continued it last.

        Raises:
            ServiceError: MC503 no such program; MC517 it is open, or was motion by hand.
        """
        await self._written()
        found = await asyncio.to_thread(read_recorded, self._path, program, last=last)
        name = found.status.program
        here = self._table.programs.get(name)
        if here is not None and not here.ended:
            raise Refused("MC517", f"{name} has not ended", "abort it first", state=here.state)
        if found.text is KnownText.NONE:
            # lines of motion by hand are meaningless without the hand that ended it
            raise Refused(
                "MC517",
                f"{name} ({found.status.name}) has no lines to go on with",
                "jog, home or open servo mode anew",
                state=found.status.state,
            )
        return found

    async def lines(self, program: str, first: int, last: int) -> list[str]:
        """Read lines ``first`` … ``last`` of a program.

        Raises:
            ServiceError: MC514 the journal does not have all of them.
        """
        if last < first:
            return []
        at, found = await asyncio.to_thread(read_lines_near, self._path, program, first, last)
        if at != first or len(found) != last - first + 1:
            raise Refused(
                "MC514",
                f"of lines {first} … {last} of {program} the journal has {len(found)}",
                "run the file itself from the line: mcctl run FILE --from-line",
                oldest_line=at,
            )
        return found

    async def excerpt(self, program: str, line: int) -> tuple[int, list[str]]:
        """Return the lines around a line as far as known, and the number of the first."""
        first, last = max(1, line - EXCERPT), line + EXCERPT
        return await asyncio.to_thread(read_lines_near, self._path, program, first, last)

    async def start_of(
        self,
        axes: Sequence[int],
        line: int,
        *,
        before: Sequence[str] = (),
        program: str | None = None,
        switches: Switches | None = None,
    ) -> Start:
        """Rebuild the state before a line.

        Args:
            axes: of the program that starts there. before: lines before it. program: otherwise the one that
                has them, and whose initial state is in the journal.
            switches: of the operator; None: those of ``program``.

        Raises:
            ServiceError: MC483 ``program`` has other switches; MC503, MC511, MC514, MC517.
            ProgramRejected: a line before it has a fault.
        """
        origin: StartState | None = None
        broken_off: RecordedProgram | None = None
        if program is not None:
            broken_off = await self.recorded(program, last=False)
            origin = broken_off.origin
            if line > 1 and not before:
                before = await asyncio.to_thread(read_lines_before, self._path, program, line)
        if before and len(before) != line - 1:
            raise Refused(
                "MC511",
                f"{len(before)} lines before line {line}: lines 1 … {line - 1} are meant",
                "give all of them, or none",
            )
        kept = AS_WRITTEN if origin is None else origin.switches
        if switches is None:
            switches = kept
        elif program is not None and switches != kept:
            raise Refused(
                "MC483",
                f"{program} has block delete {'on' if kept.block_delete else 'off'} and optional stop"
                f" {'on' if kept.optional_stop else 'off'}",
                "go on with the same switches, or run the file from the line: mcctl run FILE --from-line",
            )
        if not before:
            return Start(before, None, origin, switches)
        begun = origin or self._table.start_state(switches=switches)
        state = await asyncio.to_thread(self._planning.state_before, before, begun, frozenset(axes))
        thread = 0 if broken_off is None else await self._thread_of(broken_off.status, begun)
        return Start(before, state, origin, switches, thread)

    async def _thread_of(self, status: ProgramStatus, begun: StartState) -> int:
        """Return the line within whose thread a program may have been broken off; 0: none.

        It was running the line after the last one known as done, or one that had begun.
        """
        if self._machine.dialect.spindle is None:
            return 0
        last = min(max(status.line, status.done + 1), status.accepted)
        try:
            lines = await asyncio.to_thread(read_lines_before, self._path, status.program, last + 1)
            found = await asyncio.to_thread(self._planning.state_before, lines, begun, frozenset(status.axes))
        except (ServiceError, ProgramRejected):
            # a refused line has not moved
            return 0
        return max((line for line in found.threads if line > status.done), default=0)

    def plan(self, start: Start, axes: Sequence[int]) -> Approach:
        """Plan the approach from the axes' positions to those of a start."""
        assert start.state is not None
        running = turning_and_pushing(self._machine, self._table.port.snapshot())
        approach = plan_approach(self._machine, start.state, self._table.start_state(), axes, running)
        if start.thread and any(step.targets for step in approach.way):
            need = Need(
                "MC592",
                f"the program was broken off at line {start.thread}, whose axes follow the spindle: the tool"
                " may stand in its thread",
                "get it out by hand, then confirm the way",
                "way",
            )
            approach = msgspec.structs.replace(approach, needs=(need, *approach.needs))
        return msgspec.structs.replace(approach, needs=(*approach.needs, *self._changes(start)))

    def _changes(self, start: Start) -> list[Need]:
        """Return what is in the way of a start because it has changed since the program ran."""
        origin, state = start.origin, start.state
        if origin is None or state is None:
            return []
        frame = state.modal.frame
        differing = "" if frame is None else self._differing_offsets(frame, origin)
        if differing:
            hint = "set them back (see mcctl tables), or run the file from the line with those of now"
            return [Need("MC594", f"work offsets or tools were changed since: {differing}", hint)]
        if origin.machine_file in ("", self._table.machine_file):
            return []
        message = "the machine file was changed since the program began: places may be others"
        hint = "see what was changed, and confirm the way where no place is, or run the file from the line"
        return [Need("MC594", message, hint, "way")]

    def modal_from(self, start: Start) -> ModalState | None:
        """Return the modal state of a start; free axes continue from their present positions."""
        state, free = start.state, free_axes(self._machine)
        if state is None or not free:
            return None if state is None else state.modal
        now = self._table.start_state().positions
        frame = state.modal.frame or Frame()
        moved = {axis: frame.g92.get(axis, 0.0) + now[axis] - state.positions[axis] for axis in free}
        frame = msgspec.structs.replace(frame, g92={**frame.g92, **moved}, g92_on=True)
        return with_frame(state.modal, frame)

    def _differing_offsets(self, frame: Frame, origin: StartState) -> str:
        """Name work offsets and tools that differ from those of a program at a line; empty: none.

        Args:
            frame: at the line. origin: when the program began.
        """
        names = {number: name for name, number in SYSTEM_NUMBERS.items()}
        now = self._table.offsets.systems
        file_tools = origin.cutters if origin.machine_file else self._machine.dialect.cutters
        had_tools = {**file_tools, **frame.cutters}
        tools = self._table.offsets.cutters
        said = [
            f"T{number} is another one in the tool table"
            for number in sorted(had_tools.keys() | tools.keys())
            if had_tools.get(number) != tools.get(number)
        ]
        for number in sorted(frame.systems.keys() | now.keys()):
            had, has = frame.systems.get(number, {}), now.get(number, {})
            for index in sorted(had.keys() | has.keys()):
                axis = self._machine.axis(index)
                then, at = had.get(index, 0.0), has.get(index, 0.0)
                if (axis is not None or index == ANGLE) and abs(then - at) > SAME_OFFSET:
                    unit = DEGREE if axis is None else axis.type.si_per_unit
                    what = "the angle" if axis is None else f"axis {index}"
                    said.append(f"{names.get(number)} of {what} is {at / unit:.3f}, it was {then / unit:.3f}")
        return "; ".join(said)
