"""The gains of a loop that is closed here, by what the axis did while a program moved it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Generic, TypeAlias, TypeVar

from mcserver.canopen.cycle_samples import Array
from mcserver.canopen.frequency_response import (
    Complex,
    MeasuredMargins,
    Response,
    measure_response,
    measured_margins,
    opened_loop,
)
from mcserver.canopen.scope import ScopeTrace
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
from mcserver.drives.cia402.drive import Cia402Drive, cia402_drive
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES, ETHERCAT_DELAY_CYCLES
from mcserver.errors import RuntimeFault, UsageFault
from mcserver.machine.axis import Axis
from mcserver.units import TURN

# A measurement counts where it explains so much of the torque, and is not more uncertain than this.
LEAST_EXPLAINED, MOST_UNCERTAIN, MOST_UNCERTAIN_CYCLES = 0.9, 0.05, 0.5
# A loop does where its inertia may be half and twice as much, or its gain twice, with this phase left [rad].
LEAST_INERTIA, GREATEST_GAIN, LEAST_PHASE = 0.5, 2.0, math.radians(30.0)
# Shares of gains that are tried where a loop has too little left.
SHARES = tuple(1.0 / 1.1**step for step in range(32))
# By which the machine file's inertia, and its unit of speed, may be wrong.
INERTIA_FITS, SCALE_FITS = 0.2, 0.02

Loop: TypeAlias = tuple[str, TorqueGains | SpeedGains, Margins | SpeedMargins]
G = TypeVar("G", TorqueGains, SpeedGains)


@dataclass(frozen=True)
class Judged:
    """What a motion tells of an axis and its loop.

    Attributes:
        said: the measurement in words. loops: name, gains and margins, those of the machine file first.
        measured_margins: of these loops, on the measured response; None: they are not known.
        opened: frequencies [Hz] and the loop of the machine file there, opened, shape (n,); None: as before.
        changes: lines for the machine file; none: it fits. remedy: what to do with them.
    """

    measured: MeasuredLoad | MeasuredSpeed
    said: str
    loops: Sequence[Loop]
    measured_margins: Sequence[MeasuredMargins | None]
    opened: tuple[Array, Complex] | None
    changes: Sequence[str]
    remedy: str


@dataclass(frozen=True)
class _OnResponse(Generic[G]):
    """Loops on what was measured.

    Attributes:
        response: None: it is not known. controller: of a loop by gains, frequencies and cycle. delay: as
            `measured_margins`.
    """

    response: Response | None
    controller: Callable[[G, Array, float], Complex]
    cycle_s: float
    delay: int

    def margins(self, gains: G) -> MeasuredMargins | None:
        """Return the margins with these gains; None: they are not known."""
        if self.response is None:
            return None
        loop = self.controller(gains, self.response.frequency, self.cycle_s)
        return measured_margins(self.response, loop, self.cycle_s, self.delay)

    def opened(self, gains: G) -> tuple[Array, Complex] | None:
        """Return frequencies [Hz] and the loop there, opened, shape (n,); None: it is not known."""
        if self.response is None:
            return None
        loop = self.controller(gains, self.response.frequency, self.cycle_s)
        return self.response.frequency / self.cycle_s, opened_loop(self.response, loop, self.delay)


def check_tunable(axis: Axis) -> Cia402Drive:
    """Return the drive of an axis whose loop is closed here; UsageFault: MC095 it is not."""
    known = cia402_drive(axis)
    if known.mode not in _JUDGES:
        raise UsageFault(
            "MC095",
            f'the loop of axis {axis.index} is the drive\'s own: mode = "{known.mode}"',
            'tune it by its maker\'s tool; mode = "cst" or "csv" closes it here',
        )
    return known


def judge(axis: Axis, trace: ScopeTrace, cycle_s: float, fieldbus: str) -> Judged:
    """Return what a motion tells of an axis and of its loop in mode cst or csv.

    Args:
        trace: of its mapped objects. fieldbus: kind of its bus, which decides how late a reading is.

    Raises:
        UsageFault: MC095 the loop is the drive's own. RuntimeFault: MC095 the motion tells too little.
    """
    known = check_tunable(axis)
    delay = ETHERCAT_DELAY_CYCLES if fieldbus == "ethercat" else DELAY_CYCLES
    return _JUDGES[known.mode](axis, known, trace, cycle_s, delay)


def _judge_torque(axis: Axis, known: Cia402Drive, trace: ScopeTrace, cycle_s: float, delay: int) -> Judged:
    load = _load(axis, trace, cycle_s)
    now = TorqueGains(known.velocity_gain, known.position_gain, known.integral_time_s or 0.0)
    loops = [
        (name, gains, margins(gains, load.inertia, cycle_s, delay))
        for name, gains in (
            ("machine file", now),
            ("by this inertia", usual_gains(load.inertia, cycle_s, delay)),
        )
    ]
    torque, place = _columns(trace, "6071h:00", "6064h:00")
    turn = axis.travel_per_motor_turn / axis.type.si_per_unit
    response = measure_response(torque, place * (TURN / turn), 2)
    measured = _OnResponse(response, torque_controller, cycle_s, delay)
    found = [measured.margins(gains) for _, gains, _ in loops]
    margin = loops[0][2]
    holds = margin.least <= LEAST_INERTIA and margin.greatest >= GREATEST_GAIN and margin.phase >= LEAST_PHASE
    changes = []
    if not holds or abs(known.inertia / load.inertia - 1.0) > INERTIA_FITS:
        changes.append(f"inertia = {load.inertia:.4g}   # in [axis.drive]: the file has {known.inertia:g}")
    elif _is_little(found[0]):
        # the load rings: all gains in one proportion
        calmer = _calmer(lambda share: measured.margins(_scaled(now, share)))
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
        measured.opened(now),
        changes,
        "the machine file does not fit: give this inertia, and leave velocity_gain, position_gain and "
        "integral_time_s out",
    )


def _judge_speed(axis: Axis, known: Cia402Drive, trace: ScopeTrace, cycle_s: float, delay: int) -> Judged:
    speed, place = _columns(trace, "60FFh:00", "6064h:00")
    measured = measure_speed(speed, place, cycle_s)
    if measured is None or not measured.uncertainty <= MOST_UNCERTAIN_CYCLES * cycle_s:
        what = "its speed changed too little, or its place has little to do with it"
        raise _untold(axis, "how it follows speeds", what)
    if measured.scale <= 0.0:
        raise _untold(axis, "how it follows speeds", "its speed and its position have opposite signs")
    now = SpeedGains(known.position_gain, known.integral_time_s or 0.0)
    best = proposed_gains(measured, now, cycle_s, delay)
    changes = []
    unit = 1.0
    if abs(measured.scale - 1.0) > SCALE_FITS:
        assert known.encoder is not None
        unit = measured.scale
        counts = known.velocity_counts_per_motor_rev or known.encoder[0] / known.encoder[1]
        changes.append(f"velocity_counts_per_motor_rev = {counts / unit:.6g}   # in [axis.drive]: 60FFh")

    def corrected(gains: SpeedGains) -> SpeedGains:
        """Return the gains that act now as these will with the unit of 60FFh that is proposed."""
        return replace(gains, position_gain=gains.position_gain / unit)

    response = _OnResponse(measure_response(speed, place, 1), speed_controller, cycle_s, delay)
    loops, found = [], []
    for name, gains, acting in (("machine file", now, now), ("by this drive", best, corrected(best))):
        loops.append((name, gains, speed_margins(acting, measured, cycle_s, delay)))
        found.append(response.margins(acting))
    margin = loops[0][2]
    if margin.greatest < GREATEST_GAIN or margin.phase < LEAST_PHASE or _is_little(found[0]):
        share = _calmer(
            lambda each: response.margins(corrected(replace(best, position_gain=each * best.position_gain)))
        )
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
        response.opened(now),
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


_JUDGES: Mapping[str, Callable[[Axis, Cia402Drive, ScopeTrace, float, int], Judged]] = MappingProxyType(
    {"cst": _judge_torque, "csv": _judge_speed}
)


def _load(axis: Axis, trace: ScopeTrace, cycle_s: float) -> MeasuredLoad:
    """Return what a trace says of an axis's load; RuntimeFault: MC095 it says too little."""
    turn = axis.travel_per_motor_turn / axis.type.si_per_unit
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
    raise _untold(axis, "what its motor turns", what)


def _columns(trace: ScopeTrace, *objects: str) -> list[Array]:
    return [trace.values[:, trace.objects.index(name)] for name in objects]


def _untold(axis: Axis, wanted: str, what: str) -> RuntimeFault:
    return RuntimeFault(
        "MC095",
        f"the motion of axis {axis.index} does not tell {wanted}: {what}",
        "run a program that moves it to and fro by many lengths, quickly and slowly, for all of the time",
        axis=axis.index,
    )
