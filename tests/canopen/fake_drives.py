"""Nodes that are just clever enough to be booted: SDO server, NMT slave, heartbeat; with faults on demand."""

from __future__ import annotations

import select
import struct
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

from canopen.objectdictionary import ODVariable

from mcserver.can.cob import NMT, Function, NmtCommand, NmtState
from mcserver.can.open import open_port
from mcserver.can.port import CanPort
from mcserver.canopen.dictionary import generic_dictionary

ROUND_S = 0.005
NO_OBJECT = 0x0602_0000
DEVICE_TYPE = 0x0002_0192
VENDOR, PRODUCT = 0x1234, 0x402


def fresh_objects(node: int) -> dict[tuple[int, int], bytes]:
    """Every object of the standard's dictionary, 0 of its length."""
    dictionary = generic_dictionary(node)
    objects: dict[tuple[int, int], bytes] = {}
    for index in dictionary:
        entry = dictionary[index]
        for variable in [entry] if isinstance(entry, ODVariable) else entry.values():
            objects[index, variable.subindex] = bytes(len(variable) // 8)
    objects[0x1000, 0] = struct.pack("<I", DEVICE_TYPE)
    objects[0x1018, 1] = struct.pack("<I", VENDOR)
    objects[0x1018, 2] = struct.pack("<I", PRODUCT)
    objects[0x1008, 0] = b"A drive with a long name"
    return objects


@dataclass
class FakeDrive:
    """One node.

    Attributes:
        aborts: by object. unanswered: objects whose transfers get no answer, and how often.
        swallowed: writes that are carried out and not answered, and how often. write_only: not to be read.
        slow: how long a write of an object takes [s].
        muted: says nothing, and does nothing; lost_at: from a write of this object on.
        boots: answers a reset with a boot-up message.
        starts: obeys NMT start. emergency: what it sends as an emergency at each NMT start.
        beats: sends heartbeats. written: in order. statusword: while it has no fault. kept: objects whose
            writes it answers and does not carry out.
        fault: while it has one it stays pre-operational; one that "clears" goes at a rising edge of bit 7 of
            6040h.
    """

    node: int
    objects: dict[tuple[int, int], bytes] = field(default_factory=dict)
    aborts: dict[tuple[int, int], int] = field(default_factory=dict)
    unanswered: dict[tuple[int, int], int] = field(default_factory=dict)
    swallowed: dict[tuple[int, int], int] = field(default_factory=dict)
    write_only: set[tuple[int, int]] = field(default_factory=set)
    slow: dict[tuple[int, int], float] = field(default_factory=dict)
    kept: set[tuple[int, int]] = field(default_factory=set)
    statusword: int = 0x0040
    muted: bool = False
    lost_at: tuple[int, int] | None = None
    boots: bool = True
    starts: bool = True
    emergency: bytes = b""
    beats: bool = True
    fault: Literal["none", "clears", "stays"] = "none"
    state: NmtState = NmtState.PRE_OPERATIONAL
    written: list[tuple[int, int, bytes]] = field(default_factory=list)
    resets: int = 0
    segments: bytes = b""
    download: tuple[int, int] = (0, 0)
    next_beat: float = 0.0

    def __post_init__(self) -> None:
        self.objects = fresh_objects(self.node)

    def lose_configuration(self) -> None:
        """As a reset does."""
        self.objects = fresh_objects(self.node)
        self.state = NmtState.PRE_OPERATIONAL

    def value(self, index: int, subindex: int = 0) -> int:
        return int.from_bytes(self.objects[index, subindex], "little")


class FakeDrives:
    """Several nodes on one connection, in one thread."""

    def __init__(self, address: str, nodes: Sequence[int]) -> None:
        self.drives = {node: FakeDrive(node) for node in nodes}
        self.heard: dict[int, int] = {}
        self._port: CanPort = open_port(address)
        self._lock = threading.Lock()
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="fake drives", daemon=True)
        self._thread.start()

    def __getitem__(self, node: int) -> FakeDrive:
        return self.drives[node]

    def send(self, identifier: int, payload: bytes) -> None:
        """Any frame, as a node that has gone mad would."""
        with self._lock:
            self._port.send(identifier, payload)

    def reboot(self, node: int) -> None:
        """As after a failure of the supply: configuration gone, boot-up message sent."""
        self.drives[node].lose_configuration()
        self.send(Function.HEARTBEAT + node, bytes((NmtState.BOOT_UP,)))

    def close(self) -> None:
        self._stopping.set()
        self._thread.join(5.0)
        self._port.close()

    def _run(self) -> None:
        while not self._stopping.is_set():
            descriptor = self._port.fileno()
            if descriptor >= 0:
                select.select([descriptor], [], [], ROUND_S)
            else:
                self._stopping.wait(ROUND_S)
            with self._lock:
                frames = self._port.drain()
            for identifier, payload in frames:
                self.heard[identifier] = self.heard.get(identifier, 0) + 1
                self._take(identifier, bytes(payload))
            now = time.monotonic()
            for drive in self.drives.values():
                period = drive.value(0x1017) / 1000.0
                if period and drive.beats and not drive.muted and now >= drive.next_beat:
                    drive.next_beat = now + period
                    self.send(Function.HEARTBEAT + drive.node, bytes((drive.state,)))

    def _take(self, identifier: int, payload: bytes) -> None:
        if identifier == NMT:
            for drive in self.drives.values():
                if payload[1] in (0, drive.node) and not drive.muted:
                    self._command(drive, payload[0])
            return
        drive = self.drives.get(identifier - Function.SDO_REQUEST)  # type: ignore[assignment]
        if drive is not None and not drive.muted and drive.state is not NmtState.STOPPED:
            self._serve(drive, payload)

    def _command(self, drive: FakeDrive, command: int) -> None:
        if command in (NmtCommand.RESET_COMMUNICATION, NmtCommand.RESET_NODE):
            drive.resets += 1
            drive.lose_configuration()
            if drive.boots:
                self.send(Function.HEARTBEAT + drive.node, bytes((NmtState.BOOT_UP,)))
        elif command == NmtCommand.START:
            if drive.emergency:
                self.send(Function.EMCY + drive.node, drive.emergency)
            if drive.starts and drive.fault == "none":
                drive.state = NmtState.OPERATIONAL
        elif command == NmtCommand.ENTER_PRE_OPERATIONAL:
            drive.state = NmtState.PRE_OPERATIONAL
        elif command == NmtCommand.STOP:
            drive.state = NmtState.STOPPED

    def _serve(self, drive: FakeDrive, request: bytes) -> None:
        command, index, subindex = struct.unpack_from("<BHB", request)
        place = (index, subindex)
        specifier = command & 0xE0
        if specifier in (0x20, 0x40) and drive.unanswered.get(place, 0) > 0:
            drive.unanswered[place] -= 1
            return
        if specifier in (0x20, 0x40):
            code = drive.aborts.get(place, 0 if place in drive.objects else NO_OBJECT)
            if code:
                self._answer(drive, struct.pack("<BHBI", 0x80, index, subindex, code))
                return
        if specifier == 0x40 and place in drive.write_only:
            self._answer(drive, struct.pack("<BHBI", 0x80, index, subindex, 0x0601_0001))
            return
        head = struct.pack("<HB", index, subindex)
        if specifier == 0x40:
            value = drive.objects[place]
            if place == (0x6041, 0):
                value = struct.pack("<H", drive.statusword if drive.fault == "none" else 0x0008)
            if 0 < len(value) <= 4:
                self._answer(drive, bytes((0x43 | (4 - len(value)) << 2,)) + head + value.ljust(4, b"\0"))
            else:
                drive.segments = value
                self._answer(drive, b"\x41" + head + struct.pack("<I", len(value)))
        elif specifier == 0x60:
            part, drive.segments = drive.segments[:7], drive.segments[7:]
            flags = command & 0x10 | (7 - len(part)) << 1 | (not drive.segments)
            self._answer(drive, bytes((flags,)) + part.ljust(7, b"\0"))
        elif specifier == 0x20 and command & 2:
            self._write(drive, place, request[4 : 8 - (command >> 2 & 3)])
            if drive.muted:
                return
            self._stopping.wait(drive.slow.get(place, 0.0))
            if drive.swallowed.get(place, 0) > 0:
                drive.swallowed[place] -= 1
                return
            self._answer(drive, b"\x60" + head + bytes(4))
        elif specifier == 0x20:
            drive.download, drive.segments = place, b""
            self._answer(drive, b"\x60" + head + bytes(4))
        elif specifier == 0x00:
            drive.segments += request[1 : 8 - (command >> 1 & 7)]
            if command & 1:
                self._write(drive, drive.download, drive.segments)
            self._answer(drive, bytes((0x20 | command & 0x10,)) + bytes(7))

    def _write(self, drive: FakeDrive, place: tuple[int, int], value: bytes) -> None:
        rises = place == (0x6040, 0) and value[0] & 0x80 and not drive.value(0x6040) & 0x80
        if rises and drive.fault == "clears":
            drive.fault = "none"
        if place not in drive.kept:
            drive.objects[place] = value
        drive.written.append((*place, value))
        drive.muted = drive.muted or place == drive.lost_at

    def _answer(self, drive: FakeDrive, payload: bytes) -> None:
        self.send(Function.SDO_RESPONSE + drive.node, payload)
