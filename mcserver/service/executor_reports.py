"""Apply the executor's events to the programs of a machine: lines, pauses, holds, faults."""

from __future__ import annotations

from typing import TYPE_CHECKING

import msgspec

from mcserver.executor.entries import EventKind, ExecutorEvent
from mcserver.executor.fault_codes import WARNINGS, FaultCode
from mcserver.machine.machine_file import Machine
from mcserver.service.fault_latch import fault_of
from mcserver.service.program import Program
from mcserver.service.reports import Fault

if TYPE_CHECKING:
    from mcserver.service.program_table import ProgramTable


class ExecutorReports:
    """Handles the executor's events for the programs of a table."""

    def __init__(self, machine: Machine, table: ProgramTable) -> None:
        self._table = table
        self._inputs = [each.name for each in machine.inputs]
        self._outputs = [each.name for each in machine.outputs]
        # columns of the inputs that now hold the programs
        self._holding: set[int] = set()

    @property
    def holding(self) -> bool:
        """Whether an input holds all programs."""
        return bool(self._holding)

    def handle(self, event: ExecutorEvent) -> None:
        program = self._in_slot(event.program)
        if event.kind is EventKind.FAULT:
            self._fault(event, program)
            return
        if self._table.axis_reports.handle(event, None if program is None else program.program):
            return
        if program is None or event.time < program.begun:
            # of the slot's previous program, whose end was found without this event
            return
        if event.line == 0 and event.kind in (EventKind.LINE_START, EventKind.LINE_END, EventKind.AXIS_DONE):
            # during the approach to the first line
            return
        begins = event.kind in (EventKind.LINE_START, EventKind.PAUSED)
        if begins and program.approach and not program.progress.started:
            program.notice = ""
        if event.kind is EventKind.LINE_START:
            program.progress.line_started(event.line, event.time)
            self._say(program, event.line)
            self._table.progress_reports.moved(program)
        elif event.kind is EventKind.LINE_END:
            start = program.progress.line_ended(event.line, event.time)
            self._count(program, *program.tool_use.ended(event.line, start, event.time))
            self._table.progress_reports.moved(program)
        elif event.kind is EventKind.PASSED:
            program.progress.passed(event.line)
            self._table.progress_reports.moved(program)
        elif event.kind is EventKind.INPUT_WAIT:
            program.waits_for = self._inputs[event.token]
        elif event.kind is EventKind.INPUT:
            program.waits_for = ""
            name = self._inputs[event.token] if event.token < len(self._inputs) else ""
            value, waited = event.values
            message = f"{name} = {value:g} after {waited:.3f} s"
            self._table.publish("input.read", program, line=event.line, message=message)
        elif event.kind is EventKind.PAUSED:
            self._say(program, event.line)
            program.paused, program.paused_at = True, event.line
            worn = self._table.offsets.worn_text(program.asks_for)
            if worn:
                program.notice = f"{program.notice} · {worn}"
            if program.state != "ending":
                self._table.pauses.began(program, event.line, event.token)
            self._table.enter(program, "paused")
            self._table.publish("program.paused", program, line=event.line, message=program.notice)
        elif event.kind is EventKind.FINISHED:
            self._say(program, event.line)
            program.progress.passed(event.line)
            self._table.end(program, program.ended_as)
        elif event.kind is EventKind.STOPPED:
            if event.token:
                self._say_in_thread(program, event.line)
            self._table.end(program, "aborted" if program.ended_as == "finished" else program.ended_as)

    def _say_in_thread(self, program: Program, line: int) -> None:
        """Warn that a program was stopped with the tool possibly in a thread, which jogging would break."""
        said = f"it was stopped within the thread of line {line}: get the tool out before an axis moves"
        program.reason = f"{program.reason}; {said}" if program.reason else said
        if program.fault is not None:
            hint = f"{program.fault.hint}; {said}" if program.fault.hint else said
            program.fault = msgspec.structs.replace(program.fault, hint=hint)

    def _fault(self, event: ExecutorEvent, program: Program | None) -> None:
        fault = fault_of(event, None if program is None else program.program, self._inputs, self._outputs)
        if event.code in WARNINGS:
            message = f"{fault.message}: {fault.hint}"
            where = {"program": fault.program, "line": fault.line, "axis": fault.axis}
            self._table.events.publish("warning", reason=fault.code, message=message, **where)
            self._interlock(event, fault, program)
            if event.code == FaultCode.TARGETS_LOST and program is not None:
                # the executor ends the program
                program.reason = f"{fault.code}: {fault.message}"
            return
        if event.code == FaultCode.INTERLOCK_STOP:
            if program is None:
                self._table.on_machine_stop(fault)
            return
        if event.code == FaultCode.EMERGENCY_STOP:
            # latched and reported by the caller of the stop; motion that came while axes were stopping ends
            # here
            if program is not None:
                self._table.stop(program, "faulted", fault.message, fault)
            return
        # the executor ends programs whose motion was interrupted by the stall, each with its own fault
        stalled_machine = event.code == FaultCode.CYCLE_STALLED and program is None
        if not stalled_machine:
            # latch before publishing
            self._table.faults.latch(fault)
        self._table.events.publish(
            "fault", fault=fault, program=fault.program, line=fault.line, message=fault.message
        )
        if stalled_machine:
            return
        hit = [] if program is None else [program]
        if program is not None:
            program.progress.faulted(event.line, lost=event.axis >= 0)
        if program is None and fault.axis is None:
            # a fault of the whole machine ends every program, one of an idle axis ends none
            hit = [each for each in self._table.programs.values() if not each.over]
        for each in hit:
            self._table.stop(each, "faulted", fault.message, fault)

    def _interlock(self, event: ExecutorEvent, fault: Fault, met: Program | None) -> None:
        """Note that an input holds the programs, or no longer does: they stay held until resumed.

        Args:
            met: program that is held before a zone which an input has switched on.
        """
        if event.code == FaultCode.ZONE_HOLD:
            if met is not None and not met.over:
                met.zone_switch = int(event.values[1])
                met.held_by = self._inputs[int(event.values[0])]
                self._hold_for(met, fault)
            return
        holds = event.code == FaultCode.INTERLOCK_HOLD
        if not holds and event.code != FaultCode.INTERLOCK_FREE:
            return
        inputs = {int(event.values[0])}
        self._holding = self._holding | inputs if holds else self._holding - inputs
        for program in self._table.programs.values():
            if program.over or program.slot is None:
                continue
            if program.zone_switch is None:
                program.held_by = self.holders
            if holds:
                self._hold_for(program, fault)

    @property
    def holders(self) -> str:
        """Names of the inputs that hold all programs."""
        return ", ".join(self._inputs[each] for each in sorted(self._holding))

    def _hold_for(self, program: Program, fault: Fault) -> None:
        """Note that the executor holds a program because of an input."""
        if not program.held:
            program.held = True
            self._table.enter(program, "held")
            self._table.publish("program.held", program, reason=fault.code, message=fault.message)

    def program_in(self, slot: int) -> str | None:
        """Return the id of the program in a program slot."""
        program = self._in_slot(slot)
        return None if program is None else program.program

    def _in_slot(self, slot: int) -> Program | None:
        for program in self._table.programs.values():
            if program.slot == slot and not program.over:
                return program
        return None

    def _count(self, program: Program, tool: int, seconds: float) -> None:
        """Count the cutting time of a line, and report once that a tool's life is used up."""
        if tool and self._table.offsets.cut(tool, seconds):
            message = f"{self._table.offsets.worn_text(tool)}; its next change waits for that"
            self._table.events.publish("warning", reason="MC603", message=message, program=program.program)

    def _say(self, program: Program, line: int) -> None:
        """Publish the messages of lines up to this one for the operator."""
        said: list[str] = []
        while program.messages and program.messages[0].line <= line:
            found = program.messages.popleft()
            said.append(found.message)
            program.asks_for = found.tool
            self._table.publish("program.message", program, line=found.line, message=found.message)
        if said:
            # combine messages on the way to one pause
            program.notice = " · ".join(said[-3:])
