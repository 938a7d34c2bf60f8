"""``mcserver drives tune``: what an axis does by the motion of a program, and the margins of its loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Annotated

import msgspec
import typer
from rich.table import Table

from mcserver.canopen.chirp import CHIRP_AROUND_S, chirp_lines
from mcserver.canopen.frequency_response import MeasuredMargins
from mcserver.canopen.loop_tuning import Loop, check_tunable, judge
from mcserver.canopen.scope import Scope
from mcserver.canopen.torque_tuning import Margins
from mcserver.cli.console import json_answer_on_error, narration, results, write_json, write_text
from mcserver.cli.drive_of_machine import AxisArgument, check_seconds, described, table
from mcserver.cli.drive_scope import LONGEST_S, record
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.machine.machine_file import load_machine
from mcserver.planning.start_state import axis_word


def tune(
    axis: AxisArgument,
    machine: MachineOption,
    seconds: Annotated[float, typer.Option("--seconds", help="How long the motion is looked at.")] = 10.0,
    chirp: Annotated[
        str,
        typer.Option("--chirp", metavar="FILE.gcode", help="Write a program that shakes the axis, and end."),
    ] = "",
    room: Annotated[
        float, typer.Option("--room", min=0.001, help="No move of the chirp is longer [mm or deg].")
    ] = math.inf,
    json: JsonOption = False,
) -> None:
    """Measure what an axis in mode cst or csv does while a program moves it, and judge its gains."""
    with json_answer_on_error(json):
        check_seconds(seconds, LONGEST_S)
        drive = described(machine, axis)
        check_tunable(drive.axis)
        loaded = load_machine(machine)
        cycle_s = loaded.cycle_s
        if chirp:
            check_output(chirp, (".gcode",))
            unit = drive.axis.type.si_per_unit
            lines = chirp_lines(
                drive.axis, axis_word(loaded, axis), seconds + CHIRP_AROUND_S, cycle_s, unit, room
            )
            text = "".join(f"{line}\n" for line in lines).encode()
            write_atomically(chirp, lambda stream: stream.write(text))
    if chirp:
        if json:
            write_json({"ok": True, "lines": len(lines)})
        narration().print(
            f"{chirp}: run it where the axis has room above, and `mcserver drives tune {axis}` beside it"
        )
        return
    with json_answer_on_error(json):
        scope = Scope(drive.signals, cycle_s, max(2, round(seconds / cycle_s)), 0, None)
        record(loaded, drive, scope, 60.0)
        found = judge(drive.axis, scope.trace(), cycle_s, drive.settings.fieldbus)
    if json:
        loops = [
            {
                "gains": name,
                **msgspec.to_builtins(gains),
                **msgspec.to_builtins(margin),
                "measured": msgspec.to_builtins(measured),
            }
            for (name, gains, margin), measured in zip(found.loops, found.measured_margins, strict=True)
        ]
        fits = {"ok": True, "fits": not found.changes}
        write_json({**fits, **msgspec.to_builtins(found.measured), "loops": loops})
    else:
        results().print(found.said)
        results().print(_table(found.loops))
        for (name, *_), measured in zip(found.loops, found.measured_margins, strict=True):
            if measured is not None:
                write_text(f"{name}, as measured: {_measured_text(measured)}\n")
        for change in found.changes:
            write_text(f"{change}\n")
    narration().print(found.remedy if found.changes else "the machine file fits")
    if found.changes:
        raise typer.Exit(int(ExitCode.CONFIGURATION))


def _measured_text(margin: MeasuredMargins) -> str:
    beyond = "beyond what was measured" if margin.gain is None else f"stable up to gain × {margin.gain:.1f}"
    return f"{math.degrees(margin.phase):.0f}° left at {margin.crossover_hz:.1f} Hz, {beyond}"


def _table(loops: Sequence[Loop]) -> Table:
    rows = []
    for name, gains, margin in loops:
        numbers = {"gains": name, **{key: f"{each:.4g}" for key, each in asdict(gains).items()}}
        if isinstance(margin, Margins):
            within = f"{margin.least:.2f} to {margin.greatest:.1f}" if margin.greatest else "not stable"
            numbers["stable for inertia ×"] = within
        else:
            numbers["stable up to gain ×"] = f"{margin.greatest:.1f}"
        rows.append({**numbers, "phase left °": f"{math.degrees(margin.phase):.0f}"})
    return table(rows[0], [list(row.values()) for row in rows])
