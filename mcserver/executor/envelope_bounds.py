"""Extents, speeds and duration of a run: what an approval shows, and what the executor enforces of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from mcserver.machine.machine_file import Machine

# A run may begin so many in-position tolerances from where its simulation began, and stay as far beside it.
POSITION_TOLERANCES = 10.0
# A run may be faster than its simulation by this share, and by this share of the axis's greatest speed:
# rows are planned ahead in other portions there.
SPEED_SHARE, SPEED_FLOOR = 0.05, 0.01
# It may take longer by this share and time [s]: drives settle, and planning waits for a computer.
TIME_SHARE, TIME_FLOOR_S = 0.1, 2.0
# The tip of a tool may be further from its box than the joints' other start explains [m], and faster [m/s].
TIP_TOLERANCE, TIP_SPEED_FLOOR = 1e-3, 0.01


class TipEnvelope(msgspec.Struct, frozen=True):
    """Where a tool's tip may be, and how fast, in the base frame.

    Attributes:
        tool: its number. columns: of its joints, base to tool. turning: which of them turn.
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
        seconds: how long the run lasts, holds and pauses left out.
        turning: mask of the columns that it lets turn on at a speed (G1030), whose travel is not bounded
        then.
        override: the greatest feed override, 1 as programmed.
    """

    low: tuple[float, ...]
    high: tuple[float, ...]
    speed: tuple[float, ...]
    seconds: float
    turning: int = 0
    tips: tuple[TipEnvelope, ...] = ()
    override: float = 1.0


def enforced(shown: Envelope, machine: Machine, override: float, drift: Sequence[float]) -> Envelope:
    """Return what is enforced of a run that was shown to do this: with tolerances, at an override.

    Args:
        drift: how far each column stands from where the simulation began [m or rad].
    """
    axes = machine.axes
    tolerance = [POSITION_TOLERANCES * axis.in_position for axis in axes]
    # where an axis stands that has turned at a speed nobody can say beforehand
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
    """Return an envelope from its MessagePack."""
    return msgspec.msgpack.decode(encoded, type=Envelope)
