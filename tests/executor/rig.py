"""A machine, a virtual executor and a writer of small programs for the tests of the executor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mcserver.executor.entries import Control, ControlKind, EventKind, ExecutorEvent
from mcserver.executor.shm.rings import ProgramRing
from mcserver.machine.machine_file import Machine, parse_machine
from mcserver.motion.canonical import AxisOperation
from mcserver.motion.pieces import Rows
from mcserver.simulation.virtual_executor import VirtualExecutor
from tests.machine_text import axes_text

Array = NDArray[np.float64]

CYCLE_S = 1e-3
_OPERATIONS = list(AxisOperation)


def machine(
    axes: int = 2,
    *,
    drive: str = "ideal",
    velocity: float = 1000.0,
    acceleration: float = 10000.0,
    jerk: float | None = None,
    travel: float | None = 1000.0,
    axis: str = "",
    drive_keys: str = "",
    motion: str = "",
) -> Machine:
    """Linear axes, in mm; ``axis``, ``drive_keys`` and ``motion`` are further TOML lines."""
    keys = "" if jerk is None else f"max_jerk = {jerk}\n"
    keys += "" if travel is None else f"min_position = {-travel}\nmax_position = {travel}\n"
    all_alike = axes_text(
        range(axes),
        velocity=velocity,
        acceleration=acceleration,
        keys=keys + axis,
        drive=drive,
        drive_keys=drive_keys,
    )
    return parse_machine(f'[machine]\nname = "rig"\n[motion]\n{motion}\n{all_alike}')


class Watched:
    """An executor on a virtual clock, and what it reports."""

    executor: VirtualExecutor
    events: list[ExecutorEvent]

    def step(self, cycles: int = 1) -> None:
        self.executor.step(cycles)
        self.events += self.executor.events()

    def run(self, limit: int = 60000) -> int:
        """Until nothing is commanded to move; returns the number of cycles."""
        for cycle in range(limit):
            self.step()
            if self.executor.at_rest:
                return cycle + 1
        raise AssertionError(f"not at rest after {limit} cycles")

    def of(self, kind: EventKind) -> list[ExecutorEvent]:
        return [event for event in self.events if event.kind is kind]

    @property
    def faults(self) -> list[int]:
        return [event.code for event in self.of(EventKind.FAULT)]


@dataclass
class Rig(Watched):
    """An executor with one program in slot 0, and what it did."""

    machine: Machine
    executor: VirtualExecutor = field(init=False)
    program: Program = field(init=False)
    events: list[ExecutorEvent] = field(default_factory=list)
    setpoints: list[Array] = field(default_factory=list)
    actuals: list[Array] = field(default_factory=list)
    orders: list[Array] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.executor = VirtualExecutor(self.machine, recorder=self._record)
        self.program = self.open(0)

    def open(self, slot: int, mask: int | None = None) -> Program:
        return Program(self.executor.open_slot(slot, mask), len(self.machine.axes))

    def _record(self, _time: float, line: int, setpoint: Array, actual: Array) -> None:
        self.lines.append(line)
        self.setpoints.append(setpoint.copy())
        self.actuals.append(actual.copy())
        self.orders.append(self.executor.executor.row.ordered.copy())

    def play(self, *, line: bool = False) -> int:
        """End the program, and with ``line`` its line; run as `run` does."""
        if line:
            self.program.end_line()
        self.program.finish()
        return self.run()

    def run_until(self, kind: EventKind, limit: int = 20000) -> ExecutorEvent:
        for _ in range(limit):
            before = len(self.events)
            self.step()
            for event in self.events[before:]:
                if event.kind is kind:
                    return event
        raise AssertionError(f"no {kind!r} in {limit} cycles; {self.events}")

    def set_off(self, cycles: int = 900) -> None:
        """Bring axes 0 and 1 on their way along a straight line, line 3, at 0.4 and 0.2 m/s."""
        program = self.program
        program.capture()
        self.step(40)
        program.position = self.executor.feedback.setpoint.copy()
        program.start_line(3)
        program.move({0: 0.4, 1: 0.2}, 1800)
        program.end_line()
        program.finish()
        self.step(cycles)
        assert not self.of(EventKind.FAULT)

    def fault_within(self, cycles: int) -> ExecutorEvent:
        """The fault that is reported within so many cycles."""
        return self.run_until(EventKind.FAULT, cycles)

    def recover(self) -> None:
        """G1000 and G1010 of all axes in a program of its own."""
        program = self.open(0)
        program.start_line(1)
        program.axis(AxisOperation.RESET)
        program.capture()
        program.end_line()
        program.finish()
        self.run()

    def time_of(self, kind: EventKind, line: int) -> float:
        (event,) = [event for event in self.of(kind) if event.line == line]
        return event.time

    @property
    def setpoint(self) -> Array:
        """Shape (cycles, K)."""
        return np.array(self.setpoints)

    @property
    def ordered(self) -> Array:
        """What the setpoints are made of, shape (cycles, K)."""
        return np.array(self.orders)

    @property
    def actual(self) -> Array:
        return np.array(self.actuals)

    def acceleration(self, column: int = 0) -> Array:
        """Second differences of the setpoints [m/s²]."""
        return np.diff(self.setpoint[:, column], 2) / CYCLE_S**2


class Program:
    """Writes entries and rows, u going on by itself."""

    def __init__(self, ring: ProgramRing, width: int) -> None:
        self.ring = ring
        self.width = width
        self.u = 0.0
        self.line = 0
        self.position = np.zeros(width)

    def control(self, kind: ControlKind, **more: object) -> None:
        self.ring.put_control(Control(kind, self.u, self.line, **more))  # type: ignore[arg-type]

    def start_line(self, line: int) -> None:
        self.line = line
        self.control(ControlKind.LINE_START)

    def end_line(self) -> None:
        self.control(ControlKind.LINE_END)

    def axis(self, operation: AxisOperation, mask: int | None = None) -> None:
        everything = (1 << self.width) - 1
        index = _OPERATIONS.index(operation)
        self.control(ControlKind.AXIS, axes=everything if mask is None else mask, operation=index)

    def capture(self, mask: int | None = None) -> None:
        self.axis(AxisOperation.CAPTURE, mask)

    def rapid(self, targets: dict[int, float]) -> None:
        self.control(ControlKind.RAPID, axes=mask_of(targets), values=self._values(targets))

    def speed(self, speeds: dict[int, float]) -> None:
        self.control(ControlKind.SPEED, axes=mask_of(speeds), values=self._values(speeds))

    def torque(self, torques: dict[int, float]) -> None:
        self.control(ControlKind.TORQUE, axes=mask_of(torques), values=self._values(torques))

    def _values(self, by_column: dict[int, float]) -> tuple[float, ...]:
        return tuple(by_column.get(column, 0.0) for column in range(self.width))

    def wait(self, mask: int, seconds: float = 5.0) -> None:
        self.control(ControlKind.WAIT, axes=mask, seconds=seconds)

    def dwell(self, seconds: float) -> None:
        self.control(ControlKind.DWELL, seconds=seconds)

    def finish(self) -> None:
        self.control(ControlKind.FINISH)

    def rows(
        self,
        position: Array,
        velocity: Array,
        mask: int,
        torque: Array | None = None,
        feed_scale: float = 1.0,
    ) -> None:
        """Rows at the whole u after the present one; u goes to the last of them."""
        count = len(position)
        first = int(np.floor(self.u + 1e-9)) + 1
        masks, lines = np.full(count, mask, np.uint64), np.full(count, self.line, np.int64)
        self.ring.put_rows(Rows(first, position, velocity, masks, lines, torque, np.full(count, feed_scale)))
        self.u = float(first + count - 1)
        self.position = position[-1].copy()

    def first_rows(self, position: Array, velocity: Array, mask: int = 3) -> None:
        """Capture the axes and begin a motion of which these rows are known."""
        self.capture()
        self.control(ControlKind.BEGIN, axes=mask)
        self.rows(position, velocity, mask)

    def last_rows(self, position: Array, velocity: Array, mask: int = 3) -> None:
        """The rest of the motion, and the program's end."""
        if len(position):
            self.rows(position, velocity, mask)
        self.control(ControlKind.END, axes=mask)
        self.finish()

    def move(self, targets: dict[int, float], cycles: int, *, open_end: bool = False) -> None:
        """A straight move from rest to rest by a polynomial without jumps of acceleration; whole u only."""
        mask = mask_of(targets)
        start, end = self.position.copy(), self.position.copy()
        for column, target in targets.items():
            end[column] = target
        self.control(ControlKind.BEGIN, axes=mask)
        share, slope = quintic(np.arange(1, cycles + 1) / cycles)
        position = start + share[:, None] * (end - start)
        velocity = slope[:, None] * (end - start) / (cycles * CYCLE_S)
        self.rows(position, velocity, mask)
        if not open_end:
            self.control(ControlKind.END, axes=mask)


