"""Slaves for the server's process: it asks the process of the cycle, their one master, about them.

A request and its answer are one packet each on a pair of sockets; one transfer at a time, in a thread beside
the cycle. The pair ends with either of the two processes.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress

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


class Transfer(msgspec.Struct, frozen=True, tag=True):
    """An object of an axis's drive; ``payload`` None: it is read."""

    axis: int
    index: int
    subindex: int
    payload: bytes | None = None
    attempts: int = 0


class Look(msgspec.Struct, frozen=True, tag=True):
    """Asks for the states of all slaves."""


class Transferred(msgspec.Struct, frozen=True, tag=True):
    """What was read; with a ``code`` the transfer has failed, as a `DriveError` says."""

    raw: bytes = b""
    code: str = ""
    message: str = ""
    hint: str = ""
    details: dict[str, int] = {}


class SlaveState(msgspec.Struct, frozen=True):
    """One slave of a line.

    Attributes:
        position: on the line, from 0. axis: whose drive it is; None: it is not in the machine file.
        vendor, product, revision, name: of its EEPROM. device_type: 1000h; None: it was not asked.
        state: AL state of a drive, as the supervision has seen it last. statusword, error_code: 6041h and
            603Fh of the latest frame; None: it has none. begun: whether the cycle sends setpoints.
    """

    bus: str
    position: int
    axis: int | None
    vendor: int
    product: int
    revision: int
    name: str
    device_type: int | None = None
    state: int = 0
    statusword: int | None = None
    error_code: int | None = None
    begun: bool = False


class SlaveStates(msgspec.Struct, frozen=True, tag=True):
    """Those of every line, in its order."""

    slaves: tuple[SlaveState, ...]


_REQUESTS: msgspec.msgpack.Decoder[Transfer | Look] = msgspec.msgpack.Decoder(Transfer | Look)
_ANSWERS: msgspec.msgpack.Decoder[Transferred | SlaveStates] = msgspec.msgpack.Decoder(
    Transferred | SlaveStates
)


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
        self._lines: list[Callable[[], Sequence[SlaveState]]] = []
        self._thread = threading.Thread(target=self._run, name="ethercat mailboxes", daemon=True)

    def add(
        self, slaves: Sequence[EthercatSlave], states: Callable[[], Sequence[SlaveState]] = tuple
    ) -> None:
        """Let the drives of a line be asked; ``states``: those of all its slaves now."""
        self._slaves |= {slave.settings.axis: slave for slave in slaves}
        self._lines.append(states)

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

    def _answer(self, asked: Transfer | Look) -> Transferred | SlaveStates:
        if isinstance(asked, Look):
            return SlaveStates(tuple(state for states in self._lines for state in states()))
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
            answer = self._asked(transfer)
        return answer if isinstance(answer, Transferred) else None

    def states(self, patience_s: float) -> tuple[SlaveState, ...] | None:
        """Return every slave; None: a transfer under way takes longer than that, or the process has ended."""
        if not self._lock.acquire(timeout=patience_s):
            return None
        try:
            answer = self._asked(Look())
        finally:
            self._lock.release()
        return answer.slaves if isinstance(answer, SlaveStates) else None

    def _asked(self, request: Transfer | Look) -> Transferred | SlaveStates | None:
        packet = b""
        with suppress(OSError):
            self._socket.send(msgspec.msgpack.encode(request))
            packet = self._socket.recv(LONGEST_PACKET)
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
