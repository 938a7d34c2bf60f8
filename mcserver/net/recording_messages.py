"""Payloads about recordings on the server, as `mcserver.net.messages`."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from mcserver.net.messages import Request
from mcserver.recorder.folder import MAX_PART_BYTES, RecordingInfo
from mcserver.recorder.messages import RecorderStatus as RecorderStatus

RecordingName = Annotated[str, Meta(max_length=100)]


class RecordStartRequest(Request, frozen=True, kw_only=True):
    """Records every cycle into a file on the server from now on.

    Attributes:
        name: of the recording; empty: the time.
        max_s: when it ends by itself; None: only when it is stopped.
    """

    name: RecordingName = ""
    max_s: Annotated[float, Meta(gt=0.0, le=86_400.0)] | None = None


class RecordStopRequest(Request, frozen=True, kw_only=True):
    """Ends a recording; without a name the only one. The reply comes once the file is complete."""

    name: RecordingName = ""


class RecordSaveRequest(Request, frozen=True, kw_only=True):
    """Saves the black box, the last minutes. ``reason`` is in the file and in its name."""

    reason: Annotated[str, Meta(max_length=40)] = "asked"


class RecordReply(msgspec.Struct, frozen=True):
    """The recording's name."""

    name: str


class RecordingsRequest(Request, frozen=True, kw_only=True):
    """Lists the recordings."""


class RecordingsReply(msgspec.Struct, frozen=True):
    """The newest first; ``recorder`` None: it is not running. ``folder``: on the server's disk."""

    recordings: list[RecordingInfo]
    recorder: RecorderStatus | None
    folder: str


class RecordingReadRequest(Request, frozen=True, kw_only=True):
    """Part of a recording's file, for a download in parts; answered with a `RecordingPart`."""

    name: RecordingName
    offset: Annotated[int, Meta(ge=0)] = 0
    size: Annotated[int, Meta(ge=1, le=MAX_PART_BYTES)] = MAX_PART_BYTES
