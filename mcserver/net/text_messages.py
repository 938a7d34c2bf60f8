"""Messages by which a client hands over a long text by parts."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from mcserver.net.messages import Request, Sha256

MAX_PART_BYTES = 1 << 20


class PutTextRequest(Request, frozen=True, kw_only=True):
    """The next part of a program's text, for ``check``, and for the times of programs that run it.

    Attributes:
        sha256: of the whole text in UTF-8. size: of the whole text [bytes].
        offset: where the part begins [bytes]. part: its bytes; characters may be cut.
    """

    sha256: Sha256
    size: Annotated[int, Meta(ge=1)]
    offset: Annotated[int, Meta(ge=0)]
    part: Annotated[bytes, Meta(max_length=MAX_PART_BYTES)]


class PutTextReply(msgspec.Struct, frozen=True):
    """How much of the text is there: the next part begins at ``received``.

    Attributes:
        received: of the text [bytes]. lines: in what is there. complete: all of it is.
    """

    received: int
    lines: int
    complete: bool
