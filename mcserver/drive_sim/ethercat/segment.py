"""Slaves on a network interface, in the place of a line of real ones."""

from __future__ import annotations

import math
import socket
import struct
import time
from collections.abc import Sequence

from mcserver.can.port import PortCounters
from mcserver.drive_sim.ethercat.controller import SlaveController
from mcserver.drive_sim.ethercat.drive import EthercatDrive
from mcserver.drive_sim.ethercat.frames import ETHERTYPE, pass_through
from mcserver.errors import RuntimeFault

# Frames that are taken in one go.
MAX_DRAINED = 64
_LONGEST_FRAME = 1600
# Real slaves pass a frame on within microseconds, or it is lost: a busy computer must not make it come back
# when its number stands for another one already [s].
STALE_S = 0.02
_SO_TIMESTAMPNS, _SAID_BYTES = 35, 64
_TIMESPEC = struct.Struct("qq")


def _age_s(said: list[tuple[int, int, bytes]]) -> float:
    """How long a frame has waited, by the kernel's stamp; 0 without one."""
    for level, kind, stamp in said:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS:
            seconds, nanoseconds = _TIMESPEC.unpack(stamp)
            stamped: float = seconds + nanoseconds * 1e-9
            return time.time() - stamped
    return 0.0


class EthercatLine:
    """A raw socket on the interface behind which a master sends frames.

    Raises:
        RuntimeFault: MC424 there is no such interface, or raw sockets are not allowed.
    """

    def __init__(self, interface: str) -> None:
        self.counters = PortCounters()
        try:
            self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
            self._socket.bind((interface, ETHERTYPE))
            self._socket.setblocking(False)
            self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        except OSError as error:
            raise RuntimeFault(
                "MC424",
                f"the interface {interface} cannot be opened for EtherCAT: {error.strerror or error}",
                "raw sockets need root or CAP_NET_RAW; `ip link` lists interfaces",
            ) from error

    def fileno(self) -> int:
        return self._socket.fileno()

    def drain(self) -> list[bytes]:
        """What a master has sent since the last call."""
        frames: list[bytes] = []
        while len(frames) < MAX_DRAINED:
            try:
                frame, said, _, (_, _, kind, *_) = self._socket.recvmsg(_LONGEST_FRAME, _SAID_BYTES)
            except BlockingIOError:
                break
            except OSError:
                self.counters.errors += 1
                break
            if kind != socket.PACKET_OUTGOING and _age_s(said) < STALE_S:
                frames.append(frame)
        return frames

    def send(self, frame: bytes) -> None:
        """Send a frame back; where it finds no room it is gone."""
        try:
            self._socket.send(frame)
        except OSError:
            self.counters.unsent += 1

    def close(self) -> None:
        self._socket.close()


class EthercatSegment:
    """The drives of one line, first the one nearest to the master.

    Attributes:
        name: as the machine file has it. nodes: in the order of the line.
    """

    def __init__(self, name: str, port: EthercatLine) -> None:
        self.name = name
        self.port = port
        self.nodes: list[EthercatDrive] = []

    @property
    def wake(self) -> float:
        return min((node.wake for node in self.nodes), default=math.inf)

    def poll(self, now: float) -> None:
        for node in self.nodes:
            if node.wake <= now:
                node.poll(now)
            node.controller.watch()

    def serve(self, frames: Sequence[bytes]) -> None:
        """Let frames pass the drives, and send them back."""
        for frame in frames:
            self.poll(time.monotonic())
            if self._loses():
                continue
            passed = pass_through(frame, self._on_line())
            if passed is not None:
                self.port.send(passed)
        self.poll(time.monotonic())

    def _loses(self) -> bool:
        for node in self.nodes:
            if node.frames_lost:
                node.frames_lost -= 1
                return True
        return False

    def _on_line(self) -> list[SlaveController]:
        found = []
        for node in self.nodes:
            if not node.plugged:
                # behind a cable that is out nothing is reached
                break
            node.controller.last = False
            found.append(node.controller)
        if found:
            found[-1].last = True
        return found
