"""Bring axes from speed or torque mode to rest in position mode."""

from __future__ import annotations

from mcserver.drives.bus import DriveMode
from mcserver.executor.cycle import Cycle

# A speed command's setpoint is kept if the encoder lags by no more than the axis's travel in this time [s].
KEPT_LAG_S = 0.01


def hold_position(cycle: Cycle, mask: int, slot: int, left: float = 0.0) -> None:
    """Bring axes in speed or torque mode to rest in position mode, within their limits.

    The setpoint continues from the last one; where the encoder is far from it (a torque, or a speed that was
    never reached), from the encoder.

    Args:
        slot: whose motion it is, -1: the machine's.
        left: rest of the cycle [cycles].
    """
    bank, row, motions = cycle.bank, cycle.row, cycle.motions
    for column in bank.masks.columns(mask & bank.energized):
        bit = 1 << column
        axis = cycle.machine.axes[column]
        lag = abs(float(row.setpoint[column] - row.actual[column]))
        if bank.delayed[column]:
            # feedback over a bus is delayed by some cycles, in which the axis has moved on
            behind = (bank.delay_cycles + 1) * cycle.cycle_s * abs(float(row.velocity[column]))
            lag = max(0.0, lag - behind)
        kept = bool(bank.speed & bit) and lag <= min(axis.max_following_error, axis.max_velocity * KEPT_LAG_S)
        bank.power(bit, DriveMode.POSITION)
        if kept:
            motions.halt(column, slot, left, jerk=not cycle.estop)
            continue
        motions.drop(bit)
        velocity = float(row.actual_velocity[column])
        row.ordered[column] = row.actual[column]
        bank.take_over(column, float(row.actual[column]), velocity)
        state = (float(row.ordered[column]), velocity, 0.0)
        motions.halt_from(column, slot, state, left, jerk=not cycle.estop)


def stop_independent(cycle: Cycle, mask: int, slot: int) -> None:
    """Bring axes to rest that are in independent motion, hold a speed or torque, or wait for their drives."""
    bank, motions = cycle.bank, cycle.motions
    for column in bank.masks.columns(mask & motions.mask & ~bank.speed):
        motions.halt(column, slot, jerk=not cycle.estop)
    hold_position(cycle, mask & (bank.speed | bank.torque_mode), slot)
    if mask & bank.homing:
        # in its own homing the drive moves the axis, and has to stop it
        bank.stop(mask & bank.homing)
