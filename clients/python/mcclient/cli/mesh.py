"""``mcctl mesh Z X Y``: a mesh of the machine file, from the places that a probing program meets."""

from __future__ import annotations

import itertools
from collections.abc import AsyncIterator, Sequence
from typing import Annotated, Any

import typer

from mcclient.cli.options import JsonOption, Target, axis_of
from mcclient.cli.output import results, say, write_json
from mcclient.errors import MotionError, RequestRefused
from mcclient.machine import Machine
from mcclient.types import Event

# Places that differ by less are in one row or column of the mesh [mm].
SAME_MM = 0.1


def mesh(
    target: Target,
    axis: Annotated[str, typer.Argument(metavar="AXIS", help="The axis that probes, such as Z.")],
    first: Annotated[str, typer.Argument(metavar="FIRST", help="The axis along the rows, such as X.")],
    second: Annotated[str, typer.Argument(metavar="SECOND", help="The axis across them, such as Y.")],
    json: JsonOption = False,
) -> None:
    """Wait for a program that probes points of a grid, and print them as a mesh: mcctl mesh Z X Y.

    Start the program behind it. The first point counts as right; the mesh goes into the machine file.
    """

    async def work(one: Machine) -> tuple[tuple[int, int], dict[str, Any]]:
        numbers = [axis_of(text, one.info).index for text in (axis, first, second)]
        if len(set(numbers)) < len(numbers):
            raise RequestRefused("MC511", "an axis is named twice", "such as: mcctl mesh Z X Y")
        events = one.events()
        say(f"{one.name}: waiting for a program that probes")
        points = await probed(events, numbers)
        return (numbers[1], numbers[2]), mesh_of(points)

    over, found = target.carry_out(work, json)
    if json:
        write_json({"ok": True, "axes": over, **found})
        return
    lines = ["[axis.compensation.mesh]", f"axes = {list(over)}"]
    lines += [f"{key} = {found[key]}" for key in ("first", "second", "errors")]
    for line in lines:
        results().print(line, soft_wrap=True, markup=False, highlight=False)


async def probed(events: AsyncIterator[Event], axes: Sequence[int]) -> list[tuple[float, ...]]:
    """Return the places that the first probing program meets, up to its end: axes in order [mm].

    Raises:
        MotionError: it did not end well, or the connection did.
    """
    program: str | None = None
    points: list[tuple[float, ...]] = []
    async for event in events:
        probe = event.probe
        if event.kind == "probe" and probe is not None and event.program in (program or event.program,):
            program = event.program
            if probe.tripped:
                points.append(tuple(probe.positions[str(each)] for each in axes))
        if event.kind == "program.ended" and program is not None and event.program == program:
            if event.fault is not None:
                raise MotionError(event.fault.code, event.fault.message, event.fault.hint)
            if event.state != "finished":
                raise MotionError("MC506", f"probing ended as {event.state}", "probe all points again")
            return points
    raise MotionError("MC534", "the connection ended while points were probed", "see mcctl status")


def mesh_of(points: Sequence[tuple[float, ...]]) -> dict[str, Any]:
    """Return positions of columns (``first``) and rows (``second``) and errors of points [mm].

    Args:
        points: height and place of each. One that is met twice counts by the mean of both.

    Raises:
        MotionError: MC093 they are no grid.
    """
    columns, rows = (_places([point[at] for point in points]) for at in (1, 2))
    heights: dict[tuple[int, int], list[float]] = {}
    for height, x, y in points:
        heights.setdefault((_nearest(rows, y), _nearest(columns, x)), []).append(height)
    missing = [
        f"{columns[column]:.1f} {rows[row]:.1f}"
        for row, column in itertools.product(range(len(rows)), range(len(columns)))
        if (row, column) not in heights
    ]
    if len(columns) < 2 or len(rows) < 2 or missing:
        what = f"nothing was met at {', '.join(missing[:5])}" if missing else "2 by 2 points are the least"
        raise MotionError("MC093", f"the points are no grid: {what}", "probe each column in each row")
    mean = {place: sum(each) / len(each) for place, each in heights.items()}
    # a bed that is met higher asks for a higher axis: the load is too low there
    right = mean[_nearest(rows, points[0][2]), _nearest(columns, points[0][1])]
    errors = [
        [round(right - mean[row, column], 4) + 0.0 for column in range(len(columns))]
        for row in range(len(rows))
    ]
    # no -0.0
    first, second = ([round(each, 3) + 0.0 for each in places] for places in (columns, rows))
    return {"first": first, "second": second, "errors": errors}


def _places(values: Sequence[float]) -> list[float]:
    """Return the means of values that are one place, ascending."""
    groups: list[list[float]] = []
    for value in sorted(values):
        if groups and value - groups[-1][0] < SAME_MM:
            groups[-1].append(value)
        else:
            groups.append([value])
    return [sum(group) / len(group) for group in groups]


def _nearest(places: Sequence[float], value: float) -> int:
    return min(range(len(places)), key=lambda at: abs(places[at] - value))
