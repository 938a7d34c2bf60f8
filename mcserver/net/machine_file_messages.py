"""Payloads about the machine file, as `mcserver.net.messages`."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from mcserver.net.messages import Request, Sha256
from mcserver.service.reports import WireDiagnostic

MAX_TEXT = 1 << 20


class MachineFileRequest(Request, frozen=True, kw_only=True):
    """The machine file that the server was started with."""


class MachineFileReply(msgspec.Struct, frozen=True):
    """Attributes:
    name: of the file, without its folder. text: as it is on the disk now. sha256: of that text.
    in_force: the server runs with this text; otherwise it has changed since the start.
    """

    name: str
    text: str
    sha256: str
    in_force: bool


class WriteMachineFileRequest(Request, frozen=True, kw_only=True):
    """Checks a text as ``mcserver machine check`` does, and writes it if it has no error.

    The server continues with the old one until it is restarted.

    Attributes:
        text: all of the new file. sha256: of the text that was edited, as ``machine_file`` returned it.
        only_check: nothing is written. by: the person, if a client serves several.
    """

    text: Annotated[str, Meta(max_length=MAX_TEXT)]
    sha256: Sha256
    only_check: bool = False
    by: Annotated[str, Meta(max_length=100)] = ""


class WriteMachineFileReply(msgspec.Struct, frozen=True):
    """Attributes:
    written: the new text is on the disk. before: name of the file that keeps the old one; empty: none.
    diagnostics: errors and warnings of the new text.
    """

    written: bool
    before: str
    diagnostics: list[WireDiagnostic]
