"""``mcserver drives tune``: what an axis does by the motion of a program, and the margins of its loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Annotated, TypeAlias

import msgspec
import typer
from rich.table import Table

from mcserver.canopen.chirp import chirp_lines
from mcserver.canopen.cycle_samples import Array
from mcserver.canopen.frequency_response import MeasuredMargins, measure_response, measured_margins
from mcserver.canopen.scope import Scope, ScopeTrace
from mcserver.canopen.speed_tuning import (
    MeasuredSpeed,
    SpeedGains,
    SpeedMargins,
    measure_speed,
    proposed_gains,
    speed_controller,
    speed_margins,
)
from mcserver.canopen.torque_tuning import (
    Margins,
    MeasuredLoad,
    TorqueGains,
    margins,
    measure_load,
    torque_controller,
    usual_gains,
)
from mcserver.cli.console import json_answer_on_error, narration, results, write_json, write_text
from mcserver.cli.drive_of_machine import AxisArgument, Described, check_seconds, described, table
from mcserver.cli.drive_scope import LONGEST_S, record_cycles
from mcserver.cli.exit_codes import ExitCode
from mcserver.cli.options import JsonOption, MachineOption
from mcserver.cli.output_file import check_output, write_atomically
from mcserver.drives.cia402.drive import Cia402Drive, cia402_drive
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES, ETHERCAT_DELAY_CYCLES
from mcserver.errors import RuntimeFault, UsageFault
from mcserver.machine.machine_file import load_machine
from mcserver.planning.start_state import axis_word
from mcserver.units import TURN

# A measurement counts where it explains so much of the torque, and is not more uncertain than this.
LEAST_EXPLAINED, MOST_UNCERTAIN, MOST_UNCERTAIN_CYCLES = 0.9, 0.05, 0.5
# A loop does where its inertia may be half and twice as much, or its gain twice, with this phase left [rad].
LEAST_INERTIA, GREATEST_GAIN, LEAST_PHASE = 0.5, 2.0, math.radians(30.0)
# Shares of gains that are tried where a loop has too little left.
SHARES = tuple(1.0 / 1.1**step for step in range(32))
# The program of a chirp begins before it is looked at, and ends behind that [s].
CHIRP_AROUND_S = 4.0
# By which the machine file's inertia, and its unit of speed, may be wrong.
INERTIA_FITS, SCALE_FITS = 0.2, 0.02

Loop: TypeAlias = tuple[str, TorqueGains | SpeedGains, Margins | SpeedMargins]


@dataclass(frozen=True)
class Judged:
    """What a motion tells of an axis and its loop.

    Attributes:
        said: the measurement in words. loops: name, gains and margins, those of the machine file first.
        measured_margins: of these loops, on the measured response; None: they are not known.
        changes: lines for the machine file; none: it fits. remedy: what to do with them.
    """

    measured: MeasuredLoad | MeasuredSpeed
    said: str
    loops: Sequence[Loop]
    measured_margins: Sequence[MeasuredMargins | None]
    changes: Sequence[str]
    remedy: str


def tune(
    axis: AxisArgument,
    machine: MachineOption,
    seconds: Annotated[float, typer.Option("--seconds", help="How long the motion is looked at.")] = 10.0,
    chirp: Annotated[
        str,
        typer.Option("--chirp", metavar="FILE.gcode", help="Write a program that shakes the axis, and end."),
    ] = "",
    json: JsonOption = False,
) -> None:
    """Measure what an axis in mode cst or csv does while a program moves it, and judge its gains."""
    with json_answer_on_error(json):
        check_seconds(seconds, LONGEST_S)
        drive = described(machine, axis)
        known, loaded = cia402_drive(drive.axis), load_machine(machine)
        cycle_s = loaded.cycle_s
        if known.mode not in _JUDGES:
            raise UsageFault(
                "MC095",
                f'the loop of axis {axis} is the drive\'s own: mode = "{known.mode}"',
                'tune it by its maker\'s tool; mode = "cst" or "csv" closes it here',
            )
        if chirp:
            check_output(chirp, (".gcode",))
            lines = chirp_lines(drive.axis, axis_word(loaded, axis), seconds + CHIRP_AROUND_S, cycle_s)
            text = "".join(f"{line}\n" for line in lines).encode()
            write_atomically(chirp, lambda stream: stream.writelines((text,)))
    if chirp:
        if json:
            write_json({"ok": True, "lines": len(lines)})
        narration().print(
            f"{chirp}: run it where the axis has room above, and `mcserver drives tune {axis}` beside it"
        )
        return
    with json_answer_on_error(json):
        scope = Scope(drive.signals, cycle_s, max(2, round(seconds / cycle_s)), 0, None)
        record_cycles(loaded, drive, scope, 60.0, seconds)
        delay = ETHERCAT_DELAY_CYCLES if drive.settings.fieldbus == "ethercat" else DELAY_CYCLES
        found = _JUDGES[known.mode](drive, known, scope.trace(), cycle_s, delay)
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


def _judge_torque(
    drive: Described, known: Cia402Drive, trace: ScopeTrace, cycle_s: float, delay: int
) -> Judged:
    load = _load(drive, trace, cycle_s)
    now = TorqueGains(known.velocity_gain, known.position_gain, known.integral_time_s or 0.0)
    loops = [
        (name, gains, margins(gains, load.inertia, cycle_s, delay))
        for name, gains in (
            ("machine file", now),
            ("by this inertia", usual_gains(load.inertia, cycle_s, delay)),
        )
    ]
    torque, place = _columns(trace, "6071h:00", "6064h:00")
    turn = drive.axis.travel_per_motor_turn / drive.axis.type.si_per_unit
    response = measure_response(torque, place * (TURN / turn), 2)

    def measured(gains: TorqueGains) -> MeasuredMargins | None:
        if response is None:
            return None
        loop = torque_controller(gains, response.frequency, cycle_s)
        return measured_margins(response, loop, cycle_s, delay)

    found = [measured(gains) for _, gains, _ in loops]
    margin = loops[0][2]
    holds = margin.least <= LEAST_INERTIA and margin.greatest >= GREATEST_GAIN and margin.phase >= LEAST_PHASE
    changes = []
    if not holds or abs(known.inertia / load.inertia - 1.0) > INERTIA_FITS:
        changes.append(f"inertia = {load.inertia:.4g}   # in [axis.drive]: the file has {known.inertia:g}")
    elif _is_little(found[0]):
        # the load rings: all gains in one proportion
        calmer = _calmer(lambda share: measured(_scaled(now, share)))
        changes += [
            f"{name} = {value:.4g}   # in [axis.drive]: less, for the load rings"
            for name, value in asdict(_scaled(now, calmer)).items()
            if value
        ]
    return Judged(
        load,
        f"inertia {load.inertia:.4g} kg·m² (± {100 * load.uncertainty:.1f} %), friction {load.friction:.3g} "
        f"N·m and {load.viscous:.3g} N·m·s/rad, load {load.load:.3g} N·m; "
        f"{100 * load.explained:.1f} % explained",
        loops,
        found,
        changes,
        "the machine file does not fit: give this inertia, and leave velocity_gain, position_gain and "
        "integral_time_s out",
    )


def _judge_speed(
    drive: Described, known: Cia402Drive, trace: ScopeTrace, cycle_s: float, delay: int
) -> Judged:
    speed, place = _columns(trace, "60FFh:00", "6064h:00")
    measured = measure_speed(speed, place, cycle_s)
    if measured is None or not measured.uncertainty <= MOST_UNCERTAIN_CYCLES * cycle_s:
        what = "its speed changed too little, or its place has little to do with it"
        raise _untold(drive, "how it follows speeds", what)
    if measured.scale <= 0.0:
        raise _untold(drive, "how it follows speeds", "its speed and its position have opposite signs")
    now = SpeedGains(known.position_gain, known.integral_time_s or 0.0)
    best = proposed_gains(measured, now, cycle_s, delay)
    loops = [
        (name, gains, speed_margins(gains, measured, cycle_s, delay))
        for name, gains in (("machine file", now), ("by this drive", best))
    ]

    def on_response(gains: SpeedGains) -> MeasuredMargins | None:
        if response is None:
            return None
        loop = speed_controller(gains, response.frequency, cycle_s)
        return measured_margins(response, loop, cycle_s, delay)

    response = measure_response(speed, place, 1)
    found = [on_response(gains) for _, gains, _ in loops]
    margin = loops[0][2]
    changes = []
    if abs(measured.scale - 1.0) > SCALE_FITS:
        assert known.encoder is not None
        counts = known.velocity_counts_per_motor_rev or known.encoder[0] / known.encoder[1]
        changes.append(
            f"velocity_counts_per_motor_rev = {counts / measured.scale:.6g}   # in [axis.drive]: 60FFh"
        )
    if margin.greatest < GREATEST_GAIN or margin.phase < LEAST_PHASE or _is_little(found[0]):
        share = _calmer(lambda each: on_response(replace(best, position_gain=each * best.position_gain)))
        changes.append(
            f"position_gain = {share * best.position_gain:.4g}   # in [axis.drive]: the file has "
            f"{now.position_gain:g}"
        )
    return Judged(
        measured,
        f"goes {100 * measured.scale:.1f} % of the speed that it is told, {1e3 * measured.lag:.2f} ms "
        f"(± {1e3 * measured.uncertainty:.2f}) late besides the bus",
        loops,
        found,
        changes,
        "the machine file does not fit: change it so",
    )


def _is_little(margin: MeasuredMargins | None) -> bool:
    """Whether a loop has less left than it shall, as measured."""
    if margin is None:
        return False
    return margin.phase < LEAST_PHASE or (margin.gain is not None and margin.gain < GREATEST_GAIN)


def _calmer(measured: Callable[[float], MeasuredMargins | None]) -> float:
    """Return the greatest share of a loop's gains that leaves enough; 1 where nothing is measured."""
    return next((share for share in SHARES if not _is_little(measured(share))), SHARES[-1])


