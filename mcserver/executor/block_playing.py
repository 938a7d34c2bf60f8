"""Play many cycles at once on a virtual clock, bit-identical to repeated `Executor.cycle`.

Each part of a cycle says for how many cycles it goes on unchanged (`idle_cycles`), what it sets in them
(`ahead`), and lets them pass (`skip`). A cycle in which anything else happens is played singly.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mcserver.executor.block import Block, Passing
from mcserver.executor.control_rules import pass_control
from mcserver.executor.cycle import Cycle
from mcserver.executor.entries import Array
from mcserver.executor.slot import ProgramSlot
from mcserver.executor.supervision import Supervision

# A shorter block costs more than it saves [cycles].
LEAST_BLOCK = 4


def play_block(
    cycle: Cycle,
    slot: ProgramSlot,
    supervision: Supervision,
    rates: Mapping[int, float],
    time: float,
    limit: int,
) -> Block | None:
    """Play up to ``limit`` cycles of the one program that runs.

    Args:
        rates: of position motions, by slot. time: executor time of the first cycle [s].

    Returns:
        The cycles played; None where the next cycles have to be played singly.
    """
    count = _idle_cycles(cycle, slot, rates, time, limit)
    if count < LEAST_BLOCK:
        return None
    bank, row = cycle.bank, cycle.row
    setpoint, actual, velocity = (
        np.repeat(each[None], count, axis=0) for each in (row.setpoint, row.actual, row.velocity)
    )
    lines = slot.ahead(count, setpoint, velocity)
    cycle.motions.ahead(count, setpoint, velocity)
    exact = bank.masks.bools(bank.exact & bank.energized)
    actual[:, exact] = setpoint[:, exact] - bank.offset[exact] + bank.offset[exact]
    count = supervision.within_travel(setpoint)
    if count < LEAST_BLOCK:
        return None
    if bank.exact != bank.all:
        ahead = bank.foresee(setpoint[:count], velocity[:count], actual[:count])
        kept = supervision.within_error(setpoint[: len(ahead.actual)], ahead.actual)
        if kept < len(ahead.actual) or not ahead.agreed:
            ahead = bank.foresee(setpoint[:kept], velocity[:kept], actual[:kept])
        count, actual = len(ahead.actual), ahead.actual
        if count < LEAST_BLOCK:
            return None
        ahead.arrive()
    setpoint, actual, velocity = setpoint[:count], actual[:count], velocity[:count]
    passing = slot.skip(setpoint, time)
    cycle.motions.skip(count)
    outputs = _pass_outputs(cycle, slot, passing, velocity)
    for number in range(max(0, count - len(cycle.history)), count):
        cycle.history[(cycle.number + number) % len(cycle.history)] = actual[number]
    cycle.number += count
    cycle.time = time + (count - 1) * cycle.cycle_s
    return Block(lines[:count], setpoint, actual, outputs, passing.events)


def _idle_cycles(cycle: Cycle, slot: ProgramSlot, rates: Mapping[int, float], time: float, limit: int) -> int:
    """Return the number of next cycles in which only rows, motions and barriers go on."""
    bank, motions = cycle.bank, cycle.motions
    moving = motions.mask | slot.playback.active
    if not bank.follows or moving & ~bank.energized or motions.mask & cycle.profiled.mask:
        return 0
    for look in (
        lambda most: cycle.io.idle_cycles(time, most),
        slot.idle_cycles,
        lambda most: motions.idle_cycles(rates, most),
    ):
        limit = look(limit)
        if limit < LEAST_BLOCK:
            return 0
    return limit


def _pass_outputs(cycle: Cycle, slot: ProgramSlot, passing: Passing, velocity: Array) -> Array:
    """Set outputs as a program passes their entries; return the outputs of each cycle, shape (n, O).

    Args:
        velocity: of the setpoints, shape (n, K).
    """
    count = len(velocity)
    values = np.empty((count, len(cycle.row.outputs)))
    if not values.size:
        return values
    speeds: dict[int, Array] = {}

    def speeds_of(owner: int, axes: int) -> Array:
        if owner != slot.index:
            return np.zeros(behind - first)
        if axes not in speeds:
            speeds[axes] = slot.path_speeds(velocity, axes)
        return speeds[axes][first:behind]

    first = 0
    for behind, control in passing.outputs:
        if behind > first:
            cycle.io.fill(values[first:behind], speeds_of)
            first = behind
        pass_control(slot, control, 0.0)
    behind = count
    cycle.io.fill(values[first:behind], speeds_of)
    return values
