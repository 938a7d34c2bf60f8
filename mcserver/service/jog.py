"""Moves of one axis by hand, each a program of its own with a lease on that axis.

They are in machine coordinates, whatever work offsets, tools and units programs have. Steps of one person
that come while one is under way wait for its end; anybody else is told who moves the axis.

A jog without a distance runs on while its client asks for it again; when that stops, the axis stops. So a
button that nobody releases, because the network broke, cannot keep an axis moving.
"""

from __future__ import annotations

import asyncio
import math

from mcserver.errors import Refused
from mcserver.machine.machine_file import Axis
from mcserver.service.program import Program
from mcserver.service.service import MachineService

DEFAULT_HOLD_S = 0.5
# the longest jog without an end, at its velocity, where the axis has no limit
ENDLESS_S = 600.0
DEFAULT_SHARE = 0.1
# steps of an axis that wait or are under way
STEPS = 8
# a watch that runs out later than by this was held up with the whole server [s]
HELD_UP_S = 0.02
# what has arrived meanwhile has so long to be read
READING_S = 0.05


class Jogging:
    """Jogs of one machine. All of it runs in the loop."""

    def __init__(self, service: MachineService) -> None:
        self._service = service
        self._watches: dict[str, asyncio.TimerHandle] = {}
        # jogs that have not ended: the axis, and the person at the client
        self._open: dict[str, tuple[int, str]] = {}
        service.on_program_ended.append(self._ended)

    async def jog(
        self,
        client: str,
        axis_index: int,
        *,
        by: str = "",
        distance: float | None,
        velocity: float | None,
        hold_s: float | None,
        program_id: str | None,
    ) -> str:
        """Start a jog, or keep ``program_id`` alive; return the program's id.

        Args:
            by: the person at the client, where it serves several; jogs of another one are refused.
            distance: [mm, deg], signed; None: on until stopped. velocity: [mm/s, deg/s].

        Raises:
            ServiceError: MC507 no such axis, MC508 too many steps wait, MC511 a velocity of 0 or none,
                MC512 the axis is leased.
        """
        if program_id is not None:
            return self._keep(client, program_id, hold_s)
        axis = self._service.machine.axis(axis_index)
        if axis is None:
            raise Refused(
                "MC507",
                f"the machine {self._service.machine.name} has no axis {axis_index}",
                "see `info`",
                axis=axis_index,
            )
        self._refuse_taken(client, by, axis_index, step=distance is not None)
        move = self._move(axis, distance, velocity)
        if distance is None and hold_s is None:
            hold_s = DEFAULT_HOLD_S
        program = await self._service.open(
            client,
            name=f"jog axis {axis_index}" + (f" by {by}" if by else ""),
            axes=[axis_index],
            unhomed=True,
            by_hand=True,
            at_pause=True,
        )
        self._open[program.program] = axis_index, by
        try:
            await self._service.lines.submit(client, program.program, 1, [f"G1010 P{axis_index}", move])
        except Exception:
            self._service.abort(program.program, "the jog was refused")
            raise
        self._service.lines.close(client, program.program)
        if hold_s is not None:
            self._watch(program.program, hold_s)
        return program.program

    def _refuse_taken(self, client: str, by: str, axis: int, *, step: bool) -> None:
        """Refuse a jog of an axis that anything moves but earlier steps of the same person."""
        holder = self._service.holder(axis, at_pause=True)
        if holder is None:
            return
        own = holder.client == client and self._open.get(holder.program) == (axis, by)
        if not own or not (step or holder.state == "ending"):
            self._service.refuse_leased(axis, at_pause=True)
        if sum(jog == (axis, by) for jog in self._open.values()) >= STEPS:
            raise Refused("MC508", f"{STEPS} steps of axis {axis} wait", "let some of them end", limit=STEPS)

    def _ended(self, program: Program) -> None:
        """Forget a jog; the steps behind one that was broken off do not run either."""
        ended = self._open.pop(program.program, None)
        if ended is None or program.ended_as == "finished":
            return
        behind = [each for each, jog in self._open.items() if jog == ended]
        for other in behind:
            del self._open[other]
        for other in behind:
            self._service.abort(other, "the step before it was broken off")

    def _keep(self, client: str, program_id: str, hold_s: float | None) -> str:
        program = self._service.program(program_id)
        if program.client != client:
            raise Refused("MC504", f"{program_id} belongs to {program.client}", "", program=program_id)
        watch = self._watches.pop(program_id, None)
        if watch is None or program.over or program.state == "ending":
            raise Refused("MC517", f"{program_id} is no jog under way", "start another", state=program.state)
        watch.cancel()
        self._watch(program_id, hold_s if hold_s is not None else DEFAULT_HOLD_S)
        return program_id

    def _watch(self, program_id: str, hold_s: float) -> None:
        loop = asyncio.get_running_loop()
        due = loop.time() + hold_s
        self._watches[program_id] = loop.call_later(hold_s, self._let_go, program_id, due)

    def _let_go(self, program_id: str, due: float) -> None:
        loop = asyncio.get_running_loop()
        if loop.time() - due > HELD_UP_S:
            # the client may have asked in time, and nobody has read it; once, so that it is a bounded delay
            self._watches[program_id] = loop.call_later(READING_S, self._let_go, program_id, math.inf)
            return
        self._watches.pop(program_id, None)
        program = self._found(program_id)
        if program is not None and not program.over:
            self._service.abort(program_id, "the jog was let go")

    def _found(self, program_id: str) -> Program | None:
        try:
            return self._service.program(program_id)
        except Refused:
            return None

    def _move(self, axis: Axis, distance: float | None, velocity: float | None) -> str:
        scale = axis.type.si_per_unit
        limit = axis.max_velocity / scale
        homed = self._service.homed(axis.index)
        if axis.homing is not None and not homed:
            limit = min(limit, axis.homing.jog_velocity / scale)
        if velocity is None and distance is not None:
            velocity = limit * DEFAULT_SHARE
        if velocity is None or velocity == 0.0 or not math.isfinite(velocity):
            raise Refused(
                "MC511", f"a jog needs a velocity, not {velocity}", "give its sign for the direction"
            )
        speed = min(abs(velocity), limit)
        if distance is None:
            return self._endless(axis, math.copysign(speed, velocity), homed=homed)
        if not math.isfinite(distance):
            raise Refused("MC511", f"{distance} is no distance", "leave it out for a jog without an end")
        return f"G94 F{60.0 * speed:.6f} G91 G01 [{axis.index}]{distance:.6f}"

    def _endless(self, axis: Axis, velocity: float, *, homed: bool) -> str:
        feed = f"G94 F{60.0 * abs(velocity):.6f}"
        limit = (axis.max_position if velocity > 0.0 else axis.min_position) / axis.type.si_per_unit
        if homed and math.isfinite(limit):
            return f"{feed} G90 G01 [{axis.index}]{limit:.6f}"
        return f"{feed} G91 G01 [{axis.index}]{velocity * ENDLESS_S:.6f}"
