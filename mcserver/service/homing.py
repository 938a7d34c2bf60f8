"""Homing and references for operators: programs of control entries, each with a lease."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence

from mcserver.errors import Refused
from mcserver.executor.entries import Control, ControlKind
from mcserver.machine.axis import Axis, axis_name
from mcserver.motion.canonical import AxisOperation
from mcserver.service.axes_of_requests import axes_of, axis_of
from mcserver.service.program import Program
from mcserver.service.service import MachineService

# Longest wait until a reference is set, and polling interval [s].
REFERENCE_LIMIT_S = 3.0
REFERENCE_LOOK_S = 0.005
_CAPTURE = list(AxisOperation).index(AxisOperation.CAPTURE)


class HomingService:
    """Homes the axes of one machine. All methods run in the loop."""

    def __init__(self, service: MachineService) -> None:
        self._service = service
        self._machine = service.machine

    async def home(self, client: str, axes: Sequence[int] | None) -> Program:
        """Begin homing axes, those of the lowest order first; None: all that can home themselves.

        Raises:
            ServiceError: MC455 an axis cannot home itself, MC507 no such axis, MC512 it is leased.
        """
        if axes is None:
            chosen = self._finding()
        else:
            chosen = [axis_of(self._machine, index) for index in axes_of(self._machine, axes)]
        for axis in chosen:
            if axis.homing is None or not axis.homing.finds:
                raise Refused(
                    "MC455",
                    f"axis {axis.index} has no homing of its own",
                    f"say where it is: mcctl reference {axis.index} POSITION",
                    axis=axis.index,
                )
        numbers = [axis.index for axis in chosen]
        self._check_free(numbers)
        groups: dict[int, int] = {}
        for axis in chosen:
            order = axis.homing.order if axis.homing is not None else 0
            groups[order] = groups.get(order, 0) | self._machine.mask_of([axis.index])
        everything = sum(groups.values())
        controls = [Control(ControlKind.AXIS, 0.0, 0, axes=everything, operation=_CAPTURE)]
        controls += [Control(ControlKind.HOME, 0.0, 0, axes=groups[order]) for order in sorted(groups)]
        controls.append(Control(ControlKind.FINISH, 0.0, 0))
        shown = " ".join(str(number) for number in numbers)
        return await self._service.command(client, f"home axis {shown}", numbers, controls)

    async def reference(self, client: str, positions: Mapping[int, float]) -> Program:
        """Set the positions of axes [m or rad] without motion. Returns once they are set.

        Raises:
            ServiceError: MC455 an axis without ``[axis.homing]``, MC458 it moves, MC507, MC511, MC512, MC596
                an axis that homes itself.
        """
        if not positions:
            raise Refused("MC511", "a reference names no axis", "give axes and positions")
        values = [math.nan] * len(self._machine.axes)
        for index, position in positions.items():
            axis = axis_of(self._machine, index)
            if axis.homing is None:
                raise Refused(
                    "MC455",
                    f"axis {index} has no [axis.homing]: its encoder's reading is its position",
                    'add [axis.homing] with method = "manual" or "absolute" to the machine file',
                    axis=index,
                )
            if axis.homing.finds:
                raise Refused(
                    "MC596",
                    f'axis {index} finds its reference by itself (method "{axis.homing.method}"): a place'
                    " that is said by hand is not it",
                    f'mcctl home {axis_name(index)}; with method = "manual" its place is said by hand',
                    axis=index,
                )
            if not math.isfinite(position):
                raise Refused("MC511", f"{position} is no position", "give a number")
            values[self._machine.column_of(index)] = position
        self._check_free(list(positions))
        controls = [
            Control(
                ControlKind.REFERENCE, 0.0, 0, axes=self._machine.mask_of(positions), values=tuple(values)
            ),
            Control(ControlKind.FINISH, 0.0, 0),
        ]
        shown = " ".join(str(number) for number in positions)
        program = await self._service.command(client, f"reference axis {shown}", list(positions), controls)
        for _ in range(round(REFERENCE_LIMIT_S / REFERENCE_LOOK_S)):
            if program.ended:
                break
            await asyncio.sleep(REFERENCE_LOOK_S)
        if program.fault is not None:
            raise Refused(program.fault.code, program.fault.message, program.fault.hint)
        if not program.over or program.ended_as != "finished":
            self._service.abort(program.program, "the reference took too long")
            raise Refused("MC458", "the reference was not given in time", "see mcctl status, then try again")
        return program

    def _finding(self) -> list[Axis]:
        found = [axis for axis in self._machine.axes if axis.homing is not None and axis.homing.finds]
        if not found:
            raise Refused(
                "MC455",
                f"no axis of {self._machine.name} finds a reference by itself",
                "add [axis.homing] to the machine file, or say where axes are: mcctl reference",
            )
        return found

    def _check_free(self, axes: Sequence[int]) -> None:
        for axis in axes:
            lender = self._service.holder(axis)
            # an approved run's positions are based on the references at its approval
            self._service.refuse_leased(axis, at_pause=lender is None or lender.envelope is None)
