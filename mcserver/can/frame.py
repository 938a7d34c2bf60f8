"""The layout of ``struct can_frame`` (linux/can.h), which every port prepares its buffers in.

Bytes 0 … 3 identifier with flags (native order), 4 length, 5 … 7 padding, 8 … 15 payload.
"""

from __future__ import annotations

import struct

from mcserver.can.port import MAX_PAYLOAD, is_identifier

FRAME_SIZE = 16
PAYLOAD_OFFSET = 8
REMOTE_FLAG = 0x40000000
ERROR_FLAG = 0x20000000
NOT_DATA = REMOTE_FLAG | ERROR_FLAG
HEADER = struct.Struct("=IB3x")
IDENTIFIER = struct.Struct("=I")


def prepare_frame(identifier: int, length: int) -> bytearray:
    """Return a frame with a payload of zeros.

    Raises:
        ValueError: the identifier is none of CAN, or the length no classic one; a fault of the caller.
    """
    if not (is_identifier(identifier) and 0 <= length <= MAX_PAYLOAD):
        raise ValueError(f"no classic frame has identifier {identifier:X} and {length} bytes")
    buffer = bytearray(FRAME_SIZE)
    HEADER.pack_into(buffer, 0, identifier, length)
    return buffer


def filled_frame(identifier: int, payload: bytes) -> bytearray:
    """Return a frame with this payload; raises as `prepare_frame`."""
    frame = prepare_frame(identifier, len(payload))
    frame[PAYLOAD_OFFSET : PAYLOAD_OFFSET + len(payload)] = payload
    return frame
