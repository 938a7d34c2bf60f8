"""Payloads about programs that an operator has to arm, as `mcserver.net.messages`."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from mcserver.net.messages import AxisIndex, Request
from mcserver.service.arming import LEAST_HASH, MAX_ARMED_S, MAX_TEXT, Extent
from mcserver.service.reports import WireDiagnostic

ProgramText = Annotated[str, Meta(max_length=MAX_TEXT)]


class RunRequestRequest(Request, frozen=True, kw_only=True):
    """Asks for a run of a text. It is checked and simulated, and moves nothing.

    Attributes:
        text: the program. name: for people.
        axes: the only axes that it may move; None: those that the text names.
    """

    text: ProgramText
    name: Annotated[str, Meta(max_length=200)] = ""
    axes: list[AxisIndex] | None = None


class RunArmedRequest(Request, frozen=True, kw_only=True):
    """Starts an armed program; the text is that of the request, to the last character."""

    text: ProgramText


class RunRequestsRequest(Request, frozen=True, kw_only=True):
    """What waits for an operator, is armed, or was started lately."""


class ArmRequest(Request, frozen=True, kw_only=True):
    """Arms a text once.

    Attributes:
        sha256: of the text, or at least its first 8 digits.
        seconds: how long it may be started.
        override: the greatest feed override [%].
    """

    sha256: Annotated[str, Meta(pattern=f"^[0-9a-fA-F]{{{LEAST_HASH},64}}$")]
    seconds: Annotated[float, Meta(gt=0.0, le=MAX_ARMED_S)] = 60.0
    override: Annotated[float, Meta(gt=0.0, le=200.0)] = 100.0


class RunRequestStatus(msgspec.Struct, frozen=True):
    """A request: what would move, how far, how long; ``remaining_s`` until it or its arming is over."""

    sha256: str
    client: str
    name: str
    state: Literal["waiting", "armed", "started"]
    axes: list[int]
    duration_s: float
    extents: list[Extent]
    remaining_s: float
    override: float
    operator: str


class RunRequestReply(msgspec.Struct, frozen=True):
    """``ok`` false: the text has faults, and nothing waits. ``run``: what an operator is shown."""

    ok: bool
    diagnostics: list[WireDiagnostic]
    run: RunRequestStatus | None = None


class RunRequestsReply(msgspec.Struct, frozen=True):
    """The oldest first."""

    requests: list[RunRequestStatus]


class RunArmedReply(msgspec.Struct, frozen=True):
    """The program that was started."""

    program: str
    override: float
