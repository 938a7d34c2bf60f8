"""Random inputs from seeds: whole inputs that are known, with pieces changed, moved, doubled and mixed."""

from __future__ import annotations

import random
from collections.abc import Sequence

# what parsers tend to trip over: signs, limits, quotes, invalid UTF-8, MessagePack's longest headers
BITS = (
    b"\x00",
    b"\xff",
    b"\xc1",
    b"\x80",
    b"\x90",
    b"\xdf\xff\xff\xff\xff",
    b"\xdd\xff\xff\xff\xff",
    b"\xc6\xff\xff\xff\xff",
    b"\xcb\x7f\xf0\x00\x00\x00\x00\x00\x00",
    b"\xcb\x7f\xf8\x00\x00\x00\x00\x00\x00",
    b"\xcf\xff\xff\xff\xff\xff\xff\xff\xff",
    b"\xd3\x80\x00\x00\x00\x00\x00\x00\x00",
    b"\xa3\xff\xfe\xfd",
    b"-",
    b"+",
    b".",
    b"1e999",
    b"nan",
    b"inf",
    b"-0",
    b"99999999999999999999",
    b"0x",
    b"[",
    b"]",
    b"(",
    b")",
    b"{",
    b"}",
    b'"',
    b"'",
    b"=",
    b",",
    b";",
    b"%",
    b"\n",
    b"\r",
    b"\t",
    b"\xe2\x80\xa8",
    b"\xcc\x81",
    b"\xf0\x9f\xa6\xbe",
    b"G",
    b"M",
    b"G1010",
    b"G64 P",
    b"[63]",
    b"[64]",
    b"$NODEID",
)
MOST_BYTES = 4096


def mutated(draw: random.Random, seeds: Sequence[bytes]) -> bytes:
    """A seed with one to a few changes, at times nothing but noise."""
    if draw.random() < 0.02:
        return draw.randbytes(draw.randrange(200))
    text = bytearray(draw.choice(seeds)[:MOST_BYTES])
    for _ in range(draw.choice((1, 1, 1, 2, 3, 8))):
        at = draw.randrange(len(text) + 1)
        to = min(len(text), at + draw.choice((0, 1, 1, 2, 5, 30)))
        match draw.randrange(6):
            case 0:
                text[at:to] = draw.choice(BITS)
            case 1:
                del text[at:to]
            case 2:
                text[at:at] = text[at:to] * draw.randrange(1, 4)
            case 3:
                other = draw.choice(seeds)
                begin = draw.randrange(len(other) + 1)
                text[at:to] = other[begin : begin + draw.randrange(40)]
            case 4 if at < len(text):
                text[at] ^= 1 << draw.randrange(8)
            case _:
                text[at:to] = draw.randbytes(to - at)
    return bytes(text)
