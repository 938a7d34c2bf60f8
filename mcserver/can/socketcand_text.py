"""The text of the socketcand protocol's raw mode (https://github.com/linux-can/socketcand, doc/protocol.md).

A message is ``< words >``; the stream may cut it anywhere. Identifiers of 3 digits are standard ones, of 8
extended ones.
"""

from __future__ import annotations

import re

from mcserver.can.port import EXTENDED, EXTENDED_MASK, MAX_PAYLOAD, STANDARD_MASK, Frame

HI = b"< hi >"
OK = b"< ok >"
RAW_MODE = b"< rawmode >"
ECHO = b"< echo >"
END = b">"
# Longest text before its closing bracket: a longer one is no message.
MAX_MESSAGE = 256
# Shortest message that is a frame, so that a count of bytes bounds a count of frames.
SHORTEST_FRAME = len("< frame 080 0  >")

_SEND = re.compile(rb"\s*< send ([0-9A-Fa-f]{3}|[0-9A-Fa-f]{8}) ([0-8])((?: [0-9A-Fa-f]{1,2}){0,8}) *")


def send_text(identifier: int, payload: bytes | bytearray) -> bytes:
    """Return a client's message that puts a frame on the bus."""
    digits = b"%08X" % (identifier ^ EXTENDED) if identifier & EXTENDED else b"%03X" % identifier
    if not payload:
        return b"< send %s 0 >" % digits
    return b"< send %s %d %s >" % (digits, len(payload), payload.hex(" ").encode("ascii"))


def split_messages(text: bytes) -> tuple[list[bytes], bytes]:
    """Messages without their closing bracket, and what has not ended yet."""
    messages = text.split(END)
    rest = messages.pop()
    return messages, rest


def frame_of(message: bytes) -> Frame | None:
    """Return the frame of a server's ``< frame ID TIME BYTES``; None where it is malformed."""
    words = message.split()
    if len(words) < 4 or words[1] != b"frame" or len(words[2]) not in (3, 8):
        return None
    try:
        identifier = int(words[2], 16)
        payload = bytes.fromhex(b"".join(words[4:]).decode("ascii"))
    except ValueError:
        return None
    extended = len(words[2]) == 8
    if not 0 <= identifier <= (EXTENDED_MASK if extended else STANDARD_MASK) or len(payload) > MAX_PAYLOAD:
        return None
    return identifier | EXTENDED if extended else identifier, payload


def frame_text(message: bytes, timestamp: bytes) -> bytes | None:
    """What a server makes of a client's ``< send ID LENGTH BYTES`` for the others; None: it is malformed.

    Args:
        message: without its closing bracket.
        timestamp: seconds with their fraction.
    """
    sent = _SEND.fullmatch(message)
    if sent is None:
        return None
    identifier, length, payload = sent.groups()
    digits = payload.split()
    if len(digits) != int(length):
        return None
    if int(identifier, 16) > (STANDARD_MASK if len(identifier) == 3 else EXTENDED_MASK):
        return None
    joined = b"".join(digits)
    if len(joined) != 2 * len(digits):
        joined = b"".join(digit.rjust(2, b"0") for digit in digits)
    return b"< frame " + identifier + b" " + timestamp + b" " + joined.upper() + b" >"
