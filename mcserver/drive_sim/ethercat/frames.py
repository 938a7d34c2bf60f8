"""EtherCAT frames and what a slave controller does with each datagram (ETG.1000.4, 5.4)."""

from __future__ import annotations

import enum
import struct
from collections.abc import Sequence

from mcserver.drive_sim.ethercat.controller import SlaveController

ETHERTYPE = 0x88A4
ETHERNET_HEADER = 14
_FRAME_HEADER = struct.Struct("<H")
_DATAGRAM = struct.Struct("<BBHHHH")
_WORKING_COUNTER = struct.Struct("<H")
_LENGTH, _MORE = 0x7FF, 0x8000
_EVERYONE_ADDED = 0xFFFF


class Command(enum.IntEnum):
    """Commands of datagrams."""

    NOP = 0
    APRD = 1
    APWR = 2
    APRW = 3
    FPRD = 4
    FPWR = 5
    FPRW = 6
    BRD = 7
    BWR = 8
    BRW = 9
    LRD = 10
    LWR = 11
    LRW = 12
    ARMW = 13
    FRMW = 14


_BY_POSITION = frozenset({Command.APRD, Command.APWR, Command.APRW})
_BY_ADDRESS = frozenset({Command.FPRD, Command.FPWR, Command.FPRW})
_TO_ALL = frozenset({Command.BRD, Command.BWR, Command.BRW})
_LOGICAL = frozenset({Command.LRD, Command.LWR, Command.LRW})
_MULTIPLE = frozenset({Command.ARMW, Command.FRMW})
_READS = frozenset({Command.APRD, Command.APRW, Command.FPRD, Command.FPRW, Command.BRD, Command.BRW})
_WRITES = frozenset({Command.APWR, Command.APRW, Command.FPWR, Command.FPRW, Command.BWR, Command.BRW})


def pass_through(frame: bytes, slaves: Sequence[SlaveController]) -> bytes | None:
    """Return the frame as it comes back from the last slave; None: it is no EtherCAT frame.

    Args:
        frame: with its Ethernet header. slaves: in the order of the line.
    """
    if len(frame) < ETHERNET_HEADER + _FRAME_HEADER.size:
        return None
    if int.from_bytes(frame[12:14], "big") != ETHERTYPE:
        return None
    (header,) = _FRAME_HEADER.unpack_from(frame, ETHERNET_HEADER)
    at = ETHERNET_HEADER + _FRAME_HEADER.size
    end = min(len(frame), at + (header & _LENGTH))
    if header >> 12 != 1:
        return None
    passed = bytearray(frame)
    # slaves mark frames that have been processed by the sender's locally administered address
    passed[6] |= 0x02
    more = True
    while more and at + _DATAGRAM.size + _WORKING_COUNTER.size <= end:
        command, _, low, high, length_word, _ = _DATAGRAM.unpack_from(passed, at)
        length, more = length_word & _LENGTH, bool(length_word & _MORE)
        first = at + _DATAGRAM.size
        if first + length + _WORKING_COUNTER.size > end:
            return None
        payload = memoryview(passed)[first : first + length]
        (counted,) = _WORKING_COUNTER.unpack_from(passed, first + length)
        for slave in slaves:
            low, added = _at_slave(command, low, high, payload, slave)
            counted += added
        struct.pack_into("<H", passed, at + 2, low)
        _WORKING_COUNTER.pack_into(passed, first + length, counted & 0xFFFF)
        at = first + length + _WORKING_COUNTER.size
    return bytes(passed)


def _at_slave(
    command: int, low: int, high: int, payload: memoryview, slave: SlaveController
) -> tuple[int, int]:
    """Let a datagram pass one slave; return its lower address behind it and what the counter gains."""
    if command in _LOGICAL:
        reads, writes = command != Command.LWR, command != Command.LRD
        return low, slave.logical(low | high << 16, payload, reads=reads, writes=writes)
    if command in _BY_POSITION or command == Command.ARMW:
        addressed, low = low == 0, (low + 1) & _EVERYONE_ADDED
    elif command in _TO_ALL:
        addressed, low = True, (low + 1) & _EVERYONE_ADDED
    elif command in _BY_ADDRESS or command == Command.FRMW:
        addressed = low == slave.station_address
    else:
        return low, 0
    if command in _MULTIPLE:
        # the addressed one is read, all others are written
        return low, slave.read(high, payload) if addressed else slave.write(high, bytes(payload))
    if not addressed:
        return low, 0
    written = bytes(payload) if command in _WRITES else None
    added = 0
    if command in _READS:
        added += slave.read(high, payload, together=command in _TO_ALL)
    if written is not None:
        gained = slave.write(high, written)
        added += 2 * gained if command in _READS else gained
    return low, added
