"""What a realtime thread needs of a CAN bus: take what has come, give what goes out, never wait.

Classic CAN only, up to 8 bytes. An extended identifier, of 29 bits, has `EXTENDED` beside it and so equals
none of those with 11 bits. Remote frames, error frames and malformed packets are counted and left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

# (identifier, payload)
Frame = tuple[int, bytes]
MAX_PAYLOAD = 8
STANDARD_MASK = 0x7FF
EXTENDED = 0x80000000
EXTENDED_MASK = 0x1FFFFFFF
# At most so many frames are taken in one call, so that a babbling bus cannot hold the cycle.
MAX_DRAINED = 512


def is_identifier(identifier: int) -> bool:
    """Return whether a frame can have an identifier."""
    return 0 <= identifier <= STANDARD_MASK or EXTENDED <= identifier <= EXTENDED | EXTENDED_MASK


def recipient(identifier: int) -> int:
    """Return by what a frame is listened to where private protocols of motors are beside CANopen.

    Of an extended identifier its last byte alone says whom it is for, and the others have other numbers.
    """
    return identifier & (EXTENDED | 0xFF) if identifier & EXTENDED else identifier


@dataclass
class PortCounters:
    """What happened on a port since it was opened.

    Attributes:
        sent, received: frames. unsent: frames that found no room, or no bus, and are gone. malformed: packets
            that are no classic CAN data frame. errors: error frames and failed system calls.
        down: whether the bus is away now (interface down, bus off, connection lost).
    """

    sent: int = 0
    received: int = 0
    unsent: int = 0
    malformed: int = 0
    errors: int = 0
    down: bool = False


class ListeningPort(Protocol):
    """One end on a bus, as a receiver of frames. Not thread-safe."""

    @property
    def counters(self) -> PortCounters: ...

    def fileno(self) -> int:
        """For `select`; −1 while the bus is away."""

    def drain(self) -> list[Frame]:
        """What has come since the last call, oldest first, at most `MAX_DRAINED`. Never waits, never raises.
        A bus that came back is used again by itself."""

    def close(self) -> None:
        """Give the bus back; a second call does nothing."""


class CanPort(ListeningPort, Protocol):
    """One end on a bus, as a sender and a receiver of frames. Not thread-safe."""

    def prepare(self, identifier: int, length: int) -> bytearray:
        """Return a buffer for a frame that is sent again and again; its payload begins at
        `payload_offset`.
        """

    @property
    def payload_offset(self) -> int:
        """Where the payload of a prepared buffer begins."""

    def send_prepared(self, buffer: bytearray) -> bool:
        """Send a prepared buffer as it is now; False: it is gone (`PortCounters.unsent`). Never waits, never
        raises."""

    def send(self, identifier: int, payload: bytes) -> bool:
        """Send one frame; as `send_prepared`."""


@runtime_checkable
class ClockedPort(Protocol):
    """A port on a bus whose devices have a clock of their own, which the cycle has to follow."""

    @property
    def clock_error_ns(self) -> int | None:
        """How late the latest cycle was by that clock; None: there is none."""
