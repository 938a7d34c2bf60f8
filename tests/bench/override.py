"""A program at an override above 100 % against the same text with an F that is as much higher."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from mckinematics.pose import Kinematics

from mcserver.executor.entries import EventKind
from mcserver.machine.machine_file import Machine
from mcserver.planning.pipeline import Pipeline
from mcserver.planning.start_state import StartState
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.bench.figures import Figure
from tests.bench.machines import ideal

# Cycles after which a run that has not ended is a fault.
LONGEST_RUN = 200_000
# Cycles between two looks of the planner at the executor.
PLANNER_PERIOD = 4

Program = Callable[[float], list[str]]
Order = tuple[int, float]


@dataclass(frozen=True)
class Run:
    """A program as it was played.

    Attributes:
        setpoint: of every cycle, shape (n, K) [m]. moved_s: from the first cycle that moves to the last [s].
        lines: reported as ended, in order. faults: how many there were. begins, ends: cycles in which each
            line was reported to begin and to end.
        scale: the override that the rows under way are planned for, at every cycle, shape (n,).
        begun: the first cycle that moves.
    """

    setpoint: np.ndarray[tuple[int, int], np.dtype[np.float64]]
    moved_s: float
    lines: list[int]
    faults: int
    scale: np.ndarray[tuple[int], np.dtype[np.float64]]
    begun: int
    begins: dict[int, int] = field(default_factory=dict)
    ends: dict[int, int] = field(default_factory=dict)

    def planned_after(self, order: Order) -> int | None:
        """Return the cycles from an order until rows that are planned for it are played; None: never."""
        cycle = self.begun + order[0]
        (found,) = np.nonzero(self.scale[cycle:] == max(1.0, order[1]))
        return int(found[0]) if len(found) else None


def long_lines(k: float) -> list[str]:
    """Four lines about a rectangle, bound by F."""
    points = [(300, 0), (300, 200), (0, 200), (0, 0)]
    return ["G94", *(f"G01 X{x} Y{y} F{3600 * k:g}" for x, y in points)]


def zigzag(k: float) -> list[str]:
    """Lines of 5 mm with corners of 90°."""
    lines = ["G94"]
    for index in range(120):
        lines.append(f"G01 X{5 * ((index + 2) // 2)} Y{5 * ((index + 1) // 2)} F{2400 * k:g}")
    return lines


def arcs(k: float) -> list[str]:
    """Full circles, one after the other."""
    return ["G94", *(f"G02 X0 Y0 I{15 + index % 3 * 5} J0 F{3000 * k:g}" for index in range(6))]


def chords(k: float) -> list[str]:
    """Chords of 0.4 mm of a Lissajous figure."""
    t = np.linspace(0.0, 2.0 * math.pi, 1200)
    x, y = 40.0 * np.sin(2.0 * t), 40.0 * np.sin(3.0 * t)
    return ["G94", *(f"G01 X{a:.3f} Y{b:.3f} F{2400 * k:g}" for a, b in zip(x, y, strict=True))]


def timed(k: float) -> list[str]:
    """Lines of half a second each (G93)."""
    points = [(10 * index, 8 * (index % 2)) for index in range(1, 21)]
    return ["G93", *(f"G01 X{x} Y{y} F{120 * k:g}" for x, y in points)]


def quick_zigzag(k: float) -> list[str]:
    """Lines of 5 mm with corners of 90°, at an F that few of them come to."""
    return [line.replace(f"F{2400 * k:g}", f"F{9000 * k:g}") for line in zigzag(k)[:60]]


def small_circles(k: float) -> list[str]:
    """Circles of 3 to 5 mm at a speed that their accelerations bound."""
    return ["G94", *(f"G02 X0 Y0 I{3 + index % 3} J0 F{9000 * k:g}" for index in range(16))]


def quick_chords(k: float) -> list[str]:
    """Chords whose limits bind in every bend."""
    return [line.replace(f"F{2400 * k:g}", f"F{12000 * k:g}") for line in chords(k)]


def exact_stops(k: float) -> list[str]:
    """Lines of 10 mm that end at rest (G61)."""
    return ["G94", "G61", *(line for line in zigzag(2.0 * k)[1:40:2])]


PROGRAMS: dict[str, Program] = {
    "long lines": long_lines,
    "lines of 5 mm with corners": zigzag,
    "circles": arcs,
    "chords": chords,
    "G93 lines": timed,
}
# Programs whose speed limits bind rather than F.
BOUND_PROGRAMS: dict[str, Program] = {
    "lines of 5 mm bound by corners": quick_zigzag,
    "circles bound by acceleration": small_circles,
    "chords bound in bends": quick_chords,
    "lines with exact stops": exact_stops,
}
# Moments of orders, in shares of a program's time.
ORDERED_AT = (0.17, 0.31, 0.46, 0.58, 0.71)


def play(
    machine: Machine,
    lines: Sequence[str],
    orders: Sequence[Order],
    *,
    every: int = 0,
    kinematics: Kinematics | None = None,
) -> Run:
    """Play a program while the planner works beside it.

    Args:
        orders: overrides, each with the cycle of the motion that it comes in, in order.
        every: cycles between two lines of a program that is streamed; 0: all of it is there at once.
    """
    rows: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
    executor = VirtualExecutor(
        machine, recorder=lambda _t, _line, setpoint, _actual: rows.append(setpoint.copy())
    )
    pipeline = Pipeline(machine, executor.open_slot(0), start=StartState.of(machine), kinematics=kinematics)
    texts = ["G1010", *lines]
    sent = 0
    waiting = list(orders)
    ended: list[int] = []
    begins: dict[int, int] = {}
    ends: dict[int, int] = {}
    scales: list[float] = []
    faults, begun = 0, -1
    for cycle in range(LONGEST_RUN):
        if begun < 0 and len(rows) > 1 and (rows[-1] != rows[0]).any():
            begun = cycle
        while waiting and (waiting[0][0] <= 0 or (begun >= 0 and cycle - begun >= waiting[0][0])):
            executor.mailbox.set_override(waiting.pop(0)[1], 0)
        due = len(texts) if every == 0 else min(cycle // every + 1, len(texts))
        if due > sent:
            pipeline.lines.put(sent + 1, texts[sent:due])
            sent = due
            pipeline.lines.closed = sent == len(texts)
        if cycle % PLANNER_PERIOD == 0:
            override = executor.mailbox.effective_override(0)
            while pipeline.pump(executor.u(0), override):
                pass
        executor.step()
        playing = executor.executor._slots[0]
        scales.append(playing.playback.feed_scale(playing.u))
        events = executor.events()
        for event in events:
            pipeline.on_event(event)
            faults += event.kind is EventKind.FAULT
            if event.kind is EventKind.LINE_START:
                begins[event.line] = cycle
            if event.kind is EventKind.LINE_END:
                ended.append(event.line)
                ends[event.line] = cycle
        if any(event.kind in (EventKind.FINISHED, EventKind.STOPPED) for event in events):
            break
    executor.step(3)
    points = np.array(rows)
    (moving,) = np.nonzero((np.diff(points, axis=0) != 0.0).any(axis=1))
    span = 0.0 if not len(moving) else float(moving[-1] - moving[0] + 1) * machine.cycle_s
    return Run(points, span, ended, faults, np.array(scales), max(begun, 0), begins, ends)


def measure() -> list[Figure]:
    """150 and 200 % from the start, and from the middle of the time of 100 %; and how soon it is planned."""
    machine = ideal(axes=2, velocity=500.0, acceleration=3000.0, jerk=60_000.0, tolerance_mm=0.02)
    figures = []
    for name, program in PROGRAMS.items():
        whole = play(machine, program(1.0), []).moved_s
        for k in (1.5, 2.0):
            floor = play(machine, program(k), []).moved_s
            for place, order, ideal_s in (
                ("from the start", 0, floor),
                ("from the middle", round(0.5 * whole / machine.cycle_s), 0.5 * (whole + floor)),
            ):
                run = play(machine, program(1.0), [(order, k)])
                figures.append(
                    Figure(
                        f"{name}, {100 * k:.0f} % {place}",
                        run.moved_s,
                        "s",
                        ideal_s,
                        f"F x {k:g}",
                        "+ ≤ 0.5 s",
                    )
                )
    return figures + [
        _planned_after(machine, name, program, k)
        for name, program in (PROGRAMS | BOUND_PROGRAMS).items()
        for k in (1.5, 2.0)
    ]


def _planned_after(machine: Machine, name: str, program: Program, k: float) -> Figure:
    """Time from an order on the way to motion that is planned for it: the median of several moments."""
    cycles = play(machine, program(1.0), []).moved_s / machine.cycle_s
    orders = [(round(share * cycles), k) for share in ORDERED_AT]
    found = [play(machine, program(1.0), [order]).planned_after(order) for order in orders]
    after = [1e3 * machine.cycle_s * each for each in found if each is not None]
    worst = f"worst {max(after):.0f} ms" if after else "never"
    what = f"{name}, {100 * k:.0f} %: new plan after ({worst})"
    return Figure(what, statistics.median(after) if after else math.nan, "ms", None, "", "≤ 500")
