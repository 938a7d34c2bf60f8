"""Files of the server, taken over piece by piece."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from typing import Protocol

from mcclient.errors import ProtocolError


class Part(Protocol):
    """Bytes of a file, and the size of the whole."""

    @property
    def data(self) -> bytes: ...
    @property
    def size(self) -> int: ...


async def read_parts(what: str, read: Callable[[int], Awaitable[Part]]) -> AsyncIterator[tuple[bytes, int]]:
    """The pieces of a file, each with the size of the whole.

    Args:
        what: for people. read: the part that begins at an offset.

    Raises:
        ProtocolError: MC533 the file has changed meanwhile.
    """
    offset, size = 0, None
    while size is None or offset < size:
        part = await read(offset)
        if (size is not None and part.size != size) or (not part.data and offset < part.size):
            raise ProtocolError("MC533", f"{what} changed while it was read", "try again")
        size = part.size
        offset += len(part.data)
        yield part.data, size
