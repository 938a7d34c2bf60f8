"""A machine without axes, planner and executor: it shows what a machine shows, and lets time pass.

Lines are numbered, taken and acknowledged as a real server does it. Each line takes the same time, so how far
a program has come is a sum, made when someone asks. Nothing is checked, planned or journaled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from mcserver.errors import Refused
from mcserver.net import messages as wire
from mcserver.net.info_messages import AxisInfo, Info, TelemetryInfo
from mcserver.net.messages import PROTOCOL_VERSION
from mcserver.net.rpc import Handler
from mcserver.net.status import CYCLES_A_MESSAGE, TELEMETRY_FIELDS, limits_info
from mcserver.service.event_log import EventLog
from mcserver.service.line_intake import check_last, take_lines
from mcserver.service.line_queue import LineQueue
from mcserver.service.program import Program
from mcserver.service.program_access import find_program, owned_program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.reports import (
    Ack,
    AxesStatus,
    Event,
    Fault,
    MachineState,
    MachineStatus,
    ProgramState,
)
from mcserver.service.timebase import Timebase

CYCLE_S = 0.001
OPEN_PROGRAMS = 4
ENDED_PROGRAMS = 4
# how far and how often its axes swing while a program runs
SWING_MM, SWING_S = 100.0, 4.0


class LightProgram(Program):
    """One program, and the time that it has run.

    Args:
        line_s: how long each line takes.

    Attributes:
        reported: lines that were acknowledged as done.
    """

    def __init__(
        self, program: str, client: str, name: str, axes: Sequence[int], opened_at: float, line_s: float
    ) -> None:
        super().__init__(
            program,
            client,
            axes,
            ProgramOptions(name=name),
            opened_at=opened_at,
            queue=LineQueue(),
        )
        self.state = "running"
        self.reported = -1
        self._line_s = line_s
        self._ran_s = 0.0

    def take(self, first: int, lines: Sequence[str], rejections: int | None) -> None:
        """Take lines, as `take_lines` does."""
        take_lines(self, first, lines, rejections)
        self.journaled = self.queue.accepted

    def advance(self, seconds: float) -> None:
        """Let time pass; it stands while held, and while there are no lines."""
        accepted = self.queue.accepted
        if self.state == "running":
            self._ran_s = min(self._ran_s + seconds, accepted * self._line_s)
            self.done = min(accepted, int(self._ran_s / self._line_s))
            self.queue.consume(self.done)
        self.progress.started = min(accepted, self.done + 1)
        self.progress.passed(self.done)
        self.eta_s = (accepted - self.done) * self._line_s

    def ack(self, expected: int = 0) -> Ack:
        self.reported = self.done
        return super().ack(expected)


class LightMachine:
    """The state of one machine, and its remote methods; used by one thread at a time.

    Args:
        name, instance: of the machine and of its session.
        axes: how many it has.
        line_s: how long a line of a program takes.
        clock: Unix time [s].
        on_ack, on_event: publish.
    """

    def __init__(
        self,
        name: str,
        instance: str,
        *,
        axes: int,
        line_s: float,
        clock: Callable[[], float],
        on_ack: Callable[[Ack], None],
        on_event: Callable[[Event], None],
    ) -> None:
        self.name = name
        self.state: MachineState = "ready"
        self._instance = instance
        self._line_s = line_s
        self._clock = clock
        self._on_ack = on_ack
        self._epoch = self._advanced = clock()
        self._axes = list(range(axes))
        self._programs: dict[str, LightProgram] = {}
        self._counter = 0
        self._faults: list[Fault] = []
        self._override = 100.0
        self._moved_s = 0.0
        self._events = EventLog(instance, Timebase(self._epoch, clock, clock), on_event)
        self._events.publish("server.started", message=f"machine {name} (light)")

    def handlers(self) -> dict[str, Handler]:
        """Return what carries out its remote methods, by name, for `mcserver.net.rpc.RpcServer`."""
        return {
            "open": self._open,
            "submit": self._submit,
            "close": self._close,
            "hold": self._hold,
            "resume": self._resume,
            "abort": self._abort,
            "override": self._set_override,
            "reset": self._reset,
            "estop": self._estop,
            "status": lambda _client, _request: self.status(),
            "programs": self._list,
            "events": self._list_events,
            "info": lambda _client, _request: self._info(),
        }

    # ------------------------------------------------------------ time

    def advance(self) -> None:
        """Let the time since the last call pass; ends programs, acknowledges what is done."""
        now = self._clock()
        seconds, self._advanced = max(0.0, now - self._advanced), now
        running = [program for program in self._programs.values() if not program.ended]
        if any(program.state == "running" and program.done < program.queue.accepted for program in running):
            self._moved_s += seconds
        for program in running:
            program.advance(seconds * self._override / 100.0)
            if program.closed and program.done == program.queue.accepted and program.state == "running":
                self._end(program, "finished")
            elif program.done != program.reported:
                self._on_ack(program.ack())

    def status(self) -> MachineStatus:
        self.advance()
        now = self._clock()
        count = len(self._axes)
        angle = 2.0 * math.pi * self._moved_s / SWING_S
        position = [SWING_MM * math.sin(angle + axis) - SWING_MM * math.sin(axis) for axis in self._axes]
        moving = any(each.state == "running" and not each.ended for each in self._programs.values())
        return MachineStatus(
            t=now - self._epoch,
            wall=now,
            instance=self._instance,
            state=self.state,
            axes=AxesStatus(
                index=self._axes,
                position=position,
                setpoint=position,
                velocity=[0.0] * count,
                torque=[0.0] * count,
                state=["moving" if moving else "standstill"] * count,
            ),
            programs=[program.status() for program in self._programs.values()],
            faults=self._faults,
            override=self._override,
            late_cycles=0,
            tools=[],
        )

    # ------------------------------------------------------------ lines and stops from keys of their own

    def stream(self, client: str, program_id: str, first: int, lines: list[str]) -> None:
        """Take lines that were put, as far as they are the next ones of this client's program."""
        program = self._programs.get(program_id)
        if program is None or program.client != client:
            return
        expected = 0
        try:
            program.take(first, lines, None)
        except Refused as error:
            expected = program.queue.expected if error.code == "MC505" else 0
        self._on_ack(program.ack(expected))

    def emergency_stop(self, client: str, reason: str) -> None:
        """Latch the stop and break off every program."""
        if self.state == "estop":
            return
        self.advance()
        self.state = "estop"
        fault = Fault(
            code="MC400",
            message="emergency stop",
            hint="remove the cause, then reset",
            t=self._clock() - self._epoch,
        )
        self._faults = [fault]
        self._events.publish("estop", reason=reason, client=client or None)
        for program in list(self._programs.values()):
            if not program.ended:
                program.fault = fault
                self._end(program, "faulted")

    # ------------------------------------------------------------ methods

    def _open(self, client: str, request: wire.OpenRequest) -> wire.OpenReply:
        self._require_ready()
        if sum(not program.ended for program in self._programs.values()) >= OPEN_PROGRAMS:
            raise Refused("MC508", f"{OPEN_PROGRAMS} programs are open", "close one", limit=OPEN_PROGRAMS)
        if request.start_line != 1 or request.resume_of is not None:
            raise Refused("MC511", "a light machine resumes nothing", "open the program from its first line")
        self._counter += 1
        axes = request.axes or self._axes
        program = LightProgram(
            f"{self._instance}-{self.name}-{self._counter}",
            client,
            request.name,
            axes,
            self._clock(),
            self._line_s,
        )
        self._forget_ended()
        self._programs[program.program] = program
        self._events.publish("program.opened", program=program.program, client=client, state=program.state)
        return wire.OpenReply(
            program=program.program,
            state=program.state,
            axes=list(program.axes),
            expected=1,
            credit=program.queue.credit,
            instance=self._instance,
        )

    def _submit(self, client: str, request: wire.SubmitRequest) -> wire.SubmitReply:
        program = owned_program(self._programs, client, request.program)
        program.take(request.first, request.lines, request.rejections)
        return wire.SubmitReply(program.program, program.journaled, program.done, program.credit)

    def _close(self, client: str, request: wire.CloseRequest) -> wire.CloseReply:
        program = owned_program(self._programs, client, request.program)
        if not program.ended:
            check_last(program, request.last)
        program.closed = True
        return wire.CloseReply(program.program, program.journaled, program.done, program.state)

    def _hold(self, _client: str, request: wire.ProgramRequest) -> wire.Done:
        return self._turn(request.program, "running", "held")

    def _resume(self, _client: str, request: wire.ProgramRequest) -> wire.Done:
        self._require_ready()
        return self._turn(request.program, "held", "running")

    def _abort(self, _client: str, request: wire.ProgramRequest) -> wire.Done:
        self.advance()
        chosen = self._chosen(request.program)
        for program in chosen:
            self._end(program, "aborted")
        return wire.Done(programs=[program.program for program in chosen])

    def _set_override(self, _client: str, request: wire.OverrideRequest) -> wire.OverrideReply:
        self.advance()
        self._override = request.percent
        return wire.OverrideReply(request.percent, [program.program for program in self._chosen(None)])

    def _reset(self, _client: str, _request: wire.ResetRequest) -> wire.Done:
        self.state, self._faults = "ready", []
        self._events.publish("reset", message="the latch is cleared")
        return wire.Done([])

    def _estop(self, client: str, request: wire.EstopRequest) -> wire.Done:
        self.emergency_stop(client, request.reason)
        return wire.Done([])

    def _list(self, _client: str, request: wire.ProgramsRequest) -> wire.ProgramsReply:
        self.advance()
        found = [
            each for each in reversed(self._programs.values()) if request.program in (None, each.program)
        ]
        if request.program is not None and not found:
            find_program(self._programs, request.program)
        shown = [each.status() for each in found if request.ended or not each.ended]
        return wire.ProgramsReply(shown[: request.limit])

    def _list_events(self, _client: str, request: wire.EventsRequest) -> wire.EventsReply:
        return wire.EventsReply(
            instance=self._instance,
            oldest=self._events.oldest,
            newest=self._events.newest,
            events=self._events.since(request.since, request.limit),
        )

    def _info(self) -> Info:
        return Info(
            machine=self.name,
            server="light",
            protocol=[PROTOCOL_VERSION],
            instance=self._instance,
            epoch=self._epoch,
            cycle_s=CYCLE_S,
            axes=[AxisInfo(index, "linear", "mm", 200.0, 1000.0, "simulated") for index in self._axes],
            tools=[],
            telemetry=TelemetryInfo(self._axes, list(TELEMETRY_FIELDS), CYCLES_A_MESSAGE, 0.0),
            limits=limits_info(at_once=OPEN_PROGRAMS, opened=OPEN_PROGRAMS),
            methods=sorted(self.handlers()),
        )

    # ------------------------------------------------------------ inside

    def _turn(self, program_id: str | None, before: ProgramState, after: ProgramState) -> wire.Done:
        self.advance()
        chosen = [program for program in self._chosen(program_id) if program.state == before]
        for program in chosen:
            program.state = after
            self._on_ack(program.ack())
        return wire.Done(programs=[program.program for program in chosen])

    def _end(self, program: LightProgram, state: ProgramState) -> None:
        program.state = state
        program.closed = True
        program.ended_at = self._clock()
        self._events.publish("program.ended", program=program.program, client=program.client, state=state)
        self._on_ack(program.ack())

    def _chosen(self, program_id: str | None) -> list[LightProgram]:
        if program_id is not None:
            find_program(self._programs, program_id)
        return [
            program
            for program in self._programs.values()
            if not program.ended and program_id in (None, program.program)
        ]

    def _require_ready(self) -> None:
        if self.state == "estop":
            raise Refused("MC509", "the emergency stop is latched", "remove the cause, then reset", faults=[])

    def _forget_ended(self) -> None:
        ended = [key for key, program in self._programs.items() if program.ended]
        for key in ended[: max(0, len(ended) - ENDED_PROGRAMS + 1)]:
            del self._programs[key]
