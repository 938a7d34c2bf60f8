"""Pictures that slicers write into the comments at the head of a program: PNG and JPEG, nothing else.

They come from a file that anybody may have made, and go to browsers: what is not wholly as it has to be is
no picture.
"""

from __future__ import annotations

import base64
import binascii
import re
import struct
from collections.abc import Iterator
from typing import Final

import msgspec

# slicers write them ahead of all code; PrusaSlicer's greatest have some 100 kB
HEAD_CHARS: Final = 1 << 20
MAX_BYTES: Final = 512 * 1024
MAX_PIXELS: Final = 1024  # of a side: a small file may claim a picture that fills a browser's memory
_BLOCK: Final = re.compile(
    r"^;[ \t]*thumbnail(_JPG|)[ \t]+begin[ \t]+([0-9]{1,4})(?:x|[ \t]+)([0-9]{1,4})[ \t]+([0-9]{1,7})"
    r"[ \t]*\r?\n"
    r"((?:;[ \t]*[A-Za-z0-9+/=]+[ \t]*\r?\n)+)"
    r";[ \t]*thumbnail\1[ \t]+end\b",
    re.MULTILINE,
)
_PNG_HEAD, _PNG_END = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", b"\0\0\0\0IEND\xaeB\x60\x82"
# start of frame, without the tables that have numbers between them (ITU-T T.81, table B.1)
_JPEG_FRAMES: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


class Thumbnail(msgspec.Struct, frozen=True):
    """A picture: its media type and bytes, and its size in pixels."""

    kind: str
    content: bytes
    width: int
    height: int


def find_thumbnail(text: str) -> Thumbnail | None:
    """Return the greatest picture at the head of a program; None: there is none that is sound."""
    return max(_thumbnails(text), key=lambda each: each.width * each.height, default=None)


def _thumbnails(text: str) -> Iterator[Thumbnail]:
    for block in _BLOCK.finditer(text, 0, HEAD_CHARS):
        encoded = re.sub(r"[; \t\r\n]", "", block[5])
        if len(encoded) != int(block[4]):
            continue
        try:
            content = base64.b64decode(encoded, validate=True)
        except binascii.Error:
            continue
        size = _jpeg_size(content) if block[1] else _png_size(content)
        named = (int(block[2]), int(block[3]))
        if size == named and len(content) <= MAX_BYTES and 0 < min(size) <= max(size) <= MAX_PIXELS:
            yield Thumbnail("image/jpeg" if block[1] else "image/png", content, *named)


def _png_size(content: bytes) -> tuple[int, int] | None:
    """Return width and height of a whole PNG (RFC 2083, 11.2.1); None: it is none."""
    if not content.startswith(_PNG_HEAD) or not content.endswith(_PNG_END):
        return None
    width, height = struct.unpack(">II", content[16:24])
    return width, height


def _jpeg_size(content: bytes) -> tuple[int, int] | None:
    """Return width and height of a whole JPEG, from its frame's header; None: it is none."""
    if not content.startswith(b"\xff\xd8") or not content.endswith(b"\xff\xd9"):
        return None
    place = 2
    while place + 9 <= len(content) and content[place] == 0xFF:
        length = int.from_bytes(content[place + 2 : place + 4])
        if content[place + 1] in _JPEG_FRAMES:
            height, width = struct.unpack(">HH", content[place + 5 : place + 9])
            return width, height
        place += 2 + length
    return None
