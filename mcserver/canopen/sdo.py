"""SDO transfers with one node: one at a time, bounded in time and size; a write is never repeated blindly."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from can import CanError
from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import ReadableStream, SdoClient, WritableStream
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from mcserver.can.cob import Function
from mcserver.canopen.abort_codes import abort_text, refused, unanswered
from mcserver.canopen.canopen_errors import DriveError, object_text
from mcserver.canopen.network import PortNetwork
from mcserver.canopen.settings import STORING, DriveSettings

FRAME = 8
MAX_BYTES = 64 * 1024
# More than a transfer can be behind: what comes beside it is nobody's answer.
MAX_WAITING_RESPONSES = 32
# Aborts that may go by themselves: the server's time-out, and no memory.
_PASSING = frozenset({0x0504_0000, 0x0504_0005})
_ABORT = 0x80
# Server command specifiers of answers that name their object: initiate upload and download, abort.
_NAMED = frozenset({0x40, 0x60, 0x80})


class _Download(WritableStream):
    """One download; it leaves nothing to its destructor, where the original sends a closing segment."""

    def __init__(self, client: SdoClient, index: int, subindex: int, payload: bytes) -> None:
        super().__init__(client, index, subindex, size=len(payload))  # type: ignore[no-untyped-call]
        self._payload = payload

    def run(self) -> None:
        at = 0
        while at < len(self._payload):
            at += super().write(self._payload[at : at + 7])  # type: ignore[no-untyped-call]

    def close(self) -> None:
        io.RawIOBase.close(self)


class NodeSdo:
    """The client of one node's SDO server.

    Args:
        drive: the node's first axis.
    """

    def __init__(self, network: PortNetwork, drive: DriveSettings) -> None:
        self._drive = drive
        self._times = times = drive.sdo
        self._lock = threading.Lock()
        self._expected: tuple[int, int] | None = None
        # segments carry no name: until a transfer is under way they belong to an earlier one
        self._in_segments = False
        # an empty dictionary: lengths are the caller's business
        response = Function.SDO_RESPONSE + drive.node
        self._client = SdoClient(Function.SDO_REQUEST + drive.node, response, ObjectDictionary())
        self._client.RESPONSE_TIMEOUT = times.response_s
        self._client.network = network
        self._network = network
        network.handle(response, self._on_response)

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        """Read an object; where no answer comes, ``attempts`` times (0: as configured).

        Raises:
            DriveError: MC553 the drive refuses, MC554 it does not answer in time.
        """
        attempts = attempts or self._times.attempts
        with self._alone(index, subindex):
            for remaining in range(attempts - 1, -1, -1):
                try:
                    return self._read(index, subindex)
                except SdoAbortedError as error:
                    if not (error.code in _PASSING and remaining):
                        raise refused(self._drive, index, subindex, "read", error.code) from None
                except (SdoCommunicationError, CanError) as error:
                    if not remaining:
                        raise self._silent(index, subindex, "read", str(error), attempts) from None
        raise AssertionError("an attempt returns or raises")

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        """Write an object; ``payload`` is not empty.

        A write whose answer stays out may have been carried out: it is repeated only where the object,
        read back, does not hold the value. A store (1010h, 1011h) and a command are never repeated.

        Raises:
            DriveError: MC553, MC554.
        """
        if not payload:
            raise ValueError("nothing to write")
        attempts = attempts or self._times.attempts
        with self._alone(index, subindex):
            for remaining in range(attempts - 1, -1, -1):
                try:
                    self._write(index, subindex, payload)
                    return
                except SdoAbortedError as error:
                    if not (error.code in _PASSING and remaining) or index in STORING:
                        raise refused(self._drive, index, subindex, "written", error.code) from None
                except (SdoCommunicationError, CanError) as error:
                    if index in STORING:
                        raise self._stored_or_not(index, subindex, str(error)) from None
                    if self._holds(index, subindex, payload):
                        return
                    if not remaining:
                        raise self._silent(index, subindex, "written", str(error), attempts) from None

    # ------------------------------------------------------------ one transfer

    def _read(self, index: int, subindex: int) -> bytes:
        self._in_segments = False
        stream = ReadableStream(self._client, index, subindex)
        deadline = time.monotonic() + self._times.transfer_s
        received = bytearray()
        while True:
            segment = stream.read(7)
            received += segment
            if not segment:
                return bytes(received)
            if len(received) > MAX_BYTES or time.monotonic() > deadline:
                self._client.abort()
                raise SdoCommunicationError(
                    f"more than {MAX_BYTES} bytes, or longer than {self._times.transfer_s:g} s"
                )

    def _write(self, index: int, subindex: int, payload: bytes) -> None:
        self._in_segments = False
        client = self._client
        client.RESPONSE_TIMEOUT = self._times.store_s if index in STORING else self._times.response_s
        try:
            _Download(client, index, subindex, payload).run()
        finally:
            client.RESPONSE_TIMEOUT = self._times.response_s

    def _holds(self, index: int, subindex: int, payload: bytes) -> bool:
        """Read back a write whose answer has stayed out.

        Raises:
            DriveError: MC554 the object cannot be read back, so nobody knows whether it was written.
        """
        why = ""
        for _ in range(self._times.attempts):
            try:
                return self._read(index, subindex) == payload
            except SdoAbortedError as error:
                why = abort_text(error.code)
                if error.code not in _PASSING:
                    break
            except (SdoCommunicationError, CanError) as error:
                # it may be the late answer to the write: the next one is to the reading
                why = str(error)
        raise self._unknown(index, subindex, why)

    # ------------------------------------------------------------ inside

    @contextmanager
    def _alone(self, index: int, subindex: int) -> Iterator[None]:
        if not self._lock.acquire(timeout=self._times.queue_s):
            raise self._drive.fault(
                "MC554",
                f"{object_text(index, subindex)} waits behind another transfer for more than "
                f"{self._times.queue_s:g} s",
                "try again",
            )
        try:
            self._expected = (index, subindex)
            with self._network.awaited():
                yield
        finally:
            self._expected = None
            self._lock.release()

    def _on_response(self, payload: bytes) -> None:
        """Take the answers to the transfer under way; late ones to an earlier transfer are left out."""
        expected = self._expected
        if len(payload) != FRAME or expected is None:
            return
        specifier = payload[0] & 0xE0
        if specifier in _NAMED:
            named = (int.from_bytes(payload[1:3], "little"), payload[3])
            if named != expected and not (specifier == _ABORT and named == (0, 0)):
                return
            self._in_segments = True
        elif not self._in_segments:
            return
        responses = self._client.responses
        if responses.qsize() < MAX_WAITING_RESPONSES:
            responses.put_nowait(payload)

    def _silent(self, index: int, subindex: int, verb: str, why: str, attempts: int) -> DriveError:
        return unanswered(
            self._drive,
            index,
            subindex,
            f"could not be {verb} in {attempts} attempts of {self._times.response_s:g} s: {why}",
            "check the drive's power and the bus (`mcctl drives` shows who is there); a slow drive needs a "
            "longer sdo_timeout_ms",
        )

    def _unknown(self, index: int, subindex: int, why: str) -> DriveError:
        return unanswered(
            self._drive,
            index,
            subindex,
            "was sent to the drive once, no answer came, and it cannot be read back to see whether it was "
            f"written: {why}",
            "see what the drive does before it is written again; a slow drive needs a longer sdo_timeout_ms",
        )

    def _stored_or_not(self, index: int, subindex: int, why: str) -> DriveError:
        return unanswered(
            self._drive,
            index,
            subindex,
            f"was sent once and not answered within {self._times.store_s:g} s: {why}; the drive may still be "
            "storing",
            "leave its power on, read the object again in a moment, and give a longer sdo_store_timeout_s",
        )
