"""Jog one axis, or a tool, by hand; each jog is a program of its own with a lease.

Jogs are in machine coordinates, independent of work offsets, tools and units of programs. A person's steps
during one of their own wait for its end; anybody else gets an error that names who moves the axis.

A jog without a distance continues while its client repeats the request, and stops without it, so that a
button that is never released, because the network broke, cannot keep an axis moving. A jog of a tool is such
a jog of all its joints, along a straight line.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from typing import TYPE_CHECKING

from mcserver.errors import Refused
from mcserver.machine.axis import Axis
from mcserver.service.axes_of_requests import axes_of, axis_of
from mcserver.service.program import Program
from mcserver.service.program_options import ProgramOptions
from mcserver.service.service import MachineService
from mcserver.service.tool_reach import ToolDirection, ToolFrame, reachable_move
from mcserver.units import DEGREE, MM

if TYPE_CHECKING:
    from mckinematics.solver import MachineKinematics

DEFAULT_HOLD_S = 0.5
# duration of the longest endless jog of an axis without limits
ENDLESS_S = 600.0
DEFAULT_SHARE = 0.1
# most steps of an axis that wait or run
STEPS = 8
# a watchdog that fires later than this was delayed with the whole server [s]
HELD_UP_S = 0.02
# time to read requests that have arrived meanwhile
READING_S = 0.05


class Jogging:
    """Jogs of one machine. All methods run in the loop.

    Args:
        kinematics: of its tools; None: tools cannot be jogged.
    """

    def __init__(self, service: MachineService, kinematics: MachineKinematics | None = None) -> None:
        self._service = service
        self._watches: dict[str, asyncio.TimerHandle] = {}
        self._kinematics = kinematics
        # jogs that have not ended: their axes, and the person at the client
        self._open: dict[str, tuple[tuple[int, ...], str]] = {}
        # set when a jog ends
        self._end = asyncio.Event()
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
            by: person at the client, if it serves several; jogs of other persons are refused.
            distance: [mm, deg], signed; None: endless. velocity: [mm/s, deg/s].

        Raises:
            ServiceError: MC507 no such axis, MC508 too many steps wait, MC511 a velocity of 0 or none,
                MC512 the axis is leased.
        """
        if program_id is not None:
            return self._keep(client, program_id, hold_s)
        axis = axis_of(self._service.machine, axis_index)
        if axis.gantry is not None:
            raise Refused(
                "MC507",
                f"axis {axis_index} is the second drive of axis {axis.gantry.leader}, and moves with it",
                f"jog axis {axis.gantry.leader}",
                axis=axis_index,
            )
        self._refuse_taken(client, by, (axis_index,), step=distance is not None)
        move = self._move(axis, distance, velocity)
        if distance is None and hold_s is None:
            hold_s = DEFAULT_HOLD_S
        return await self._start(
            client, f"axis {axis_index}", (axis_index,), move, by=by, hold_s=hold_s, unhomed=True
        )

    async def jog_tool(
        self,
        client: str,
        number: int,
        word: ToolDirection,
        velocity: float,
        *,
        frame: ToolFrame,
        by: str,
        hold_s: float | None,
        program_id: str | None,
    ) -> tuple[str, str]:
        """Move a tool until it is stopped or reaches an obstacle, or keep ``program_id`` alive.

        Args:
            word: X Y Z to move along that axis of the frame, A B C to turn about it.
            velocity: of the tip [mm/s], of a turn [deg/s], signed.

        Returns:
            The program's id, and what ends the move; empty: nothing within reach, or ``program_id`` is kept
            alive.

        Raises:
            ServiceError: MC303 … MC305 the tool cannot move there, MC310 no such tool, MC311 no orientation,
                MC511, MC512 an axis is leased.
        """
        if program_id is not None:
            return self._keep(client, program_id, hold_s), ""
        kinematics = self._kinematics
        if kinematics is None or number not in kinematics.tools:
            raise Refused("MC310", f"the machine has no tool {number}", "see `info`")
        if velocity == 0.0 or not math.isfinite(velocity):
            raise _no_velocity(velocity)
        chain = kinematics.axes(number)
        self._refuse_taken(client, by, chain, step=False)
        while any(self._service.holder(axis, at_pause=True) for axis in chain):
            # the move starts at the joints' positions: wait until an own jog is at rest
            await self._end.wait()
            self._refuse_taken(client, by, chain, step=False)
        longest, unit = 2.0 * kinematics.tool(number).chain.reach, MM if word in "XYZ" else DEGREE
        way = velocity * unit * ENDLESS_S
        if word in "XYZ":
            way = math.copysign(min(abs(way), longest), way)
        setpoint = self._service.port.snapshot().setpoint
        joints = dict(zip(axes_of(self._service.machine, None), setpoint, strict=True))
        # takes tens of milliseconds; a joint that is moved meanwhile is leased, and the planner solves the
        # move again
        found = await asyncio.to_thread(reachable_move, kinematics, number, joints, word, frame, way)
        move = f"G21 G94 F{60.0 * abs(velocity):.6f} {found.words}"
        hold_s = hold_s or DEFAULT_HOLD_S
        # the tool's position is only known with homed joints
        program = await self._start(
            client, f"tool {number} {word}", chain, move, by=by, hold_s=hold_s, unhomed=False
        )
        return program, found.obstacle

    async def _start(
        self,
        client: str,
        what: str,
        axes: tuple[int, ...],
        move: str,
        *,
        by: str,
        hold_s: float | None,
        unhomed: bool,
    ) -> str:
        """Run one move, with a watchdog if ``hold_s`` is given."""
        program = await self._service.open(
            client,
            ProgramOptions(
                name=f"jog {what}" + (f" by {by}" if by else ""),
                axes=axes,
                unhomed=unhomed,
                by_hand=True,
                at_pause=True,
            ),
        )
        self._open[program.program] = axes, by
        captures = [f"G1010 P{axis}" for axis in axes]
        try:
            await self._service.lines.submit(client, program.program, 1, [*captures, move])
        except Exception:
            self._service.abort(program.program, "the jog was refused")
            raise
        self._service.lines.close(client, program.program)
        if hold_s is not None:
            self._watch(program.program, hold_s)
        return program.program

    def _refuse_taken(self, client: str, by: str, axes: tuple[int, ...], *, step: bool) -> None:
        """Refuse a jog of axes that are moved by anything but earlier jogs by the same person."""
        for axis in axes:
            holder = self._service.holder(axis, at_pause=True)
            if holder is None:
                continue
            own = holder.client == client and self._open.get(holder.program) == (axes, by)
            if not own or not (step or holder.state == "ending"):
                self._service.refuse_leased(axis, at_pause=True)
            if sum(jog == (axes, by) for jog in self._open.values()) >= STEPS:
                raise Refused(
                    "MC508", f"{STEPS} steps of axis {axis} wait", "let some of them end", limit=STEPS
                )

    def _ended(self, program: Program) -> None:
        """Remove a jog that has ended; if it was broken off, abort the steps that wait for it."""
        ended = self._open.pop(program.program, None)
        self._end.set()
        self._end.clear()
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
            # the request may have come in time without having been read; extend once only
            self._watches[program_id] = loop.call_later(READING_S, self._let_go, program_id, math.inf)
            return
        self._watches.pop(program_id, None)
        with contextlib.suppress(Refused):
            # it may have ended
            self._service.abort(program_id, "the jog was let go")

    def _move(self, axis: Axis, distance: float | None, velocity: float | None) -> str:
        scale = axis.type.si_per_unit
        limit = axis.max_velocity / scale
        homed = self._service.homed(axis.index)
        if axis.homing is not None and not homed:
            limit = min(limit, axis.homing.jog_velocity / scale)
        if velocity is None and distance is not None:
            velocity = limit * DEFAULT_SHARE
        if velocity is None or velocity == 0.0 or not math.isfinite(velocity):
            raise _no_velocity(velocity)
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


def _no_velocity(velocity: float | None) -> Refused:
    return Refused("MC511", f"a jog needs a velocity, not {velocity}", "give its sign for the direction")