def under_way(rig: Rig, target: float) -> Rig:
    """The rig with a program in the midst of a fast move of axis 0 [m]."""
    rig.program.capture()
    rig.program.start_line(1)
    rig.program.move({0: target}, 2000)
    rig.program.end_line()
    rig.program.finish()
    rig.step(1000)
    return rig


def quintic(share: Array) -> tuple[Array, Array]:
    """From 0 to 1 with no velocity and acceleration at the ends; the value and its slope."""
    return share**3 * (10 - 15 * share + 6 * share**2), 30 * share**2 * (1 - share) ** 2


def s_curve(
    length: float, speed: float, acceleration: float = 10.0, jerk: float | None = None
) -> tuple[Array, Array]:
    """Positions and velocities along a move from rest to rest, at whole cycles."""
    if jerk is None:
        ramps = [(speed / acceleration, acceleration, 0.0)]
    elif speed * jerk < acceleration**2:
        rise = np.sqrt(speed / jerk)
        ramps = [(rise, 0.0, jerk), (rise, rise * jerk, -jerk)]
    else:
        rise = acceleration / jerk
        ramps = [
            (rise, 0.0, jerk),
            (speed / acceleration - rise, acceleration, 0.0),
            (rise, acceleration, -jerk),
        ]
    ramp_length = 0.5 * speed * sum(duration for duration, _, _ in ramps)
    cruise = ((length - 2.0 * ramp_length) / speed, 0.0, 0.0)
    falls = [(duration, -a - duration * j, j) for duration, a, j in reversed(ramps)]
    phases = [*ramps, cruise, *falls]
    time = np.arange(1, int(np.ceil(sum(phase[0] for phase in phases) / CYCLE_S - 1e-9)) + 1) * CYCLE_S
    position, velocity = np.full(len(time), length), np.zeros(len(time))
    start = p = v = 0.0
    for duration, a, j in phases:
        inside = (time > start) & (time <= start + duration)
        x = time[inside] - start
        position[inside] = p + x * (v + x * (a / 2.0 + x * j / 6.0))
        velocity[inside] = v + x * (a + x * j / 2.0)
        p += duration * (v + duration * (a / 2.0 + duration * j / 6.0))
        v += duration * (a + duration * j / 2.0)
        start += duration
    position[-1], velocity[-1] = length, 0.0
    return position, velocity


def mask_of(columns: dict[int, float] | Sequence[int]) -> int:
    mask = 0
    for column in columns:
        mask |= 1 << column
    return mask


def give(rig: Rig, order: str | float) -> None:
    """Hold or resume the program, or set its override."""
    mailbox = rig.executor.mailbox
    if order == "hold":
        mailbox.set_hold(True, 0)
    elif order == "resume":
        mailbox.resume(0)
    else:
        mailbox.set_override(float(order), 0)
