"""Slaves on a network interface, in the place of a line of real ones."""

from __future__ import annotations

import math
import select
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
    """Return how long a frame has waited, by the kernel's stamp; 0 without one."""
    for level, kind, stamp in said:
        if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS:
            seconds, nanoseconds = _TIMESPEC.unpack(stamp)
            stamped: float = seconds + nanoseconds * 1e-9
            return time.time() - stamped
    return 0.0


class EthercatLine:
    """Raw sockets on the interfaces behind which a master sends frames: one, or both ends of a ring.

    Raises:
        RuntimeFault: MC424 there is no such interface, or raw sockets are not allowed.
    """

    def __init__(self, interfaces: Sequence[str]) -> None:
        self.counters = PortCounters()
        self._ends: list[socket.socket] = []
        self._ready = select.epoll()
        for interface in interfaces:
            try:
                end = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETHERTYPE))
                self._ends.append(end)
                end.bind((interface, ETHERTYPE))
                end.setblocking(False)
                end.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
            except OSError as error:
                self.close()
                raise RuntimeFault(
                    "MC424",
                    f"the interface {interface} cannot be opened for EtherCAT: {error.strerror or error}",
                    "raw sockets need root or CAP_NET_RAW; `ip link` lists interfaces",
                ) from error
            self._ready.register(end.fileno(), select.EPOLLIN)

    @property
    def is_ring(self) -> bool:
        """Whether the last slave is connected to the master, too."""
        return len(self._ends) > 1

    def fileno(self) -> int:
        return self._ready.fileno()

    def drain(self) -> list[tuple[int, bytes]]:
        """Return what a master has sent since the last call, with the end at which it came: 0 or 1."""
        frames: list[tuple[int, bytes]] = []
        for number, end in enumerate(self._ends):
            for _ in range(MAX_DRAINED):
                try:
                    frame, said, _, (_, _, kind, *_) = end.recvmsg(_LONGEST_FRAME, _SAID_BYTES)
                except BlockingIOError:
                    break
                except OSError:
                    self.counters.errors += 1
                    break
                if kind != socket.PACKET_OUTGOING and _age_s(said) < STALE_S:
                    frames.append((number, frame))
        return frames

    def send(self, end: int, frame: bytes) -> None:
        """Send a frame back at an end; where it finds no room it is gone."""
        try:
            self._ends[end].send(frame)
        except OSError:
            self.counters.unsent += 1

    def close(self) -> None:
        self._ready.close()
        for end in self._ends:
            end.close()


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

    def serve(self, frames: Sequence[tuple[int, bytes]]) -> None:
        """Let frames pass the drives, and send them back."""
        for end, frame in frames:
            self.poll(time.monotonic())
            if self._loses():
                continue
            reached, out = self._way(end)
            passed = pass_through(frame, reached) if out is not None else None
            if out is not None and passed is not None:
                self.port.send(out, passed)
        self.poll(time.monotonic())

    def _loses(self) -> bool:
        for node in self.nodes:
            if node.frames_lost:
                node.frames_lost -= 1
                return True
        return False

    def _way(self, end: int) -> tuple[list[SlaveController], int | None]:
        """Which slaves process a frame that comes at an end, and at which end it leaves; None: at none.

        Slaves process what comes from the side of the first one, and pass on what comes from the other. Where
        a cable is open a frame turns round, and is then processed on its way back to the last slave.
        """
        nodes = self.nodes
        links = [
            (at < len(nodes) and (nodes[at].cut or not nodes[at].plugged))
            or (at > 0 and not nodes[at - 1].plugged)
            for at in range(len(nodes) + 1)
        ]
        links[-1] = links[-1] or not self.port.is_ring
        slaves = [node.controller for node in nodes]
        for at, slave in enumerate(slaves):
            slave.first, slave.last = links[at], links[at + 1]
        opened = [at for at, is_open in enumerate(links) if is_open]
        if end == 0:
            if links[0]:
                return [], None
            return (slaves[: opened[0]], 0) if opened else (slaves, 1)
        if links[-1]:
            return [], None
        return (slaves[opened[-1] :], 1) if opened else ([], 0)
