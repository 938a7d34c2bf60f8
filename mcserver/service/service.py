"""The service: a machine's programs, leases, faults and emergency stop, above planner thread and executor.

It speaks through two callbacks, acknowledgements and events, and knows nothing of the network.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping, Sequence

from mcserver.service.event_log import EventLog
from mcserver.service.intake import ProgramIntake
from mcserver.service.journal_reader import read_programs
from mcserver.service.program import Program
from mcserver.service.program_table import TICK_S
from mcserver.service.refusals import Refused
from mcserver.service.reports import AxisState, Fault, MachineState, ProgramStatus

SHOWN_ENDED_S = 10.0
STOP_LIMIT_S = 3.0


class MachineService(ProgramIntake):
    """One machine's programs, as clients and operators may use them. All of it runs in the asyncio loop."""

    # ------------------------------------------------------------ life

    def start(self) -> None:
        """Begins: what an earlier start left open counts as interrupted."""
        self._table.journal.server_started(self.options.instance, self.options.clock())
        self._table.planner.start()
        self._table.heartbeat.start()
        self.events.publish("server.started", message=f"machine {self.machine.name}")

    async def stop(self) -> None:
        """Stops all motion along its paths, ends the programs, releases the axes and closes the journal."""
        if self._stopping:
            return
        self._stopping = True
        if not self.port.alive():
            self._fail_without_executor()
        self.events.publish("server.stopping")
        for program in self._chosen(None):
            self._table.stop(program, "aborted", "the server is stopping")
        deadline = self._loop.time() + STOP_LIMIT_S
        while self._chosen(None) and self._loop.time() < deadline:
            await asyncio.sleep(TICK_S)
        await asyncio.to_thread(self._table.planner.stop)
        await asyncio.to_thread(self.port.close)
        self._table.heartbeat.stop()
        self._table.journal.server_stopped(self.options.instance, self.options.clock())
        await asyncio.to_thread(self._table.journal.close)

    @property
    def events(self) -> EventLog:
        return self._table.events

    def now(self) -> float:
        """Executor time [s]."""
        return self._table.now()

    # ------------------------------------------------------------ programs

    def hold(self, program_id: str | None) -> list[Program]:
        """Feed hold along the path."""
        chosen = [program for program in self._chosen(program_id) if not program.held]
        for program in chosen:
            program.held = True
            if program.slot is not None:
                self.port.hold(program.slot)
                self._table.enter(program, "held")
            self._table.publish("program.held", program)
        return chosen

    def resume(self, program_id: str | None) -> list[Program]:
        """Ends a hold, M00 or M01."""
        self._ready()
        chosen = [
            program for program in self._chosen(program_id) if program.held or program.state == "paused"
        ]
        for program in chosen:
            program.held = False
            if program.slot is not None:
                self.port.resume(program.slot)
                self._table.enter(program, "running")
            self._table.publish("program.resumed", program)
        return chosen

    def abort(self, program_id: str | None, reason: str = "") -> list[Program]:
        """Stops along the path and drops the rest."""
        chosen = self._chosen(program_id)
        for program in chosen:
            self._table.stop(program, "aborted", reason)
        if program_id is None:
            # axes that move by themselves too (G1020, G1030, G1040)
            self.port.stop_all()
        return chosen

    def set_override(self, ratio: float, program_id: str | None) -> list[Program]:
        """Feed override; of all programs, those to come included, without an id."""
        chosen = self._chosen(program_id)
        if program_id is None:
            self.override = ratio
        for program in chosen:
            program.override = ratio
            if program.slot is not None:
                self.port.override(program.slot, ratio)
        self.events.publish("override", program=program_id, percent=100.0 * ratio)
        return chosen

    def client_gone(self, client: str) -> None:
        """A client's liveliness token went: its programs finish or stop, as they chose."""
        left = [
            program
            for program in self._table.programs.values()
            if program.client == client and not program.ended
        ]
        if left:
            self.events.publish("client.gone", client=client)
        for program in left:
            if program.on_disconnect == "finish":
                self._table.close(program)
            else:
                self._table.stop(program, "aborted", f"client {client} is gone")

    # ------------------------------------------------------------ the machine

    def emergency_stop(self, client: str, reason: str) -> None:
        """Latches the stop, here and in the executor; again is no harm."""
        self.port.emergency_stop()
        if self._estop:
            return
        self._estop = True
        fault = Fault(
            code="MC400",
            message="emergency stop" + (f": {reason}" if reason else ""),
            hint="remove the cause, then reset",
            t=self.now(),
        )
        self._table.faults.latch(fault)
        self.events.publish("estop", reason=reason, client=client or None)
        for program in list(self._table.programs.values()):
            if not program.ended:
                self._table.stop(program, "faulted", "emergency stop", fault)

    def reset(self, axes: Sequence[int] | None) -> None:
        """Clears the latch; axes stay without energy.

        Raises:
            ServiceError: MC509 programs are still coming to rest; MC507.
        """
        wanted = self._axes(axes)
        if any(program.state == "ending" for program in self._table.programs.values()):
            raise Refused("MC509", "motion is still coming to rest", "try again in a moment", faults=[])
        self.port.reset(frozenset(wanted))
        self._estop = False
        self._table.faults.clear()
        self.events.publish("reset", message="the latch is cleared")

    @property
    def state(self) -> MachineState:
        if self._estop:
            return "estop"
        return "fault" if self._table.faults else "ready"

    @property
    def faults(self) -> list[Fault]:
        return list(self._table.faults)

    def refresh_faults(self, states: Mapping[int, AxisState]) -> None:
        """Drops the faults of axes that a G1000 has cleared, and of lines that no axis has latched."""
        if not self._estop and self._table.faults.forget_cleared(states):
            self.events.publish("reset", message="the latch is cleared")

    def holder(self, axis: int) -> str | None:
        """The program that may move ``axis`` now."""
        return self._table.leases.holder(axis)

    def positions_si(self, positions: Mapping[str, float]) -> dict[int, float]:
        """Positions by axis number as text [mm, deg], in SI.

        Raises:
            ServiceError: MC507 no such axis.
        """
        found = {}
        for name, value in positions.items():
            axis = self.machine.axis(int(name)) if name.isdecimal() else None
            if axis is None:
                raise Refused(
                    "MC507", f"the machine {self.machine.name} has no axis {name!r}", "see `info`", axis=name
                )
            found[axis.index] = value * axis.type.si_per_unit
        return found

    def current(self) -> list[Program]:
        """Programs that have not ended, and those that ended a moment ago."""
        since = self.options.clock() - SHOWN_ENDED_S
        self._estimate()
        return [
            program
            for program in self._table.programs.values()
            if not program.ended or (program.ended_at is not None and program.ended_at >= since)
        ]

    async def known(self, *, program_id: str | None, ended: bool, limit: int) -> list[ProgramStatus]:
        """Programs of this start and, from the journal, of earlier ones; newest first."""
        self._estimate()
        mine = {key: program for key, program in self._table.programs.items() if program_id in (None, key)}
        found = [program.status() for program in reversed(mine.values()) if ended or not program.ended]
        if ended and len(found) < limit:
            older = await asyncio.to_thread(
                read_programs, self.options.journal, limit=limit + len(mine), program=program_id
            )
            found += [status for status in older if status.program not in mine]
        if program_id is not None and not found and program_id not in mine:
            self.program(program_id)
        return found[:limit]

    # ------------------------------------------------------------ inside

    def _fail_without_executor(self) -> None:
        fault = Fault(
            code="MC518",
            message=f"the executor process has died ({self.port.ending()}); the drives stop by their own "
            "heartbeat time-out",
            hint="start the server again; axes have to be captured anew",
            t=self.now(),
        )
        self._table.faults.latch(fault)
        self.events.publish("fault", fault=fault, message=fault.message)
        # the newest first, so that none is given the axes of one before it
        for program in reversed(self._chosen(None)):
            self._table.stop(program, "faulted", fault.message, fault)

    def _estimate(self) -> None:
        """Time left of what is planned, at the override in force; waits and dwells come on top."""
        slots = self.port.slots()
        for program in self._table.programs.values():
            if program.ended or program.slot is None or program.planned_end_u is None:
                continue
            left = max(0.0, program.planned_end_u - slots[program.slot].u) * self.machine.cycle_s
            pace = min(1.0, program.override) if program.override > 0.0 else 1.0
            program.eta_s = left / pace

    def _chosen(self, program_id: str | None) -> list[Program]:
        if program_id is None:
            return [program for program in self._table.programs.values() if not program.ended]
        program = self.program(program_id)
        if program.ended:
            raise Refused("MC517", f"{program_id} has ended: {program.state}", "", state=program.state)
        return [program]
