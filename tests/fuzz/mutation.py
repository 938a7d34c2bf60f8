"""Random inputs from seeds: whole inputs that are known, with pieces changed, moved, doubled and mixed."""

from __future__ import annotations

import random
import re
from collections.abc import Sequence

# what parsers tend to trip over: signs, limits, quotes, invalid UTF-8, MessagePack's longest headers
BITS = (
    *(bytes([each]) for each in b"\x00\xff\xc1\x80\x90-+.[](){}\"'=,;%\n\r\tGM"),
    *(bytes([head]) + b"\xff" * 4 for head in b"\xdf\xdd\xc6"),
    *re.findall(rb"\S+", b"1e999 nan inf -0 99999999999999999999 0x G1010 [63] [64] $NODEID"),
    b"G64 P",
    b"\xcb\x7f\xf0" + bytes(6),
    b"\xcb\x7f\xf8" + bytes(6),
    b"\xcf" + b"\xff" * 8,
    b"\xd3\x80" + bytes(7),
    b"\xa3\xff\xfe\xfd",
    b"\xe2\x80\xa8",
    b"\xcc\x81",
    b"\xf0\x9f\xa6\xbe",
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
