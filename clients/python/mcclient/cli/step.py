"""``mcctl drives step``: a short motion of one axis and back, recorded, measured and drawn, for tuning."""

from __future__ import annotations

import asyncio
import csv
import dataclasses
import itertools
import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Table

from mcclient.cli.options import JsonOption, Target
from mcclient.cli.output import results, say, write_json
from mcclient.cli.tables import plain_table
from mcclient.errors import RequestRefused
from mcclient.machine import Machine
from mcclient.step_response import Array, StepResponse, step_response
from mcclient.telemetry import Samples
from mcclient.types import AxisInfo

# A look at a drive's loop is no motion across the machine [mm, deg].
MOST = 10.0
REST_S = 1.0
# cycles at most that are kept
MOST_ROWS = 200_000


def step(
    target: Target,
    axis: Annotated[int, typer.Argument(min=0, max=63, metavar="AXIS", help="Which axis moves.")],
    distance: Annotated[
        float, typer.Option("--distance", "-d", help=f"mm or deg there and back, {MOST:g} at most.")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.csv", help="Every cycle of it.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option("--plot", metavar="FILE.png", help="A picture of it; needs matplotlib.")
    ] = None,
    armed: Annotated[
        bool, typer.Option("--armed", help="Do not ask: somebody stands at the machine and sees the axis.")
    ] = False,
    json: JsonOption = False,
) -> None:
    """Move an axis a little and back as quickly as its limits allow, and measure how its drive follows."""
    if not 0.0 < abs(distance) <= MOST:
        raise typer.BadParameter(f"give a distance other than 0, {MOST:g} mm or deg at most")
    if plot is not None:
        _drawing()

    async def work(one: Machine) -> tuple[AxisInfo, Array, list[StepResponse]]:
        info = await _ready(one, axis)
        if not armed:
            await _ask(one.name, info, distance)
        rows = await _record(one, axis, distance)
        return info, rows, measured(rows, info.in_position)

    info, rows, legs = target.carry_out(work, json)
    if output is not None:
        _write(output, rows, info)
    if plot is not None:
        _draw(plot, rows, legs, info)
    if json:
        shown = [dataclasses.asdict(leg) for leg in legs]
        write_json({"ok": True, "axis": axis, "unit": info.unit, "legs": shown})
    else:
        results().print(_table(legs, info))
        for each in (output, plot):
            if each is not None:
                say(str(each))


