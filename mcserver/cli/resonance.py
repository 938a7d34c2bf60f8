"""``mcserver resonance``: how an axis rings after its moves, and the shaper that takes that away."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.drive_of_machine import table
from mcserver.cli.options import DEFAULT_MACHINE, JsonOption, MachineOption
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.cli.recorded import is_recording_name, open_recording
from mcserver.errors import UsageFault
from mcserver.executor.entries import Array
from mcserver.machine.machine_file import Machine, load_machine
from mcserver.simulation.resonance import (
    SWEEP_S,
    Resonance,
    ShaperCost,
    compare_shapers,
    fit,
    fit_stop,
    fit_sweep,
    proposed,
    rings_of,
)

# A vibration that explains less of what is there is none.
LEAST_EXPLAINED = 0.6


def resonance(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE", help="A recording of moves and rests (.mcap, .npz), or an accelerometer's CSV."
        ),
    ],
    axis: Annotated[int, typer.Option("--axis", metavar="N", help="The axis that rings.")],
    machine: MachineOption = DEFAULT_MACHINE,
    column: Annotated[
        int | None, typer.Option("--column", metavar="N", help="Of a CSV; default: that which varies most.")
    ] = None,
    tool: Annotated[
        int | None,
        typer.Option("--tool", metavar="N", min=1, max=99999, help="That is in the spindle."),
    ] = None,
    plot: Annotated[str, typer.Option("--plot", metavar="FILE.png", help="Draw it too.")] = "",
    json: JsonOption = False,
) -> None:
    """Measure frequency and damping of an axis from a recording, and propose a shaper."""
    with json_answer_on_error(json):
        if plot:
            check_output(plot, (".png",))
        described, found, shown, step_s = _measure(file, axis, machine, column)
        if found is None or found.explained < LEAST_EXPLAINED:
            share = "" if found is None else f": {100 * found.explained:.0f} % of it is one vibration"
            raise UsageFault(
                "MC087",
                f"{file} has no ring of axis {axis} to measure{share}",
                "record quick moves with G04 P0.5 behind each; an accelerometer from one stop on, or for "
                "more than 10 s beside a sweep of frequencies",
            )
        measured = described.axes[described.column_of(axis)]
        costs = compare_shapers(found, measured, described.cycle_s)
        best = proposed(costs)
        if plot:
            from mcserver.plot.resonance_picture import draw_resonance

            title = f"{Path(file).name}: axis {axis}"
            write_atomically(plot, lambda stream: draw_resonance(found, costs, shown, step_s, stream, title))
        unit = measured.type.si_per_unit
        if json:
            measures = {
                name: getattr(found, name) for name in ("frequency_hz", "damping", "explained", "rings")
            }
            shapers = [_as_json(cost, unit) for cost in costs]
            write_json({"ok": True, **measures, "shapers": shapers, "proposed": best.shaper.type})
            return
    by = f"{found.rings} ring{'s' * (found.rings != 1)}" if found.rings else "a sweep"
    results().print(
        f"axis {axis}: {found.frequency_hz:.2f} Hz, damping {found.damping:.4f} "
        f"({by}, {100 * found.explained:.1f} % explained)"
    )
    cells = [
        (
            cost.shaper.type,
            f"{100 * cost.residual:.1f}",
            f"{100 * cost.worst:.1f}",
            f"{1e3 * cost.delay_s:.0f}",
            f"{1e3 * cost.length_s:.0f}",
            f"{cost.deviation / unit:.3f}",
        )
        for cost in costs
    ]
    titles = (
        "shaper",
        "leaves %",
        "at ±10 %",
        "path later ms",
        "stop later ms",
        f"deviates {measured.type.unit}",
    )
    results().print(table(titles, cells))
    shaper = best.shaper
    results().print(
        f"{'shaper' if tool is None else f'tool_shapers.{tool}'} = "
        f'{{ type = "{shaper.type}", frequency_hz = {shaper.frequency_hz}, '
        f"damping = {shaper.damping} }}",
        markup=False,
        highlight=False,
    )
    if plot:
        narration().print(f"drawn: {plot}")


def _as_json(cost: ShaperCost, unit: float) -> dict[str, object]:
    return {
        "type": cost.shaper.type,
        "residual": cost.residual,
        "worst": cost.worst,
        "delay_s": cost.delay_s,
        "length_s": cost.length_s,
        "deviation": cost.deviation / unit,
    }


def _measure(
    file: str, axis: int, machine: str, column: int | None
) -> tuple[Machine, Resonance | None, Array, float]:
    """Return the machine, the vibration, what it was measured by, and the seconds between two values of that.

    Raises:
        UsageFault: MC087 no such axis, no table of numbers; MC581 no recording.
    """
    if is_recording_name(file):
        opened = open_recording(file, machine)
        described, cycles = opened.machine, opened.run.cycles
        _column_of(described, axis)
        if axis not in cycles.axes:
            raise UsageFault("MC087", f"{file} has no axis {axis}", "name an axis that was recorded")
        at = [int(each) for each in cycles.axes].index(axis)
        rings = rings_of(cycles.setpoint[:, at], cycles.actual[:, at], described.cycle_s)
        longest = max(rings, key=len, default=np.zeros(0))
        return described, fit(rings, described.cycle_s), longest, described.cycle_s
    described = load_machine(machine)
    _column_of(described, axis)
    values = _numbers(file)
    chosen = int(np.argmax(values[:, 1:].std(axis=0))) + 1 if column is None else column
    if not 1 <= chosen < values.shape[1]:
        most = values.shape[1] - 1
        raise UsageFault("MC087", f"{file} has no column {chosen}", f"the time is 0, give 1 to {most}")
    signal = values[:, chosen]
    step_s = float((values[-1, 0] - values[0, 0]) / (len(values) - 1))
    # sensors sample less evenly than they say
    even = np.interp(values[0, 0] + np.arange(len(values)) * step_s, values[:, 0], signal)
    if len(even) * step_s > SWEEP_S:
        return described, fit_sweep(even, step_s), even, step_s
    stop = fit_stop(even, step_s)
    return (described, None, even, step_s) if stop is None else (described, *stop)


def _column_of(machine: Machine, axis: int) -> None:
    if machine.axis(axis) is None:
        raise UsageFault("MC087", f"{machine.name} has no axis {axis}", "name an axis of the machine file")


def _numbers(file: str) -> Array:
    """Return a CSV's numbers, shape (n, columns): times first [s], then what was measured."""
    rows = []
    try:
        text = Path(file).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageFault(
            "MC087", f"{file} cannot be read: {error}", "give a CSV of times and values"
        ) from error
    for line in text.splitlines():
        try:
            rows.append([float(each) for each in line.split(",")])
        except ValueError:
            # a heading
            continue
    widths = {len(row) for row in rows}
    values: Array = np.array(rows) if len(widths) == 1 else np.zeros((0, 0))
    if values.ndim != 2 or values.shape[1] < 2 or len(values) < 16 or not np.isfinite(values).all():
        raise UsageFault("MC087", f"{file} is no table of times and values", "time_s,x,y,z in each line")
    if not (np.diff(values[:, 0]) > 0.0).all():
        raise UsageFault("MC087", f"the times in {file} do not rise", "the first column is the time [s]")
    return values
