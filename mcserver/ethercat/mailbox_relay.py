"""Mailboxes of slaves for the server's process: their one master is the process of the cycle, which is asked.

A request and its answer are one packet each on a pair of sockets; one transfer at a time, in a thread beside
the cycle. The pair ends with either of the two processes.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Sequence

import msgspec

from mcserver.canopen.canopen_errors import DriveError
from mcserver.canopen.settings import DriveSettings
from mcserver.ethercat.slave import MOST_BYTES, EthercatSlave

# The longest object, and what stands around it.
LONGEST_PACKET = MOST_BYTES + 1024
# Of its sockets, so that the longest packet fits [bytes].
BUFFER = 4 * LONGEST_PACKET
# Less than the server waits for the end of the process [s].
JOIN_S = 10.0


class Transfer(msgspec.Struct, frozen=True):
    """An object of an axis's drive; ``payload`` None: it is read."""

    axis: int
    index: int
    subindex: int
    payload: bytes | None = None
    attempts: int = 0


class Transferred(msgspec.Struct, frozen=True):
    """What was read; with a ``code`` the transfer has failed, as a `DriveError` says."""

    raw: bytes = b""
    code: str = ""
    message: str = ""
    hint: str = ""
    details: dict[str, int] = {}


_REQUESTS = msgspec.msgpack.Decoder(Transfer)
_ANSWERS = msgspec.msgpack.Decoder(Transferred)


def socket_pair() -> tuple[socket.socket, socket.socket]:
    """Return the server's end, and that of the process of the cycle."""
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    for end in ends:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER)
    return ends


class MailboxServer:
    """The end of the process of the cycle: made before its buses boot, ended by `close`."""

    def __init__(self, descriptor: int) -> None:
        self._socket = socket.socket(fileno=descriptor)
        self._slaves: dict[int, EthercatSlave] = {}
        self._thread = threading.Thread(target=self._run, name="ethercat mailboxes", daemon=True)

    def add(self, slaves: Sequence[EthercatSlave]) -> None:
        """Let the drives of a line be asked."""
        self._slaves |= {slave.settings.axis: slave for slave in slaves}

    def start(self) -> None:
        """Begin to answer."""
        self._thread.start()

    def close(self) -> None:
        """End behind the transfer under way; a second call does nothing."""
        if self._socket.fileno() < 0:
            return
        self._socket.shutdown(socket.SHUT_RD)
        if self._thread.is_alive():
            self._thread.join(JOIN_S)
        self._socket.close()

    def _run(self) -> None:
        try:
            while packet := self._socket.recv(LONGEST_PACKET):
                self._socket.send(msgspec.msgpack.encode(self._answer(_REQUESTS.decode(packet))))
        except OSError:
            # the server has ended, or this end was closed
            return

    def _answer(self, asked: Transfer) -> Transferred:
        sdo = self._slaves[asked.axis].sdo
        try:
            if asked.payload is None:
                return Transferred(sdo.upload(asked.index, asked.subindex, attempts=asked.attempts))
            sdo.download(asked.index, asked.subindex, asked.payload, attempts=asked.attempts)
            return Transferred()
        except DriveError as error:
            details = {name: each for name, each in error.details.items() if isinstance(each, int)}
            return Transferred(b"", error.code, error.message, error.hint, details)


class MailboxRelay:
    """The server's end; threads of it wait for each other."""

    def __init__(self, end: socket.socket) -> None:
        self._socket = end
        self._lock = threading.Lock()

    def ask(self, transfer: Transfer) -> Transferred | None:
        """Return the answer; None: the process of the cycle has ended."""
        with self._lock:
            try:
                self._socket.send(msgspec.msgpack.encode(transfer))
                packet = self._socket.recv(LONGEST_PACKET)
            except OSError:
                packet = b""
        return _ANSWERS.decode(packet) if packet else None


class RelayedSdo:
    """The mailbox of one drive, as `mcserver.canopen.node_configuration.SdoClient`."""

    def __init__(self, relay: MailboxRelay, drive: DriveSettings) -> None:
        self._relay = relay
        self._drive = drive

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        """Read an object. Raises: as `mcserver.ethercat.slave.MailboxSdo`."""
        return self._transfer(Transfer(self._drive.axis, index, subindex, None, attempts))

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        """Write an object. Raises: as `mcserver.ethercat.slave.MailboxSdo`."""
        self._transfer(Transfer(self._drive.axis, index, subindex, bytes(payload), attempts))

    def _transfer(self, transfer: Transfer) -> bytes:
        answer = self._relay.ask(transfer)
        if answer is None:
            raise self._drive.fault(
                "MC554", "its master, the process of the cycle, has ended", "start the server again"
            )
        if answer.code:
            raise DriveError(
                answer.code, answer.message, answer.hint, axis=self._drive.axis, **answer.details
            )
        return answer.raw
