"""Payloads of servo mode, as `mcserver.net.messages`."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from mcserver.executor.shm.target_box import POINTS
from mcserver.net.messages import AxisIndex, Request

Frame = Literal["base", "tool"]
Row = Annotated[list[float], Meta(max_length=64)]
Rows = Annotated[list[Row], Meta(min_length=1, max_length=POINTS)]


class ServoRequest(Request, frozen=True, kw_only=True):
    """Leases axes for targets that the client streams, and energizes them.

    Attributes:
        axes: the axes to lease, all free now; None: all of the machine.
        name: for people.
        low: lowest position that targets may command, by axis number as text [mm or deg]; only together with
            ``high``. A machine with bodies or zones needs both: if these would not stay clear everywhere
            between, the program ends as faulted and nothing moves.
        high: highest position that targets may command, by axis number as text [mm or deg].
    """

    axes: list[AxisIndex] | None = None
    name: Annotated[str, Meta(max_length=200)] = ""
    low: dict[str, float] | None = None
    high: dict[str, float] | None = None


class ServoReply(msgspec.Struct, frozen=True):
    """The program that follows targets, sent as `StreamTargets` on ``in/{client}/{program}``; its axes in
    order."""

    program: str
    axes: list[int]


class StreamTargets(msgspec.Struct, frozen=True, array_like=True):
    """Payload of ``in/{client}/{program}`` in servo mode, an array: ``[seq, sent, counts_s, positions,
    velocities, times, tool, frame]``.

    Attributes:
        seq: increases by one with each message.
        sent: when it was sent, by any clock of the sender that does not step [s].
        counts_s: how long it is valid; without a newer one by then the axes stop and the program ends.
        positions, velocities: one row for each point, one number for each of the program's axes [mm, deg, per
            s]; at least one of the two. For a tool they are poses and twists: X Y Z [mm] and, if it has
            orientation, A B C in its order [deg]; velocities along and about the axes of ``frame``.
        times: of the points after ``sent``, ascending [s]; None: one point, for now.
        tool: its number; None: positions and velocities are those of axes.
        frame: ``base`` or ``tool``: frame of the velocities of a tool; poses are in the base's frame.
    """

    seq: Annotated[int, Meta(ge=1, le=2**53)]
    sent: float
    counts_s: Annotated[float, Meta(gt=0.0, le=10.0)]
    positions: Rows | None = None
    velocities: Rows | None = None
    times: Annotated[list[float], Meta(min_length=1, max_length=POINTS)] | None = None
    tool: Annotated[int, Meta(ge=0, le=2**31)] | None = None
    frame: Frame = "base"
