"""The envelope of a run: bounds of positions, speeds and duration, as approved and as enforced."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from mcserver.machine.machine_file import Machine

# Deviation of positions from the simulation that is allowed, at the start and on the way [in-position
# tolerances].
POSITION_TOLERANCES = 10.0
# Excess speed that is allowed, as a share of the simulated speed plus a share of the axis's greatest speed:
# commits of a real run are at other moments.
SPEED_SHARE, SPEED_FLOOR = 0.05, 0.01
# Excess time that is allowed, as a share plus a time [s]: drives settle, and planning takes time.
TIME_SHARE, TIME_FLOOR_S = 0.1, 2.0
# Tolerances of a tool's tip beyond those that follow from its joints [m, m/s].
TIP_TOLERANCE, TIP_SPEED_FLOOR = 1e-3, 0.01


class TipEnvelope(msgspec.Struct, frozen=True):
    """Bounds of a tool's tip: position in the base frame, and speed.

    Attributes:
        tool: its number. columns: of its joints, base to tool. turning: which of them are revolute.
        steps: (K + 1)·12 numbers, as `mckinematics.chain.Chain.steps`, three rows of four each.
        reach: of the chain [m]. low, high: X Y Z [m]. speed: [m/s].
    """

    tool: int
    columns: tuple[int, ...]
    turning: tuple[bool, ...]
    steps: tuple[float, ...]
    reach: float
    low: tuple[float, ...]
    high: tuple[float, ...]
    speed: float


class Envelope(msgspec.Struct, frozen=True):
    """Extents, speeds and duration of a run.

    Attributes:
        low, high: least and greatest setpoint of each column [m or rad]. speed: the greatest [m/s or rad/s].
        seconds: duration of the run, without holds and pauses.
        turning: mask of the columns that it sets to a constant speed (G1030), whose positions are not
        bounded. override: the greatest feed override, 1 as programmed.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    speed: tuple[float, ...]
    seconds: float
    turning: int = 0
    tips: tuple[TipEnvelope, ...] = ()
    override: float = 1.0


def enforced(shown: Envelope, machine: Machine, override: float, drift: Sequence[float]) -> Envelope:
    """Return the envelope to enforce for an approved one: with tolerances, at an override.

    Args:
        drift: distance of each column from where the simulation began [m or rad].
    """
    axes = machine.axes
    tolerance = [POSITION_TOLERANCES * axis.in_position for axis in axes]
    # the position of an axis after a constant speed cannot be predicted
    aside = [math.inf if shown.turning >> column & 1 else each for column, each in enumerate(tolerance)]
    return Envelope(
        low=tuple(low - each for low, each in zip(shown.low, aside, strict=True)),
        high=tuple(high + each for high, each in zip(shown.high, aside, strict=True)),
        speed=tuple(
            (1.0 + SPEED_SHARE) * speed + SPEED_FLOOR * axis.max_velocity
            for speed, axis in zip(shown.speed, axes, strict=True)
        ),
        seconds=(1.0 + TIME_SHARE) * shown.seconds + TIME_FLOOR_S,
        turning=shown.turning,
        tips=tuple(_enforced_tip(tip, drift) for tip in shown.tips),
        override=override,
    )


def _enforced_tip(tip: TipEnvelope, drift: Sequence[float]) -> TipEnvelope:
    joints = zip(tip.columns, tip.turning, strict=True)
    aside = TIP_TOLERANCE + math.fsum(
        drift[column] * (tip.reach if turns else 1.0) for column, turns in joints
    )
    return msgspec.structs.replace(
        tip,
        low=tuple(each - aside for each in tip.low),
        high=tuple(each + aside for each in tip.high),
        speed=(1.0 + SPEED_SHARE) * tip.speed + TIP_SPEED_FLOOR,
    )


def decode_envelope(encoded: bytes | memoryview) -> Envelope:
    """Decode an envelope from MessagePack."""
    return msgspec.msgpack.decode(encoded, type=Envelope)
