"""``mcserver drives scope``: what is on the bus of one axis in every cycle, around a trigger."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
import typer

from mcserver.canopen.scope import Scope, read_trigger
from mcserver.canopen.scope_recording import record_cycles
from mcserver.cli.console import json_answer_on_error, narration, results, write_json
from mcserver.cli.drive_of_machine import AxisArgument, Described, check_seconds, described, table
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.errors import UsageFault
from mcserver.ethercat.line_health import listen
from mcserver.machine.machine_file import Machine, load_machine

LONGEST_S = 600.0


def scope(
    axis: AxisArgument,
    machine: MachineOption,
    output: Annotated[str, typer.Option("--output", "-o", metavar="FILE.mcap", help="Where to.")],
    seconds: Annotated[float, typer.Option("--seconds", help="How much is kept.")] = 2.0,
    trigger: Annotated[
        str, typer.Option("--trigger", metavar="'NAME > LEVEL'", help="Without one: at once.")
    ] = "",
    level: Annotated[
        bool, typer.Option("--level", help="Fire also where the level is met from the begin on.")
    ] = False,
    before: Annotated[
        float | None, typer.Option("--before", help="Seconds kept before the trigger; default: a quarter.")
    ] = None,
    timeout: Annotated[float, typer.Option("--timeout", help="How long the trigger may take [s].")] = 60.0,
    plot: Annotated[str, typer.Option("--plot", metavar="FILE.png", help="Draw it too.")] = "",
    json: JsonOption = False,
) -> None:
    """Record every mapped object of an axis beside a running server, cycle by cycle; nothing is sent."""
    with json_answer_on_error(json):
        check_output(output, (".mcap",))
        if plot:
            check_output(plot, (".png",))
        lead = (0.25 * seconds if trigger else 0.0) if before is None else before
        check_seconds(seconds, LONGEST_S)
        if not (0.0 <= lead < seconds and 0.0 < timeout < math.inf):
            raise UsageFault(
                "MC017",
                f"{seconds:g} s with {lead:g} s before the trigger, which may take {timeout:g} s, cannot be",
                "give --before less than --seconds, and a --timeout above 0",
            )
        drive = described(machine, axis)
        described_machine = load_machine(machine)
        cycle_s = described_machine.cycle_s
        fires = read_trigger(trigger, drive.signals, edge=not level) if trigger else None
        recorder = Scope(
            drive.signals, cycle_s, max(2, round(seconds / cycle_s)), round(lead / cycle_s), fires
        )
        ended_unix, missing = record(described_machine, drive, recorder, timeout)
        trace = recorder.trace()
        at_trigger = ended_unix - float(trace.time_s[-1])
        from mcserver.recorder.scope_file import write_scope

        write_atomically(
            output, lambda stream: write_scope(stream, trace, described_machine.name, at_trigger)
        )
        if plot:
            from mcserver.plot.scope_picture import draw_scope

            title = f"{described_machine.name}: axis {axis}" + (f", {trigger}" if trigger else "")
            write_atomically(plot, lambda stream: draw_scope(trace, stream, title))
    rows = []
    for at, name in enumerate(trace.names):
        known = trace.values[np.isfinite(trace.values[:, at]), at]
        lowest, highest = (float(known.min()), float(known.max())) if known.size else (math.nan, math.nan)
        rows.append(
            (trace.objects[at], name, trace.units[at], lowest, highest, len(trace.time_s) - known.size)
        )
    if json:
        titles = ("object", "name", "unit", "least", "greatest", "cycles_without")
        shown = [
            {key: None if value != value else value for key, value in zip(titles, row, strict=True)}
            for row in rows
        ]
        write_json({"ok": True, "cycles": len(trace.time_s), "cycles_missing": missing, "signals": shown})
    else:
        cells = [
            (place, name, unit, f"{low:.6g}", f"{high:.6g}", str(without))
            for place, name, unit, low, high, without in rows
        ]
        results().print(table(("object", "name", "unit", "least", "greatest", "cycles without"), cells))
    narration().print(f"{output}: {len(trace.time_s)} cycles" + (f", {plot}" if plot else ""))
    if missing:
        narration().print(
            f"warning: the bus had {missing} SYNCs fewer than cycle_hz says; times count SYNCs",
            style="yellow",
        )


def record(machine: Machine, drive: Described, recorder: Scope, timeout_s: float) -> tuple[float, int]:
    """Feed a scope from a drive's bus. Raises: as `record_cycles`; RuntimeFault MC424 the bus."""
    port = listen(machine, drive.settings.bus)
    try:
        return record_cycles(port, drive.settings, recorder, timeout_s)
    finally:
        port.close()
