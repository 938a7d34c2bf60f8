"""What clearance costs a cycle, and planted obstacles: found, or moved clear and not reported.

``python -m tests.bench.clearance --count 1000`` plants obstacles in the way of random motions of an arm, a
dog, a mill and two arms, and moves each clear by a millimetre. With ``--stops`` it stops random programs of a
mill in every cycle, beside obstacles that are just clear of what ``simulate --stops`` judges.
"""

from __future__ import annotations

import argparse
import math
import os
import struct
import tempfile
import time
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.meter import ClearanceMeter
from mcserver.clearance.scene import Scene
from mcserver.clearance.sweep import FINEST, Sweep
from mcserver.machine.machine_file import Machine, builtin_text, parse_machine
from mcserver.units import MM
from tests.bench.figures import Figure
from tests.clearance.machines import VISE, block, middle_of, mill, two_arms
from tests.clearance.stopping import ORDERS, Running, clear_by_a_hair, least_of, random_program

Array = NDArray[np.float64]

CYCLES = 5000
# Rows that the planner hands over together while a program runs.
HANDED_OVER = 20
# So near comes what does not touch [m].
NEARLY = 5e-3
# how far a moved obstacle stays clear [m]
CLEAR = 1e-3
# steps from cycle to cycle at which brute force looks
BETWEEN = 8
# more than anything moves in a cycle: 20 m/s [m]
MOST_A_CYCLE = 20e-3
# of a margin of 1 mm as it is held [mm]
JUST_CLEAR = 0.98
# of programs that are stopped in every cycle: share of the usual way, and lines
SHORT, SHORT_LINES = 0.05, 3
MARGIN_ZERO = "[clearance]\nmargin_mm = 0.0\n"


def measure() -> list[Figure]:
    """Microseconds a cycle beside the machine's time."""
    with tempfile.TemporaryDirectory() as folder:
        machines = {
            "arm6": _robot("arm6"),
            "robot-dog": _robot("robot-dog"),
            "two arms": two_arms(Path(folder), "[clearance]\n"),
            "mill": mill(VISE),
        }
        return [figure for name, machine in machines.items() for figure in _figures(name, machine)]


