"""Gains of loops that are closed in the master: what is usual, and what is refused.

A loop over a bus is some cycles late, so its gains are bounded by the cycle. The bounds below are for
readings that are `DELAY_CYCLES` late. With later ones they shrink by the cycles from a command to the end of
its first effect, delay + 1: so torque loops keep their margins (eigenvalues of the sampled loop), and speed
loops nearly. For a torque loop on an axis of inertia J [kg·m²] with velocity gain K [N·m·s/rad], K / J is the
crossover of its velocity part [1/s].
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

import msgspec

from mcserver.machine.drive import SIMULATED_INERTIA, Refusal

if TYPE_CHECKING:
    from mcserver.drives.cia402.drive import Cia402Drive
    from mcserver.machine.sections import AxisSection

# Cycles from a setpoint to the reading of an axis that follows it. On CAN: RPDO and SYNC, a cycle of motion,
# SYNC and TPDO. On EtherCAT a frame takes along what was sampled before it came.
DELAY_CYCLES = 2
ETHERCAT_DELAY_CYCLES = DELAY_CYCLES + 1
# A position loop onto speeds is stable and calm up to this product of gain and cycle time [1].
GREATEST_GAIN = 0.2
USUAL_GAIN = 0.1
# The same for the velocity part of a torque loop: with the usual value the axis's inertia may be a quarter or
# four times of what the machine file says, with the greatest one half of it.
GREATEST_CROSSOVER = 0.2
USUAL_CROSSOVER = 0.1
# Share of the crossover that the position gain may be, and usually is.
GREATEST_SHARE = 0.35
USUAL_SHARE = 0.2
# Usual integral time of a torque loop, as a multiple of 1 / position gain.
USUAL_INTEGRAL = 4.0
LEAST_INTEGRAL = 2.0
# 6071h and 6072h are thousandths of the rated torque in 16 bits.
GREATEST_SHARE_OF_RATED = 32.767

D = TypeVar("D", bound="Cia402Drive")


def lateness(delay: int) -> float:
    """Return by how much a loop with readings `delay` cycles late has to be slower than one on CAN [1]."""
    return (delay + 1) / (DELAY_CYCLES + 1)


def complete_loop(drive: D, axis: AxisSection, cycle_s: float, bad: Refusal, delay: int = DELAY_CYCLES) -> D:
    """Fill in gains, inertia and greatest torque of a drive on a bus, and refuse what is not stable.

    Args:
        delay: of a reading behind its setpoint [cycles].
    """
    replace = msgspec.structs.replace
    inertia = drive.inertia or SIMULATED_INERTIA
    late = lateness(delay)
    if drive.mode == "cst":
        return _complete_torque_loop(drive, axis, cycle_s, late, bad)
    gain = drive.position_gain or min(20.0, USUAL_GAIN / (late * cycle_s))
    if drive.mode == "csv" and gain * late * cycle_s > GREATEST_GAIN * (1.0 + 1e-9):
        bad(
            "position_gain",
            f"{gain:g} /s with a cycle of {cycle_s * 1e3:g} ms is not stable over a bus",
            f"give {GREATEST_GAIN / (late * cycle_s):g} or less, or a greater cycle_hz",
        )
    if drive.velocity_gain:
        bad("velocity_gain", 'belongs to mode = "cst"', "leave it out")
    return replace(drive, position_gain=gain, integral_time_s=drive.integral_time_s or 0.0, inertia=inertia)


def _complete_torque_loop(drive: D, axis: AxisSection, cycle_s: float, late: float, bad: Refusal) -> D:
    if drive.rated_torque <= 0.0:
        bad(
            "rated_torque",
            "6071h counts thousandths of the rated torque, which is not there",
            "give rated_torque = the motor's rated torque in N·m (6076h)",
        )
    if drive.inertia <= 0.0:
        bad(
            "inertia",
            'mode = "cst" needs the inertia that the motor turns, its own and the load\'s',
            "give inertia = kg·m² at the motor's shaft: motor + load / gear²",
        )
    if axis.max_following_error is None:
        bad(
            "mode",
            'mode = "cst" needs max_following_error: it ends the torque when the axis is elsewhere',
            "give max_following_error of the axis [mm, deg]",
        )
    most = drive.max_torque or drive.rated_torque
    if drive.rated_torque > 0.0 and most > GREATEST_SHARE_OF_RATED * drive.rated_torque:
        bad(
            "max_torque",
            f"{most:g} N·m is {most / drive.rated_torque:.3g} times the rated torque",
            "compare both with the motor's data sheet",
        )
    inertia = drive.inertia or SIMULATED_INERTIA
    velocity_gain = drive.velocity_gain or inertia * USUAL_CROSSOVER / (late * cycle_s)
    crossover = velocity_gain / inertia
    if drive.inertia > 0.0 and crossover * late * cycle_s > GREATEST_CROSSOVER * (1.0 + 1e-9):
        bad(
            "velocity_gain",
            f"{velocity_gain:g} N·m·s/rad on {inertia:g} kg·m² with a cycle of {cycle_s * 1e3:g} ms "
            "is not stable over a bus",
            f"give {GREATEST_CROSSOVER / (late * cycle_s) * inertia:.4g} or less, or a greater cycle_hz",
        )
    gain = drive.position_gain or USUAL_SHARE * crossover
    if gain > GREATEST_SHARE * crossover * (1.0 + 1e-9):
        bad(
            "position_gain",
            f"{gain:g} /s is too much for a velocity part of {crossover:.4g} /s (velocity_gain / inertia)",
            f"give {GREATEST_SHARE * crossover:.4g} or less, or a greater velocity_gain",
        )
    integral = USUAL_INTEGRAL / gain if drive.integral_time_s is None else drive.integral_time_s
    if 0.0 < integral < LEAST_INTEGRAL / gain * (1.0 - 1e-9) or not math.isfinite(integral):
        bad(
            "integral_time_s",
            f"{integral:g} s is too short for a position_gain of {gain:g} /s",
            f"give {LEAST_INTEGRAL / gain:.3g} s or more, 0 for none, or leave it out",
        )
    return msgspec.structs.replace(
        drive,
        position_gain=gain,
        velocity_gain=velocity_gain,
        integral_time_s=integral,
        inertia=inertia,
    )
