"""What a motor turns by the motion of a program, and the margins of its torque loop."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mcserver.canopen.torque_tuning import margins, measure_load, usual_gains
from mcserver.drives.bus import Array, DriveMode, DriveState
from mcserver.drives.cia402.loop_gains import DELAY_CYCLES
from tests.canopen.rig import Desk
from tests.drives.can_rig import COUNTS, Bench
from tests.drives.torque_drive import INERTIA, RATED, TorqueDrive, torque_bench

CYCLE_S = 1e-3
GAINS = usual_gains(INERTIA, CYCLE_S, DELAY_CYCLES)


def held(inertia: float, *, friction: float = 0.0, load: float = 0.0) -> tuple[Bench, TorqueDrive]:
    """An axis that its loop holds, on another inertia than its machine file has."""
    bench = torque_bench(axis="max_following_error = 50.0")
    (drive,) = bench.drives
    assert isinstance(drive, TorqueDrive)
    drive.inertia, drive.friction, drive.load = inertia * INERTIA, friction, load * RATED
    bench.tell(DriveMode.POSITION)
    bench.exchange(30)
    drive.permille.clear()
    return bench, drive


def moved(bench: Bench, drive: TorqueDrive, cycles: int) -> tuple[Array, Array]:
    """Torques [N·m] and angles of the shaft [rad] of a motion to and fro."""
    start, places = bench.setpoints.position.copy(), []
    for cycle in range(cycles):
        at = cycle * CYCLE_S
        way = 0.01 * math.sin(4.0 * math.pi * at) + 0.02 * math.sin(0.8 * math.pi * at)
        bench.setpoints.position[:] = start + min(1.0, at) * way
        places.append(drive.position)
        bench.exchange(follow=False)
    assert bench.feedback.state.tolist() == [DriveState.ENERGIZED]
    return np.array(drive.permille[:cycles]) * RATED / 1000.0, np.array(places) / COUNTS * 2.0 * math.pi


@pytest.mark.parametrize(("inertia", "friction", "load"), [(1.0, 0.0, 0.0), (2.5, 1e-3, 0.1)])
def test_inertia_friction_and_load_come_out_of_a_motion(inertia: float, friction: float, load: float) -> None:
    found = measure_load(*moved(*held(inertia, friction=friction, load=load), 1500), CYCLE_S)
    assert found is not None
    assert found.inertia == pytest.approx(inertia * INERTIA, rel=0.01)
    assert found.viscous == pytest.approx(friction, abs=1e-4)
    assert found.load == pytest.approx(-load * RATED, abs=5e-3)
    assert found.explained > 0.99


def ordered(torque: Array, friction: float, steps: int = 20) -> Array:
    """Angles at each cycle of a shaft of 1e-4 kg·m² with dry friction, shape (n,) [rad]."""
    angle = rate = 0.0
    found = []
    for each in torque.tolist():
        found.append(angle)
        for _ in range(steps):
            rate += (each - math.copysign(friction, rate)) / 1e-4 * CYCLE_S / steps
            angle += rate * CYCLE_S / steps
    return np.array(found)


def test_dry_friction_is_told_from_inertia() -> None:
    at = np.arange(4000) * CYCLE_S
    torque = 0.05 * np.sign(np.sin(6.0 * at)) * (1.0 + 0.6 * np.sin(29.0 * at))
    found = measure_load(torque, np.round(ordered(torque, 0.008), 4), CYCLE_S)
    assert found is not None
    assert found.inertia == pytest.approx(1e-4, rel=0.02)
    assert found.friction == pytest.approx(0.008, rel=0.05)


@pytest.mark.parametrize("rate", [20.0, 60.0])
def test_an_axis_that_only_shakes_is_measured_through_its_turns(rate: float) -> None:
    """A chirp with little room turns more often than once in each window."""
    at = np.arange(4000) * CYCLE_S
    torque = 0.05 * np.sign(np.sin(rate * (1.0 + at) * at))
    found = measure_load(torque, np.round(ordered(torque, 0.008), 5), CYCLE_S)
    assert found is not None
    assert found.inertia == pytest.approx(1e-4, rel=0.02)
    assert found.explained > 0.9


def test_what_does_not_move_or_moves_evenly_tells_nothing() -> None:
    rng = np.random.default_rng(5)
    torque = rng.normal(0.0, 0.01, 2000)
    assert measure_load(torque, np.full(2000, 3.0), CYCLE_S) is None
    assert measure_load(torque, np.arange(2000) * 0.01, CYCLE_S) is None
    assert measure_load(torque, np.full(2000, np.nan), CYCLE_S) is None
    # a motion that its torque has nothing to do with
    wandering = np.cumsum(np.sin(np.arange(2000) / 90.0) + 0.3 * np.sin(np.arange(2000) / 31.0)) * 0.01
    found = measure_load(torque, wandering, CYCLE_S)
    assert found is None or found.explained < 0.5


@pytest.mark.parametrize(("beside", "stable"), [(1.15, True), (0.85, False)])
def test_the_loop_is_stable_down_to_the_inertia_that_its_margin_says(beside: float, stable: bool) -> None:
    margin = margins(GAINS, INERTIA, CYCLE_S, DELAY_CYCLES)
    assert margin.least < 0.5
    assert margin.greatest > 4.0
    assert margin.phase > math.radians(45.0)
    bench, drive = held(beside * margin.least)
    start = drive.exact
    # a knock
    drive.rate += 5.0
    swing = []
    for _ in range(600):
        bench.exchange(follow=False)
        swing.append(abs(drive.exact - start))
    assert (max(swing[400:]) < 0.2 * max(swing[:100])) is stable


def test_a_loop_that_is_not_stable_has_no_margins() -> None:
    margin = margins(GAINS, 0.1 * INERTIA, CYCLE_S, DELAY_CYCLES)
    assert (margin.least, margin.greatest, margin.phase) == (0.0, 0.0, 0.0)


def test_an_axis_whose_drive_closes_the_loop_is_not_tuned_here(desk: Desk) -> None:
    assert desk.refusal("tune", "0") == (2, "MC095")
    assert desk.refusal("tune", "0", "--seconds", "nan") == (2, "MC017")
