"""``mcserver drives tune``: what a motor turns, by the motion of a program, and its loop's margins."""

from __future__ import annotations

import math
from typing import Annotated

import msgspec
import typer

from mcserver.canopen.scope import Scope, ScopeTrace
from mcserver.canopen.torque_tuning import (
    Margins,
    MeasuredLoad,
    TorqueGains,
    margins,
    measure_load,
    usual_gains,
)
from mcserver.cli.console import json_answer_on_error, narration, results, write_json, write_text
from mcserver.cli.drive_of_machine import AxisArgument, Described, check_seconds, described, table
from mcserver.cli.drive_scope import LONGEST_S, record_cycles
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.errors import RuntimeFault, UsageFault
from mcserver.machine.machine_file import load_machine
from mcserver.units import TURN

# A measurement counts where it explains so much of the torque, and is not more uncertain than this.
LEAST_EXPLAINED, MOST_UNCERTAIN = 0.9, 0.05
# A loop does where its inertia may be half and twice as much, with this phase left [rad].
LEAST_INERTIA, GREATEST_INERTIA, LEAST_PHASE = 0.5, 2.0, math.radians(30.0)
# By which the machine file's inertia may be wrong.
INERTIA_FITS = 0.2


def tune(
    axis: AxisArgument,
    machine: MachineOption,
    seconds: Annotated[float, typer.Option("--seconds", help="How long the motion is looked at.")] = 10.0,
    json: JsonOption = False,
) -> None:
    """Measure inertia and friction of an axis in mode cst while a program moves it, and judge its gains."""
    with json_answer_on_error(json):
        check_seconds(seconds, LONGEST_S)
        drive = described(machine, axis)
        if drive.settings.fieldbus != "can":
            raise UsageFault(
                "MC559",
                f"{drive.settings.name}: is on EtherCAT, whose readings are of another time than CAN's",
                "give inertia by the motor's data sheet and its load; the gains follow from it",
            )
        known, loaded = cia402_drive(drive.axis), load_machine(machine)
        cycle_s = loaded.cycle_s
        if known.mode != "cst":
            raise UsageFault(
                "MC095",
                f'the loop of axis {axis} is the drive\'s own: mode = "{known.mode}"',
                'tune it by its maker\'s tool; mode = "cst" closes it here',
            )
        scope = Scope(drive.signals, cycle_s, max(2, round(seconds / cycle_s)), 0, None)
        record_cycles(loaded, drive, scope, 60.0, seconds)
        load = _load(drive, scope.trace(), cycle_s)
    now = TorqueGains(known.velocity_gain, known.position_gain, known.integral_time_s or 0.0)
    usual = usual_gains(load.inertia, cycle_s)
    rows = [
        (name, gains, margins(gains, load.inertia, cycle_s))
        for name, gains in (("machine file", now), ("by this inertia", usual))
    ]
    fits = abs(known.inertia / load.inertia - 1.0) <= INERTIA_FITS and _holds(rows[0][2])
    if json:
        answer = {"ok": True, "fits": fits, **msgspec.to_builtins(load)}
        loops = [
            {"gains": name, **msgspec.to_builtins(gains), **msgspec.to_builtins(margin)}
            for name, gains, margin in rows
        ]
        write_json({**answer, "loops": loops})
    else:
        _show(load, rows)
        if not fits:
            write_text(f"inertia = {load.inertia:.4g}   # in [axis.drive]: the file has {known.inertia:g}\n")
    narration().print(
        "the machine file fits"
        if fits
        else "the machine file does not fit: give this inertia, and leave velocity_gain, position_gain and "
        "integral_time_s out"
    )
    if not fits:
        raise typer.Exit(int(ExitCode.CONFIGURATION))


def _holds(margin: Margins) -> bool:
    within = margin.least <= LEAST_INERTIA and margin.greatest >= GREATEST_INERTIA
    return within and margin.phase >= LEAST_PHASE


def _load(drive: Described, trace: ScopeTrace, cycle_s: float) -> MeasuredLoad:
    """Return what a trace says of an axis's load; RuntimeFault: MC095 it says too little."""
    turn = drive.axis.travel_per_motor_turn / drive.axis.type.si_per_unit
    torque, place = (trace.values[:, trace.objects.index(name)] for name in ("6071h:00", "6064h:00"))
    load = measure_load(torque, place * (TURN / turn), cycle_s)
    if load is None:
        what = "it moved too little, or one way only"
    elif load.inertia <= 0.0:
        what = "its torque and its position have opposite signs"
    elif load.explained < LEAST_EXPLAINED or load.uncertainty > MOST_UNCERTAIN:
        what = (
            f"a rigid load with friction explains {100 * load.explained:.0f} % of its torque, and leaves its "
            f"inertia uncertain by {100 * load.uncertainty:.1f} %"
        )
    else:
        return load
    raise RuntimeFault(
        "MC095",
        f"the motion of axis {drive.settings.axis} does not tell what its motor turns: {what}",
        "run a program that moves it to and fro by many lengths, quickly and slowly, for all of --seconds",
        axis=drive.settings.axis,
    )


def _show(load: MeasuredLoad, rows: list[tuple[str, TorqueGains, Margins]]) -> None:
    results().print(
        f"inertia {load.inertia:.4g} kg·m² (± {100 * load.uncertainty:.1f} %), friction {load.friction:.3g} "
        f"N·m and {load.viscous:.3g} N·m·s/rad, load {load.load:.3g} N·m; "
        f"{100 * load.explained:.1f} % explained"
    )
    cells = [
        (
            name,
            f"{gains.velocity_gain:.4g}",
            f"{gains.position_gain:.4g}",
            f"{gains.integral_time_s:.4g}",
            f"{margin.least:.2f} to {margin.greatest:.1f}" if margin.greatest else "not stable",
            f"{math.degrees(margin.phase):.0f}",
        )
        for name, gains, margin in rows
    ]
    titles = (
        "gains",
        "velocity_gain",
        "position_gain",
        "integral_time_s",
        "stable for inertia ×",
        "phase left °",
    )
    results().print(table(titles, cells))
