"""CoE in the mailbox of a slave: an SDO server and emergency messages (ETG.1000.6, 5.6)."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from typing import Protocol

from mcserver.drive_sim.sdo_abort import Abort, SdoAbort

_HEADER = struct.Struct("<HHBB")
_COE_TYPE = 0x03
_EMERGENCY, _REQUEST, _RESPONSE = 1, 2, 3
_SDO = struct.Struct("<BHB")
# Of a download and an upload, their segments, and of an abort, in bits 5 to 7.
_DOWNLOAD_SEGMENT, _DOWNLOAD, _UPLOAD, _UPLOAD_SEGMENT, _ABORT = 0x00, 0x20, 0x40, 0x60, 0x80
_COMPLETE = 0x10
# Replies that wait to be fetched.
MAX_REPLIES = 16
MAX_DOWNLOAD = 64 * 1024
_SEGMENT_HEAD = 9


class Objects(Protocol):
    """An object dictionary as SDO reaches it."""

    def read(self, index: int, subindex: int) -> bytes: ...

    def write(self, index: int, subindex: int, raw: bytes) -> None: ...


class CoeMailbox:
    """Answers SDO requests out of a dictionary.

    Args:
        size: bytes of a mailbox. changed: called after a value was written.

    Attributes:
        refusals: aborts on demand, by (index, subindex or None). held: nothing is answered.
    """

    def __init__(self, objects: Objects, size: int, changed: Callable[[], None]) -> None:
        self._objects = objects
        self._size = size
        self._changed = changed
        self.refusals: dict[tuple[int, int | None], int] = {}
        self.held = False
        self._replies: deque[bytes] = deque(maxlen=MAX_REPLIES)
        self._counter = self._taken = 0
        self._upload = b""
        self._download: tuple[int, int, bytearray, int] | None = None

    def reset(self) -> None:
        """Forget what is under way."""
        self._replies.clear()
        self._taken = 0
        self._upload, self._download = b"", None

    def request(self, message: bytes) -> None:
        """Take a message of the master; one that is no CoE SDO request is left out."""
        if len(message) < _HEADER.size + 10:
            return
        _, _, _, kind = _HEADER.unpack_from(message)
        (service,) = struct.unpack_from("<H", message, _HEADER.size)
        if kind & 0x0F != _COE_TYPE or service >> 12 != _REQUEST:
            return
        counter = kind >> 4 & 0x07
        if counter and counter == self._taken:
            # sent again, since the frame with it was lost on its way back
            return
        self._taken = counter
        body = message[_HEADER.size + 2 :]
        command, index, subindex = _SDO.unpack_from(body)
        try:
            answer = self._obey(command, index, subindex, body)
        except SdoAbort as abort:
            self._download = None
            answer = _SDO.pack(_ABORT, index, subindex) + struct.pack("<I", abort.code)
        if answer:
            self._put(_RESPONSE if answer[0] != _ABORT else _REQUEST, answer)

    def reply(self) -> bytes | None:
        """Return the next message for the master."""
        return self._replies.popleft() if self._replies and not self.held else None

    def emergency(self, payload: bytes) -> None:
        """Tell an emergency: the 8 bytes of CiA 301."""
        self._put(_EMERGENCY, payload)

    def _put(self, service: int, body: bytes) -> None:
        self._counter = self._counter % 7 + 1
        body = struct.pack("<H", service << 12) + body
        self._replies.append(_HEADER.pack(len(body), 0, 0, _COE_TYPE | self._counter << 4) + body)

    def _obey(self, command: int, index: int, subindex: int, body: bytes) -> bytes:
        kind = command & 0xE0
        if kind == _ABORT:
            self._download, self._upload = None, b""
            return b""
        if kind == _UPLOAD_SEGMENT:
            return self._next_segment(command)
        if kind == _DOWNLOAD_SEGMENT:
            return self._take_segment(command, body)
        if command & _COMPLETE and kind in (_UPLOAD, _DOWNLOAD):
            raise SdoAbort(Abort.UNSUPPORTED_ACCESS)
        for which in (subindex, None):
            code = self.refusals.get((index, which))
            if code is not None:
                raise SdoAbort(code)
        if kind == _UPLOAD:
            return self._begin_upload(index, subindex)
        if kind == _DOWNLOAD:
            return self._begin_download(command, index, subindex, body)
        raise SdoAbort(Abort.COMMAND_SPECIFIER)

    def _begin_upload(self, index: int, subindex: int) -> bytes:
        value = self._objects.read(index, subindex)
        if 0 < len(value) <= 4:
            command = _UPLOAD | 0x03 | (4 - len(value)) << 2
            return _SDO.pack(command, index, subindex) + value.ljust(4, b"\x00")
        room = self._size - _HEADER.size - 2 - 8
        self._upload = value[room:]
        return _SDO.pack(_UPLOAD | 0x01, index, subindex) + struct.pack("<I", len(value)) + value[:room]

    def _next_segment(self, command: int) -> bytes:
        room = self._size - _SEGMENT_HEAD
        part, self._upload = self._upload[:room], self._upload[room:]
        unused = max(0, 7 - len(part))
        head = (command & 0x10) | unused << 1 | (not self._upload)
        return bytes((head,)) + part.ljust(7, b"\x00")

    def _begin_download(self, command: int, index: int, subindex: int, body: bytes) -> bytes:
        if command & 0x02:
            size = 4 - (command >> 2 & 3) if command & 0x01 else 4
            self._write(index, subindex, body[4 : 4 + size])
        else:
            (size,) = struct.unpack_from("<I", body, 4)
            if size > MAX_DOWNLOAD:
                raise SdoAbort(Abort.OUT_OF_MEMORY)
            # a mailbox is padded behind its message
            taken = bytearray(body[8 : 8 + size][: self._size - _HEADER.size - 2 - 8])
            if len(taken) >= size:
                self._write(index, subindex, bytes(taken))
            else:
                self._download = index, subindex, taken, size
        return _SDO.pack(0x60, index, subindex) + bytes(4)

    def _take_segment(self, command: int, body: bytes) -> bytes:
        if self._download is None:
            raise SdoAbort(Abort.COMMAND_SPECIFIER)
        index, subindex, taken, size = self._download
        taken += body[1 : self._size - _HEADER.size - 2][: size - len(taken)]
        if command & 0x01:
            self._download = None
            if len(taken) != size:
                raise SdoAbort(Abort.LENGTH_TOO_LOW)
            self._write(index, subindex, bytes(taken))
        return bytes((0x20 | command & 0x10,)) + bytes(7)

    def _write(self, index: int, subindex: int, raw: bytes) -> None:
        self._objects.write(index, subindex, raw)
        self._changed()