def _scaled(gains: TorqueGains, share: float) -> TorqueGains:
    return TorqueGains(
        share * gains.velocity_gain, share * gains.position_gain, gains.integral_time_s / share
    )


def _measured_text(margin: MeasuredMargins) -> str:
    beyond = "beyond what was measured" if margin.gain is None else f"stable up to gain × {margin.gain:.1f}"
    return f"{math.degrees(margin.phase):.0f}° left at {margin.crossover_hz:.1f} Hz, {beyond}"


_JUDGES: Mapping[str, Callable[[Described, Cia402Drive, ScopeTrace, float, int], Judged]] = MappingProxyType(
    {"cst": _judge_torque, "csv": _judge_speed}
)


def _load(drive: Described, trace: ScopeTrace, cycle_s: float) -> MeasuredLoad:
    """Return what a trace says of an axis's load; RuntimeFault: MC095 it says too little."""
    turn = drive.axis.travel_per_motor_turn / drive.axis.type.si_per_unit
    torque, place = _columns(trace, "6071h:00", "6064h:00")
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
    raise _untold(drive, "what its motor turns", what)


def _columns(trace: ScopeTrace, *objects: str) -> list[Array]:
    return [trace.values[:, trace.objects.index(name)] for name in objects]


def _untold(drive: Described, wanted: str, what: str) -> RuntimeFault:
    return RuntimeFault(
        "MC095",
        f"the motion of axis {drive.settings.axis} does not tell {wanted}: {what}",
        "run a program that moves it to and fro by many lengths, quickly and slowly, for all of --seconds",
        axis=drive.settings.axis,
    )


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
