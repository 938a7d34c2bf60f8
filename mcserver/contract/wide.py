"""MessagePack in its widest forms: what a decoder has to take although the server writes the shortest ones.

Source: the MessagePack specification, https://github.com/msgpack/msgpack/blob/master/spec.md
"""

from __future__ import annotations

import struct
from collections.abc import Mapping


def encode_wide(value: object) -> bytes:
    """Encode every length in 32 bits and every integer in 64 bits.

    Raises:
        TypeError: the value is of no type of the wire.
    """
    match value:
        case None:
            return b"\xc0"
        case bool():
            return b"\xc3" if value else b"\xc2"
        case int():
            return b"\xd3" + struct.pack(">q", value) if value < 0 else b"\xcf" + struct.pack(">Q", value)
        case float():
            return b"\xcb" + struct.pack(">d", value)
        case str():
            text = value.encode()
            return b"\xdb" + struct.pack(">I", len(text)) + text
        case bytes():
            return b"\xc6" + struct.pack(">I", len(value)) + value
        case list() | tuple():
            return b"\xdd" + struct.pack(">I", len(value)) + b"".join(map(encode_wide, value))
        case Mapping():
            pairs = (encode_wide(key) + encode_wide(each) for key, each in value.items())
            return b"\xdf" + struct.pack(">I", len(value)) + b"".join(pairs)
        case _:
            raise TypeError(f"{type(value).__name__} is not on the wire")