def _figures(name: str, machine: Machine) -> list[Figure]:
    found = []
    rows = random_motion(machine, 1, CYCLES // 250)
    meter = ClearanceMeter(machine, rows[0])
    times, lines = np.arange(len(rows)) * machine.cycle_s, np.ones(len(rows), np.int64)
    begin = time.process_time()
    meter.take(times, lines, rows)
    meter.contacts()
    simulated = (time.process_time() - begin) / len(rows)
    # as they are handed over, with nothing that would end them
    assert machine.clearance is not None
    sweep = Sweep(Scene(machine), machine.clearance.margin)
    moved, still = np.ones(len(machine.axes), np.bool_), np.zeros(len(machine.axes))
    # what touches in random motion comes nearly so near
    margin = np.full(len(sweep.scene.pairs), machine.clearance.margin)
    floors = np.minimum(margin, _least_distances(sweep.scene, rows[::5]) - NEARLY)
    begin = time.process_time()
    for at in range(0, len(rows) - HANDED_OVER, HANDED_OVER):
        sweep.first_contact(rows[at : at + HANDED_OVER + 1], still, moved, floors)
    judged = (time.process_time() - begin) / len(rows)
    for what, spent in (("simulated", simulated), ("judged as it is handed over", judged)):
        found.append(
            Figure(
                f"{name}, {len(sweep.scene.pairs)} pairs, {what}: the machine's time",
                machine.cycle_s / spent,
                "× of the processor's",
                goal="≥ 30 ×",
            )
        )
    return found


def random_motion(machine: Machine, seed: int, strokes: int = 3) -> Array:
    """Return a smooth random way of all axes within their travel, one row a cycle, shape (n, K) [SI]."""
    draw = np.random.default_rng(seed)
    low = np.array([max(axis.min_position, -0.4) for axis in machine.axes])
    high = np.array([min(axis.max_position, 0.4) for axis in machine.axes])
    knots = np.vstack(
        [[axis.initial_position for axis in machine.axes], draw.uniform(low, high, (strokes, len(low)))]
    )
    t = np.linspace(0.0, 1.0, 250)[:, None]
    ease = t * t * (3.0 - 2.0 * t)
    ways = [one + ease * (other - one) for one, other in pairwise(knots)]
    return np.concatenate(ways)


def planted(seed: int, folder: Path) -> tuple[bool, bool]:
    """Plant an obstacle in a random motion; return whether it was found, simulated and as it is handed over,
    and whether it was reported by one of both when it had been moved clear.

    Args:
        folder: for the model of two arms.
    """
    made: Callable[..., Machine] = (
        lambda *more: _robot("arm6", *more),
        lambda *more: _robot("robot-dog", *more),
        mill,
        lambda *more: two_arms(folder, *more),
    )[seed % 4]
    draw = np.random.default_rng(10_000 + seed)
    far = made(MARGIN_ZERO, block("post", (0.0, 0.0, 9000.0), 1.0))
    rows = random_motion(far, seed)
    scene = Scene(far)
    moving = [
        next(name for name in each.names if name != "post") for each in scene.pairs if "post" in each.names
    ]
    at = middle_of(scene, str(draw.choice(moving)), rows[int(draw.integers(len(rows)))]) / MM
    edge = float(draw.uniform(2.0, 60.0))
    hit = _touched(made(MARGIN_ZERO, block("post", tuple(at), edge)), rows)
    # straight up until it is clear in every cycle
    height = 0.0
    while True:
        clear = made(MARGIN_ZERO, block("post", (at[0], at[1], at[2] + height), edge))
        least = _least(clear, rows)
        if least >= CLEAR:
            break
        height += max(1.0, (CLEAR - least) / MM)
    return all(hit), any(_touched(clear, rows))


def _robot(name: str, *more: str) -> Machine:
    return parse_machine("\n".join((builtin_text(name), *(more or ("[clearance]\n",)))))


def _touched(machine: Machine, rows: Array) -> tuple[bool, bool]:
    """Return whether the post is found in the simulation, and as rows are handed over."""
    meter = ClearanceMeter(machine, rows[0])
    meter.take(np.arange(len(rows)) * machine.cycle_s, np.ones(len(rows), np.int64), rows)
    simulated = any("'post'" in each.message for each in meter.contacts())
    scene = Scene(machine)
    sweep = Sweep(scene, 0.0)
    # what else touches in random motion is not asked for
    post = np.array(["post" in each.names for each in scene.pairs])
    floors = np.where(post, -FINEST, -np.inf)
    moved, still = np.ones(len(machine.axes), np.bool_), np.zeros(len(machine.axes))
    blocks = range(0, len(rows) - 1, HANDED_OVER)
    judged = any(sweep.first_contact(rows[at : at + HANDED_OVER + 1], still, moved, floors) for at in blocks)
    return simulated, judged


def _least_distances(scene: Scene, rows: Array) -> Array:
    """Return the least distance of each pair in some cycles, shape (P,) [m]."""
    found = []
    for row in rows:
        scene.place(row)
        found.append([scene.distance(pair) for pair in range(len(scene.pairs))])
    return np.min(found, axis=0)


def _least(machine: Machine, rows: Array) -> float:
    """Return the least distance of the post in any cycle, and at steps between two [m]."""
    scene = Scene(machine)
    pairs = [number for number, each in enumerate(scene.pairs) if "post" in each.names]
    found = []
    for row in rows:
        scene.place(row)
        found.append([scene.distance(pair) for pair in pairs])
    each = np.array(found)
    least = float(each.min())
    # what moves by so much in a cycle is faster than any machine here
    near = np.minimum(each[:-1], each[1:]) < least + MOST_A_CYCLE
    for at in np.flatnonzero(near.any(axis=1)).tolist():
        for step in range(1, BETWEEN):
            scene.place(rows[at] + step / BETWEEN * (rows[at + 1] - rows[at]))
            least = min(least, *(scene.distance(pairs[one]) for one in np.flatnonzero(near[at])))
    return least


def _stop_anywhere(seeds: Sequence[int]) -> int:
    """Stop programs in every cycle, beside obstacles that they just stay clear of: how near do they come."""
    found = []
    for seed in seeds:
        lines = random_program(seed, SHORT)[:SHORT_LINES]
        found.append(_every_stop(lines, clear_by_a_hair(seed, lines)))
        stops, nearest = sum(count for count, _ in found), min(least for _, least in found)
        print(f"{len(found)} programs, {stops} stops: nearest {nearest:.3f} mm, 1 mm is wanted", flush=True)
    touched = [seed for seed, (_, least) in zip(seeds, found, strict=True) if least < JUST_CLEAR]
    print(f"{len(touched)} came too near {touched[:9]}")
    return 1 if touched else 0


def _every_stop(lines: Sequence[str], machine: Machine) -> tuple[int, float]:
    """Return how often a program was stopped, in every cycle by the orders in turn, and how near bodies came
    [mm].
    """
    run, scene = Running(lines, machine), Scene(machine)
    stops, least = 0, math.inf
    while not run.over:
        run.cycle()
        # in a copy of this process
        reading, writing = os.pipe()
        child = os.fork()
        if not child:
            run.stop(ORDERS[stops % len(ORDERS)])
            os.write(writing, struct.pack("d", least_of(scene, run.rows[stops:])))
            os._exit(0)
        os.close(writing)
        least = min(least, *struct.unpack("d", os.read(reading, 8)))
        os.close(reading)
        os.waitpid(child, 0)
        stops += 1
    return stops, least


def main(arguments: Sequence[str] | None = None) -> int:
    """Plant obstacles and count."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--stops", action="store_true", help="stop programs in every cycle instead")
    asked = parser.parse_args(arguments)
    seeds = range(asked.first, asked.first + asked.count)
    if asked.stops:
        return _stop_anywhere(seeds)
    missed, alarms = [], []
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            hit, alarm = planted(seed, Path(folder))
            missed += [] if hit else [seed]
            alarms += [seed] if alarm else []
    print(f"{asked.count} planted: {len(missed)} missed {missed[:9]}")
    print(f"{asked.count} moved clear: {len(alarms)} reported {alarms[:9]}")
    return 1 if missed or alarms else 0


if __name__ == "__main__":
    raise SystemExit(main())
