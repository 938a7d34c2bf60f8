"""Messages about whole texts: uploaded in parts, and as they were simulated."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from mcserver.net.messages import Request, Sha256
from mcserver.service.reports import LineReport, WireDiagnostic, WorkOffset
from mcserver.simulation.assertions import Judged
from mcserver.simulation.difference import AxisDifference as AxisDifference
from mcserver.simulation.difference import Difference
from mcserver.simulation.difference import TipDifference as TipDifference

MAX_PART_BYTES = 1 << 20


class PutTextRequest(Request, frozen=True, kw_only=True):
    """The next part of a program's text, for ``check``, and for the times of programs that run it.

    Attributes:
        sha256: of the whole text in UTF-8. size: of the whole text [bytes].
        offset: where the part begins [bytes]. part: its bytes; characters may be split.
    """

    sha256: Sha256
    size: Annotated[int, Meta(ge=1)]
    offset: Annotated[int, Meta(ge=0)]
    part: Annotated[bytes, Meta(max_length=MAX_PART_BYTES)]


class PutTextReply(msgspec.Struct, frozen=True):
    """How much of the text has arrived: the next part begins at ``received``.

    Attributes:
        received: of the text [bytes]. lines: in this part of it. complete: all of it has arrived.
    """

    received: int
    lines: int
    complete: bool


class AxisTravel(msgspec.Struct, frozen=True):
    """Where an axis ends, and its least and greatest setpoint [mm or deg]."""

    position: float
    min: float
    max: float
    unit: str


class TipPath(msgspec.Struct, frozen=True):
    """Where a tool goes [mm]; ``tool`` None: the axes 0, 1 and 2 themselves."""

    tool: int | None
    points: list[list[float]]


class SimulatedPath(msgspec.Struct, frozen=True):
    """Points at equal distances along the axes' travel.

    Attributes:
        lines: the program's line at each point. tips: the points of each tool.
    """

    lines: list[int]
    tips: list[TipPath]


class PairClearance(msgspec.Struct, frozen=True):
    """How near two ``bodies`` came to each other, when, and in which line."""

    bodies: list[str]
    least_mm: float
    time_s: float
    line: int


class ClearanceReport(msgspec.Struct, frozen=True):
    """The least distances of a run's bodies.

    Attributes:
        least_mm: None if all stayed apart by more than the margin plus 50 mm. pairs: that came nearer, the
            nearest first, 20 at most.
        assumed_on: zones that an input switches, which count as on.
    """

    margin_mm: float
    least_mm: float | None
    pairs: list[PairClearance]
    assumed_on: list[str] = []


class SimulateReply(msgspec.Struct, frozen=True, omit_defaults=True):
    """What ``mcserver simulate --json`` prints.

    Attributes:
        lines: those that took time, by start. axes: by number as text.
        inputs, outputs: their values at the end, by name. work_offsets: of the systems used or set.
        path: if it was requested. clearance: of a machine that names bodies.
        assertions: results of those of the request, in their order. difference: to the motion of `against`.
    """

    ok: bool
    duration_s: float
    feed_length_mm: float
    lines: list[LineReport]
    axes: dict[str, AxisTravel]
    diagnostics: list[WireDiagnostic]
    work_offsets: list[WorkOffset] = []
    inputs: dict[str, float] = {}
    outputs: dict[str, float] = {}
    path: SimulatedPath | None = None
    clearance: ClearanceReport | None = None
    assertions: list[Judged] = []
    difference: Difference | None = None
