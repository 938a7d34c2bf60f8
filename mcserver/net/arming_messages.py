"""Payloads about programs that an operator has to arm, as `mcserver.net.messages`."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from mcserver.net.messages import AxisIndex, Grace, Request
from mcserver.service.arming import (
    LEAST_HASH,
    MAX_ARMED_S,
    MAX_REASON,
    MAX_STANDING_S,
    MAX_TEXT,
    Extent,
    RunPath,
    ToolExtent,
)
from mcserver.service.arming import ToolPath as ToolPath
from mcserver.service.reports import WireDiagnostic
from mcserver.service.run_certificate import MAX_CERTIFICATE

TextHash = Annotated[str, Meta(pattern=f"^[0-9a-fA-F]{{{LEAST_HASH},64}}$")]
RunState = Literal["waiting", "armed", "started", "rejected"]
ProgramText = Annotated[str, Meta(max_length=MAX_TEXT)]


class RunRequestRequest(Request, frozen=True, kw_only=True):
    """Requests a run of a text. It is checked and simulated, and moves nothing.

    Attributes:
        text: the program. name: for people.
        axes: the only axes that it may move; None: those named in the text.
        certificate: a file of ``mcserver certify`` for exactly this run, which arms it; None: a person must.
        block_delete, optional_stop: as in `OpenRequest`, and part of what is approved; a certificate has its
            own.
    """

    text: ProgramText
    name: Annotated[str, Meta(max_length=200)] = ""
    axes: list[AxisIndex] | None = None
    certificate: Annotated[str, Meta(max_length=MAX_CERTIFICATE)] | None = None
    block_delete: bool | None = None
    optional_stop: bool | None = None


class RunArmedRequest(Request, frozen=True, kw_only=True):
    """Starts an armed program; the text is exactly that of the request.

    Attributes:
        grace_s: as in `OpenRequest`.
    """

    text: ProgramText
    grace_s: Grace = 10.0


class RunRequestsRequest(Request, frozen=True, kw_only=True):
    """Requests that wait for an operator, are armed, or were started recently."""


class RunApprovalsRequest(Request, frozen=True, kw_only=True):
    """Runs whose envelope was approved for a while (``standing_s``), each with its ``remaining_s``."""


class RunPreviewRequest(Request, frozen=True, kw_only=True):
    """What an operator reviews before arming: the text and its simulated path.

    Attributes:
        sha256: of the text, or at least its first 8 digits.
    """

    sha256: TextHash


class ArmRequest(Request, frozen=True, kw_only=True):
    """Arms a text once.

    Attributes:
        sha256: of the text, or at least its first 8 digits.
        seconds: how long it may be started.
        override: the greatest feed override [%].
        number: of the request that was reviewed: one that was repeated since is not armed; None: any.
        standing_s: for this time every other run that the same client requests, and that stays inside the
            envelope of this run, is armed at its request; 0: only this run, once.
        servo: for the same time it may also stream targets, inside the extents, speeds and duration of this
            run (`servo_armed`); no simulation shows these beforehand.
    """

    sha256: TextHash
    seconds: Annotated[float, Meta(gt=0.0, le=MAX_ARMED_S)] = 60.0
    override: Annotated[float, Meta(gt=0.0, le=200.0)] = 100.0
    number: Annotated[int, Meta(ge=0)] | None = None
    standing_s: Annotated[float, Meta(ge=0.0, le=MAX_STANDING_S)] = 0.0
    servo: bool = False


class RejectRequest(Request, frozen=True, kw_only=True):
    """Rejects a run; its client is shown the reason. An approval for a while that was given with it ends.

    Attributes:
        sha256: of the text, or at least its first 8 digits. number: as in `ArmRequest`.
    """

    sha256: TextHash
    reason: Annotated[str, Meta(max_length=MAX_REASON)] = ""
    number: Annotated[int, Meta(ge=0)] | None = None


class WithdrawRequest(Request, frozen=True, kw_only=True):
    """Withdraws a request; only the user who made it may.

    Attributes:
        sha256: of the text, or at least its first 8 digits.
    """

    sha256: TextHash


class RunRequestStatus(msgspec.Struct, frozen=True):
    """A request: what would move, how far, how long; ``remaining_s`` until it or its arming is over.

    Attributes:
        effects: what the run leaves changed for later runs, a sentence each.
        tools: extents of the tools' tips. digest: SHA-256 of everything that the simulation read.
        changed: which of this has changed since, a sentence each; if there is any it cannot start.
        operator: who armed or rejected it. reason: why it was rejected.
        number: a new one each time that the run is requested, even with the same text.
        approval: hash of the approval for a while that has armed it; the run stays inside its envelope.
        beyond: what of the run is outside the envelope approved for its client, a sentence each.
        servo: it is approved for a while, for streamed targets, too.
        block_delete, optional_stop: those of the run, as in `OpenRequest`.
    """

    sha256: str
    client: str
    name: str
    state: RunState
    axes: list[int]
    duration_s: float
    extents: list[Extent]
    remaining_s: float
    override: float
    operator: str
    block_delete: bool
    optional_stop: bool
    number: int = 0
    reason: str = ""
    effects: list[str] = []
    tools: list[ToolExtent] = []
    digest: str = ""
    changed: list[str] = []
    approval: str = ""
    beyond: list[str] = []
    servo: bool = False


class RunRequestReply(msgspec.Struct, frozen=True):
    """``ok`` false: the text has faults, and nothing waits. ``run``: what an operator is shown."""

    ok: bool
    diagnostics: list[WireDiagnostic]
    run: RunRequestStatus | None = None


class RunRequestsReply(msgspec.Struct, frozen=True):
    """The oldest first."""

    requests: list[RunRequestStatus]


class RunPreviewReply(msgspec.Struct, frozen=True):
    """A request with its text and the path of its simulation.

    Attributes:
        certifiable: what ``mcserver certify`` signs of it, as JSON: the initial state of its simulation, and
            a digest of its setpoints.
        warnings: of its check and simulation, the first ones; unshown_warnings: how many more there were.
    """

    run: RunRequestStatus
    text: str
    path: RunPath
    certifiable: str
    warnings: list[WireDiagnostic] = []
    unshown_warnings: int = 0


class RunArmedReply(msgspec.Struct, frozen=True):
    """The program that was started."""

    program: str
    override: float
