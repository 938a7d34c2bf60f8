"""The remote methods about recordings."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from mcserver.net import recording_messages as wire
from mcserver.recorder.views import RecordingAccess


class RecordingMethods:
    """Binds messages to the recorder.

    Args:
        recorder: the server's. note: publishes who did what: client, method, detail.
    """

    def __init__(self, recorder: RecordingAccess, note: Callable[[str, str, str], None]) -> None:
        self._recorder = recorder
        self._note = note

    async def record_start(self, client: str, request: wire.RecordStartRequest) -> wire.RecordReply:
        name = await self._recorder.record(request.name, request.max_s)
        self._note(client, "record_start", name)
        return wire.RecordReply(name)

    async def record_stop(self, client: str, request: wire.RecordStopRequest) -> wire.RecordReply:
        name = await self._recorder.stop_recording(request.name)
        self._note(client, "record_stop", name)
        return wire.RecordReply(name)

    async def record_save(self, client: str, request: wire.RecordSaveRequest) -> wire.RecordReply:
        name = await self._recorder.save(request.reason or "asked")
        self._note(client, "record_save", name)
        return wire.RecordReply(name)

    async def recordings(self, _client: str, _request: wire.RecordingsRequest) -> wire.RecordingsReply:
        status = await self._recorder.status()
        writing = frozenset(() if status is None else status.writing)
        # a folder on a disk that hangs must not hold up the loop
        found = await asyncio.to_thread(self._recorder.folder.entries, writing)
        return wire.RecordingsReply(found, status, str(self._recorder.folder.path))

    async def recording_read(self, _client: str, request: wire.RecordingReadRequest) -> wire.RecordingPart:
        folder = self._recorder.folder
        return await asyncio.to_thread(folder.read, request.name, request.offset, request.size)
