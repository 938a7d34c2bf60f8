"""SDO transfers with one node: one at a time, tried again, bounded in time and size."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from can import CanError
from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import ReadableStream, SdoClient, WritableStream
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from mcserver.can.cob import Function
from mcserver.canopen.abort_codes import abort_remedy, abort_text
from mcserver.canopen.canopen_errors import DriveError, object_text
from mcserver.canopen.network import PortNetwork

T = TypeVar("T")

FRAME = 8
MAX_BYTES = 64 * 1024
# More than a transfer can be behind: what comes beside it is nobody's answer.
MAX_WAITING_RESPONSES = 32
# Aborts that may go by themselves: the server's time-out, and no memory.
_PASSING = frozenset({0x0504_0000, 0x0504_0005})
_ABORT = 0x80
# Server command specifiers of answers that name their object: initiate upload and download, abort.
_NAMED = frozenset({0x40, 0x60, 0x80})


@dataclass(frozen=True)
class SdoTimes:
    """How long a node may take.

    Attributes:
        response_s: for one answer. attempts: whole transfers. transfer_s: for a long one.
        queue_s: behind another transfer with the same node.
    """

    response_s: float = 0.3
    attempts: int = 3
    transfer_s: float = 5.0
    queue_s: float = 2.0


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
        name: of the node for messages, such as ``axis 2, node 3 on can0``.
        axis: of the machine.
    """

    def __init__(self, network: PortNetwork, node: int, name: str, axis: int, times: SdoTimes) -> None:
        self._name = name
        self._axis = axis
        self._times = times
        self._lock = threading.Lock()
        self._expected: tuple[int, int] | None = None
        # an empty dictionary: lengths are the caller's business
        self._client = SdoClient(
            Function.SDO_REQUEST + node, Function.SDO_RESPONSE + node, ObjectDictionary()
        )
        self._client.RESPONSE_TIMEOUT = times.response_s
        self._client.network = network
        self._network = network
        network.handle(Function.SDO_RESPONSE + node, self._on_response)

    def upload(self, index: int, subindex: int, *, attempts: int = 0) -> bytes:
        """Reads an object.

        Raises:
            DriveError: MC553 the drive refuses, MC554 it does not answer in time.
        """

        def transfer() -> bytes:
            stream = ReadableStream(self._client, index, subindex)
            deadline = time.monotonic() + self._times.transfer_s
            found = bytearray()
            while True:
                segment = stream.read(7)
                found += segment
                if not segment:
                    return bytes(found)
                if len(found) > MAX_BYTES or time.monotonic() > deadline:
                    self._client.abort()
                    raise SdoCommunicationError(
                        f"more than {MAX_BYTES} bytes, or longer than {self._times.transfer_s:g} s"
                    )

        return self._attempt(index, subindex, "read", transfer, attempts)

    def download(self, index: int, subindex: int, payload: bytes, *, attempts: int = 0) -> None:
        """Writes an object; ``payload`` is not empty.

        Raises:
            DriveError: MC553, MC554.
        """
        if not payload:
            raise ValueError("nothing to write")

        def transfer() -> None:
            _Download(self._client, index, subindex, payload).run()

        self._attempt(index, subindex, "written", transfer, attempts)

    # ------------------------------------------------------------ inside

    def _attempt(self, index: int, subindex: int, verb: str, transfer: Callable[[], T], attempts: int) -> T:
        attempts = attempts or self._times.attempts
        with self._alone(index, subindex):
            for left in range(attempts - 1, -1, -1):
                try:
                    return transfer()
                except SdoAbortedError as error:
                    if error.code in _PASSING and left:
                        continue
                    code = error.code
                    raise self._refused(index, subindex, verb, code) from None
                except (SdoCommunicationError, CanError) as error:
                    if left:
                        continue
                    raise self._silent(index, subindex, verb, str(error), attempts) from None
        raise AssertionError("an attempt returns or raises")

    @contextmanager
    def _alone(self, index: int, subindex: int) -> Iterator[None]:
        if not self._lock.acquire(timeout=self._times.queue_s):
            raise DriveError(
                "MC554",
                f"{self._name}: {object_text(index, subindex)} waits behind another transfer for more than "
                f"{self._times.queue_s:g} s",
                "try again",
                axis=self._axis,
            )
        try:
            self._expected = (index, subindex)
            with self._network.awaited():
                yield
        finally:
            self._expected = None
            self._lock.release()

    def _on_response(self, payload: bytes) -> None:
        """Takes the answers to the transfer under way; late ones to an earlier transfer are left out."""
        expected = self._expected
        if len(payload) != FRAME or expected is None:
            return
        specifier = payload[0] & 0xE0
        if specifier in _NAMED:
            named = (int.from_bytes(payload[1:3], "little"), payload[3])
            if named != expected and not (specifier == _ABORT and named == (0, 0)):
                return
        responses = self._client.responses
        if responses.qsize() < MAX_WAITING_RESPONSES:
            responses.put_nowait(payload)

    def _refused(self, index: int, subindex: int, verb: str, code: int) -> DriveError:
        return DriveError(
            "MC553",
            f"{self._name}: {object_text(index, subindex)} cannot be {verb}: {abort_text(code)}",
            abort_remedy(code),
            axis=self._axis,
            index=index,
            subindex=subindex,
            abort_code=code,
        )

    def _silent(self, index: int, subindex: int, verb: str, why: str, attempts: int) -> DriveError:
        return DriveError(
            "MC554",
            f"{self._name}: {object_text(index, subindex)} could not be {verb} in {attempts} attempts of "
            f"{self._times.response_s:g} s: {why}",
            "check the drive's power and the bus; `mcctl drives` shows who is there",
            axis=self._axis,
            index=index,
            subindex=subindex,
        )