def measured(rows: Array, tolerance: float) -> list[StepResponse]:
    """Measure the way there and the way back; ``rows``: shape (n, 3), time, setpoint, encoder."""
    time_s, setpoint, actual = rows.T
    moving = np.flatnonzero(np.diff(setpoint))
    if not len(moving):
        return []
    pauses = np.flatnonzero(np.diff(time_s[moving]) > REST_S / 2)
    cuts = [0, *((int(moving[at]) + int(moving[at + 1])) // 2 for at in pauses), len(rows)]
    legs = []
    for begin, end in itertools.pairwise(cuts):
        leg = step_response(time_s[begin:end], setpoint[begin:end], actual[begin:end], tolerance)
        if leg is not None:
            legs.append(leg)
    return legs


async def _ready(machine: Machine, axis: int) -> AxisInfo:
    info = next((each for each in machine.info.axes if each.index == axis), None)
    if info is None:
        raise RequestRefused("MC511", f"the machine has no axis {axis}", "mcctl status lists them")
    axes = (await machine.status()).axes
    state = dict(zip(axes.index, axes.state, strict=True)).get(axis, "off")
    if state != "standstill":
        raise RequestRefused(
            "MC511", f"axis {axis} is {state}: a step begins at rest", f"energize it first: G1010 P{axis}"
        )
    return info


async def _ask(name: str, info: AxisInfo, distance: float) -> None:
    """Let the operator arm the motion by typing the axis's number."""
    if not sys.stdin.isatty():
        raise RequestRefused(
            "MC511", "nobody is here to arm the step", "give --armed where somebody sees the axis"
        )
    say(
        f"{name}: axis {info.index} moves by {distance:g} {info.unit} and back with up to "
        f"{info.max_velocity:g} {info.unit}/s and {info.max_acceleration:g} {info.unit}/s²"
    )
    answer = await asyncio.to_thread(
        typer.prompt, f"type {info.index} to arm it", default="", show_default=False
    )
    if answer.strip() != str(info.index):
        raise RequestRefused("MC511", "the step was not armed", "nothing has moved")


async def _record(machine: Machine, axis: int, distance: float) -> Array:
    """Run the motion and return its cycles, shape (n, 3): time [s], setpoint, encoder."""
    kept: list[Array] = []
    count = 0
    feed = machine.samples()

    async def take() -> None:
        nonlocal count
        async for samples in feed:
            kept.append(_rows(samples, axis))
            count += len(kept[-1])
            if count > MOST_ROWS:
                return

    taking = asyncio.ensure_future(take())
    try:
        lines = (f"G91 G00 [{axis}]{distance:.6f}", f"G04 P{REST_S:g}", f"G91 G00 [{axis}]{-distance:.6f}")
        async with machine.program("drives step", [axis]) as program:
            for line in (f"G04 P{REST_S / 2:g}", *lines, f"G04 P{REST_S:g}"):
                await program.send(line)
    finally:
        taking.cancel()
        await asyncio.gather(taking, return_exceptions=True)
    if not kept:
        raise RequestRefused("MC511", "no telemetry came during the step", "see mcctl watch")
    rows: Array = np.concatenate(kept)
    if len(rows) > 1 and np.diff(rows[:, 0]).max() > 1.5 * np.median(np.diff(rows[:, 0])):
        raise RequestRefused("MC511", "cycles were lost on the way here", "repeat it nearer to the server")
    return rows


def _rows(samples: Samples, axis: int) -> Array:
    column = samples.axes.index(axis)
    rows: Array = np.column_stack((samples.time_s, samples.setpoint[:, column], samples.actual[:, column]))
    return rows


def _table(legs: list[StepResponse], info: AxisInfo) -> Table:
    table = plain_table()
    table.add_column("")
    for leg in legs:
        table.add_column(f"{leg.distance:+g} {info.unit}", justify="right")
    unit = info.unit
    settled = ["never" if leg.settling_s is None else f"{leg.settling_s * 1e3:.0f} ms" for leg in legs]
    table.add_row("motion", *(f"{leg.duration_s * 1e3:.0f} ms" for leg in legs))
    table.add_row("greatest following error", *(f"{leg.greatest_error:.4g} {unit}" for leg in legs))
    table.add_row("delay of the encoder", *(f"{leg.delay_s * 1e3:.1f} ms" for leg in legs))
    table.add_row("error without that delay", *(f"{leg.error_without_delay:.4g} {unit}" for leg in legs))
    table.add_row("overshoot", *(f"{leg.overshoot:.4g} {unit}" for leg in legs))
    table.add_row(f"settled within {info.in_position:g} {unit}", *settled)
    table.add_row("noise at rest", *(f"{leg.noise:.3g} {unit}" for leg in legs))
    return table


def _write(path: Path, rows: Array, info: AxisInfo) -> None:
    try:
        with path.open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(("time_s", "line", f"setpoint_{info.index}", f"actual_{info.index}"))
            begin = rows[0, 0]
            writer.writerows(
                (f"{time - begin:.6f}", 0, setpoint, actual) for time, setpoint, actual in rows.tolist()
            )
    except OSError as error:
        raise typer.BadParameter(f"{path} cannot be written: {error.strerror}") from error


def _drawing() -> Any:
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise typer.BadParameter(
            "--plot needs matplotlib: pip install matplotlib, or use --output"
        ) from error
    return Figure


def _draw(path: Path, rows: Array, legs: list[StepResponse], info: AxisInfo) -> None:
    figure = _drawing()(figsize=(9.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    time_s, setpoint, actual = rows.T
    time_s = time_s - time_s[0]
    above.plot(time_s, setpoint, label="setpoint", linewidth=1.0)
    above.plot(time_s, actual, label="encoder", linewidth=1.0)
    above.set_ylabel(f"position [{info.unit}]")
    above.set_title(f"axis {info.index}: " + ", ".join(f"{leg.distance:+g} {info.unit}" for leg in legs))
    above.legend(loc="best")
    below.plot(time_s, setpoint - actual, color="tab:red", linewidth=1.0)
    below.axhspan(-info.in_position, info.in_position, color="tab:green", alpha=0.15, label="in_position")
    below.set_ylabel(f"following error [{info.unit}]")
    below.set_xlabel("time [s]")
    below.legend(loc="upper right")
    for each in (above, below):
        each.grid(alpha=0.3)
    try:
        figure.savefig(path, dpi=120)
    except (OSError, ValueError) as error:
        raise typer.BadParameter(f"{path} cannot be drawn: {error}") from error
