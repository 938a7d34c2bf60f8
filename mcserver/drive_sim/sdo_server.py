"""An SDO server: expedited and segmented transfers (CiA 301, 7.2.4.3); one transfer at a time."""

from __future__ import annotations

import enum
import struct
from collections.abc import Callable

from mcserver.drive_sim.dictionary import ObjectStore
from mcserver.drive_sim.sdo_abort import Abort, SdoAbort

MULTIPLEXER = struct.Struct("<BHB")
ABORT_MESSAGE = struct.Struct("<BHBI")
ABORTED = 0x80
TOGGLE = 0x10
# Longest value that a segmented download may have.
MAX_DOWNLOAD = 4096
SEGMENT = 7


class Request(enum.IntEnum):
    """Client command specifiers, shifted to their place in byte 0."""

    DOWNLOAD_SEGMENT = 0x00
    DOWNLOAD = 0x20
    UPLOAD = 0x40
    UPLOAD_SEGMENT = 0x60
    ABORT = 0x80


class SdoServer:
    """Answers requests out of a dictionary; `refusals` are aborts on demand, by (index, subindex or None)."""

    def __init__(self, store: ObjectStore, answer: Callable[[bytes], None]) -> None:
        self._store = store
        self._answer = answer
        self.refusals: dict[tuple[int, int | None], int] = {}
        self._forget()

    def _forget(self) -> None:
        self._index = self._subindex = 0
        self._upload: bytes | None = None
        self._download: bytearray | None = None
        self._size: int | None = None
        self._toggle = 0

    def reset(self) -> None:
        """Forget a transfer that has begun."""
        self._forget()

    def request(self, message: bytes) -> None:
        """One message of a client; answers at once. Messages that are no 8 bytes are left out."""
        if len(message) != 8:
            return
        command = message[0]
        if command & 0xE0 == Request.ABORT:
            self._forget()
            return
        try:
            self._obey(command, message)
        except SdoAbort as abort:
            index, subindex = self._index, self._subindex
            self._forget()
            self._answer(ABORT_MESSAGE.pack(ABORTED, index, subindex, abort.code))

    def _obey(self, command: int, message: bytes) -> None:
        kind = command & 0xE0
        if kind == Request.UPLOAD:
            self._begin(message)
            self._begin_upload()
        elif kind == Request.DOWNLOAD:
            self._begin(message)
            self._begin_download(command, message)
        elif kind == Request.UPLOAD_SEGMENT and self._upload is not None:
            self._check_toggle(command)
            self._upload_segment()
        elif kind == Request.DOWNLOAD_SEGMENT and self._download is not None:
            self._check_toggle(command)
            self._download_segment(command, message)
        else:
            if kind not in (Request.UPLOAD_SEGMENT, Request.DOWNLOAD_SEGMENT):
                # block transfer and unknown commands name the object that they mean
                _, self._index, self._subindex = MULTIPLEXER.unpack_from(message)
            raise SdoAbort(Abort.COMMAND_SPECIFIER)

    def _begin(self, message: bytes) -> None:
        self._forget()
        _, self._index, self._subindex = MULTIPLEXER.unpack_from(message)
        for subindex in (self._subindex, None):
            code = self.refusals.get((self._index, subindex))
            if code is not None:
                raise SdoAbort(code)

    def _check_toggle(self, command: int) -> None:
        if command & TOGGLE != self._toggle:
            raise SdoAbort(Abort.TOGGLE_BIT)
        self._toggle ^= TOGGLE

    def _begin_upload(self) -> None:
        value = self._store.read(self._index, self._subindex)
        head = (self._index, self._subindex)
        if 0 < len(value) <= 4:
            command = 0x43 | (4 - len(value)) << 2
            self._answer(MULTIPLEXER.pack(command, *head) + value.ljust(4, b"\x00"))
            return
        self._upload = value
        self._answer(MULTIPLEXER.pack(0x41, *head) + struct.pack("<I", len(value)))

    def _upload_segment(self) -> None:
        assert self._upload is not None
        part, self._upload = self._upload[:SEGMENT], self._upload[SEGMENT:]
        last = not self._upload
        command = (self._toggle ^ TOGGLE) | (SEGMENT - len(part)) << 1 | last
        self._answer(bytes((command,)) + part.ljust(SEGMENT, b"\x00"))
        if last:
            self._forget()

    def _begin_download(self, command: int, message: bytes) -> None:
        expedited, sized = command & 0x02, command & 0x01
        entry = self._store.find(self._index, self._subindex)
        if not entry.writable:
            raise SdoAbort(Abort.READ_ONLY)
        if expedited:
            # without a size the object's own length counts
            size = 4 - (command >> 2 & 3) if sized else min(4, entry.bits // 8)
            self._store.write(self._index, self._subindex, message[4 : 4 + size])
        else:
            self._size = struct.unpack_from("<I", message, 4)[0] if sized else None
            if self._size is not None and self._size > MAX_DOWNLOAD:
                raise SdoAbort(Abort.OUT_OF_MEMORY)
            self._download = bytearray()
        self._answer(MULTIPLEXER.pack(0x60, self._index, self._subindex) + bytes(4))

    def _download_segment(self, command: int, message: bytes) -> None:
        assert self._download is not None
        self._download += message[1 : 1 + SEGMENT - (command >> 1 & 7)]
        if len(self._download) > MAX_DOWNLOAD:
            raise SdoAbort(Abort.OUT_OF_MEMORY)
        if command & 1:
            if self._size is not None and len(self._download) != self._size:
                longer = len(self._download) > self._size
                raise SdoAbort(Abort.LENGTH_TOO_HIGH if longer else Abort.LENGTH_TOO_LOW)
            self._store.write(self._index, self._subindex, bytes(self._download))
            self._download = None
        self._answer(bytes((0x20 | self._toggle ^ TOGGLE,)) + bytes(7))
