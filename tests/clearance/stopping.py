"""Runs that are stopped in some cycle, against obstacles that just stay clear of all that is judged."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mcserver.clearance.scene import Scene
from mcserver.drives.simulated import SimulatedBus
from mcserver.machine.machine_file import Machine
from mcserver.machine.machine_kinematics import build_kinematics
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.start_state import StartState
from mcserver.simulation.simulation import Simulation, simulate_lines
from mcserver.simulation.virtual_executor import VirtualExecutor
from mcserver.units import MM
from tests.clearance.machines import block, middle_of, mill

ORDERS = ("hold", "abort", "estop")
# How a drive is lost: it fails, or answers no more.
LOSSES = ("trip", "silence")
# An obstacle is moved up to what is judged until it may come no nearer by this, and from so far away [mm].
NO_NEARER = 0.05
FAR_AWAY = 250.0
# So many cycles before the nearest place a stop may begin that ends there.
BEFORE = 120
# What has not moved for so many cycles is at rest; and how many times as long that may take.
AT_REST = 50
MOST_WAITS = 60


def judged(lines: Sequence[str], machine: Machine) -> Simulation:
    return simulate_lines(lambda: iter(lines), machine, stops=True, kinematics=build_kinematics(machine))


class Running:
    """A program that runs, cycle by cycle, and is stopped in one.

    Attributes:
        rows: where axes are in every cycle so far, each of shape (K,) [m, rad].
    """

    def __init__(self, lines: Sequence[str], machine: Machine) -> None:
        self._executor = executor = VirtualExecutor(machine)
        executor.open_slot(0, (1 << len(machine.axes)) - 1)
        self.rows: list[NDArray[np.float64]] = []
        executor.recorder = lambda _t, _line, _setpoint, actual: self.rows.append(actual.copy())
        kinematics = build_kinematics(machine)
        start = StartState.of(machine)
        self._pipeline = Pipeline(machine, executor.sink(0), start=start, kinematics=kinematics)
        self._pipeline.lines.put(1, list(lines))
        self._pipeline.lines.closed = True

    def cycle(self) -> None:
        while self._pipeline.pump():
            pass
        self._executor.step(1)
        for event in self._executor.events():
            self._pipeline.on_event(event)

    @property
    def over(self) -> bool:
        """Whether the program has ended and nothing moves any more."""
        return self._executor.at_rest and bool(self.rows)

    def stop(self, order: str, column: int = 0) -> None:
        """Give an order, or lose the drive of a column, and wait until nothing moves."""
        mailbox = self._executor.mailbox
        if order == "hold":
            mailbox.set_hold(True, 0)
        elif order == "abort":
            mailbox.abort(0)
        elif order in LOSSES:
            [bus] = self._executor.buses
            assert isinstance(bus, SimulatedBus)
            bus.trip(column) if order == "trip" else bus.silence(column)
        else:
            mailbox.emergency_stop()
        for _ in range(MOST_WAITS):
            self._executor.step(AT_REST)
            if not np.ptp(self.rows[-AT_REST:], axis=0).any():
                return
        raise AssertionError("it does not come to rest")


def stopped(
    lines: Sequence[str], machine: Machine, cycle: int, order: str, column: int = 0
) -> NDArray[np.float64]:
    """Where axes are in every cycle (n, K) [m, rad] of a run that is stopped in one, or loses a drive."""
    run = Running(lines, machine)
    while len(run.rows) < cycle:
        run.cycle()
    run.stop(order, column)
    return np.array(run.rows)


def least_of(scene: Scene, rows: Sequence[NDArray[np.float64]]) -> float:
    """The least distance of any pair in any cycle [mm]."""
    least = np.inf
    for number, row in enumerate(rows):
        if not number or (row != rows[number - 1]).any():
            scene.place(row)
            least = min(least, *(scene.distance(pair) for pair in range(len(scene.pairs))))
    return float(least) / MM


def random_program(seed: int, scale: float = 1.0) -> list[str]:
    """A program of the mill, about where its tip begins; ``scale``: of its way."""
    draw = random.Random(seed)
    lines = ["G1010"]
    for _ in range(draw.randint(2, 5)):
        letters = draw.sample("XYZ", draw.randint(1, 3))
        start, low = {"X": 0.0, "Y": 0.0, "Z": 100.0}, {"X": 0.0, "Y": -80.0, "Z": 20.0}
        words = []
        for each in letters:
            place = start[each] + scale * (draw.uniform(low[each], 200.0) - start[each])
            words.append(f"{each}{place:.2f}")
        lines.append(f"{draw.choice(('G0', 'G0', 'G1020', 'G1 F12000', 'G1 F3000'))} {' '.join(words)}")
    return lines


def clear_by_a_hair(seed: int, lines: Sequence[str], made: Callable[..., Machine] = mill) -> Machine:
    """A mill with an obstacle that is moved up to a program until it would be refused."""
    draw = random.Random(seed)
    free = made(block("post", (0.0, 0.0, 9000.0), 1.0))
    found = simulate_lines(lambda: iter(lines), free, record=True)
    assert found.recording is not None
    rows = found.recording.setpoint
    moving = np.flatnonzero(np.append(np.diff(rows, axis=0).any(axis=1), False))
    # the middle of the tool there
    place = rows[draw.choice(moving.tolist())] + np.array([0.0, 0.0, 30.0])
    away = np.array([draw.gauss(0.0, 1.0) for _ in range(3)])
    away /= np.linalg.norm(away)
    edge = draw.uniform(5.0, 40.0)

    def at(distance: float) -> Machine:
        return made(block("post", tuple((place + distance * away).tolist()), edge))

    near, far = 0.0, FAR_AWAY
    while far - near > NO_NEARER:
        middle = 0.5 * (near + far)
        clear = judged(lines, at(middle)).report["ok"]
        near, far = (near, middle) if clear else (middle, far)
    return at(far)


def brute_force(seed: int, stops: int, made: Callable[..., Machine] = mill) -> float:
    """The least distance of a random program from an obstacle that is just clear of it, where it is stopped
    in some cycles [mm].
    """
    lines = random_program(seed)
    machine = clear_by_a_hair(seed, lines, made)
    draw, found = random.Random(seed), judged(lines, machine)
    if not found.report["ok"]:
        return np.inf
    cycles = round(found.report["duration_s"] * machine.cycle_hz)
    nearest = [round(each["time_s"] * machine.cycle_hz) for each in found.report["clearance"]["pairs"]]
    least = np.inf
    for number in range(stops):
        last = nearest[0] if nearest and number % 2 == 0 else cycles
        first = max(5, last - BEFORE) if last != cycles else 5
        cycle = draw.randint(first, max(first + 1, last))
        least = min(least, least_of(Scene(machine), [*stopped(lines, machine, cycle, draw.choice(ORDERS))]))
    return least


class Planted(NamedTuple):
    """An obstacle that is touched where a drive is lost, and by nothing else that a program does.

    Attributes:
        told: the axis is named. least: the nearest that it comes [mm].
    """

    told: bool
    least: float


def planted_loss(
    seed: int, lines: Sequence[str], made: Callable[..., Machine], body: str, cycles: int
) -> Planted | None:
    """Plant an obstacle that a body just touches as one drive is lost in some cycle; None: the program does
    as well, or the body comes no further.

    Args:
        made: a machine with sections more. cycles: in which a drive may be lost.
    """
    draw = random.Random(seed)
    free = made(block("post", (0.0, 0.0, 9000.0), 1.0))
    scene = Scene(free)
    column = draw.randrange(len(free.axes))
    at = draw.randint(5, cycles)
    rows = stopped(lines, free, at, draw.choice(LOSSES), column)
    # at the end of its run the bound is tight
    place = middle_of(scene, body, rows[-1])
    before = middle_of(scene, body, rows[at - 1])
    away = place - before
    if np.linalg.norm(away) < MM:
        return None
    away /= np.linalg.norm(away)
    pairs = [number for number, each in enumerate(scene.pairs) if set(each.names) == {body, "post"}]

    def at_distance(distance: float) -> Machine:
        return made(block("post", tuple(((place + distance * away) / MM).tolist()), 6.0))

    # moved out until it is touched by half of the margin
    low, high = 0.0, 1.0
    while high - low > 0.2 * MM:
        middle = 0.5 * (low + high)
        tried = Scene(at_distance(middle))
        tried.place(rows[-1])
        near = min(tried.distance(pair) for pair in pairs) < 0.5 * MM
        low, high = (middle, high) if near else (low, middle)
    machine = at_distance(low)
    found = judged(lines, machine)
    if not found.report["ok"]:
        return None
    named = {
        each["axis"]
        for each in found.report["clearance"]["lost_drives"]["pairs"]
        if each["least_mm"] < 1.0 and set(each["bodies"]) == {body, "post"}
    }
    return Planted(free.axes[column].index in named, low / MM)
