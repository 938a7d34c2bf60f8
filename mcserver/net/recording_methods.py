"""Remote methods for recordings."""

from __future__ import annotations

import asyncio
from pathlib import Path

from mcserver.errors import ServiceError
from mcserver.net import recording_messages as wire
from mcserver.recorder.client import RecorderClient
from mcserver.recorder.folder import RecordingFolder, RecordingPart
from mcserver.service.service import MachineService

_NO_FOLDER = RecordingFolder(Path("/nonexistent"))


class RecordingMethods:
    """Handles messages for the recorder.

    Args:
        recorder: the server's; None: the machine file disables it.
    """

    def __init__(self, service: MachineService, recorder: RecorderClient | None) -> None:
        self._service = service
        self._client = recorder
        self._folder = _NO_FOLDER if recorder is None else recorder.folder

    @property
    def _recorder(self) -> RecorderClient:
        if self._client is None:
            raise ServiceError(
                "MC580", "this server has no recorder", "set enabled = true in [recorder] of its machine file"
            )
        return self._client

    async def record_start(self, client: str, request: wire.RecordStartRequest) -> wire.RecordReply:
        name = await self._recorder.record(request.name, request.max_s)
        self._service.record_command(client, "record_start", detail=name)
        return wire.RecordReply(name)

    async def record_stop(self, client: str, request: wire.RecordStopRequest) -> wire.RecordReply:
        name = await self._recorder.stop_recording(request.name)
        self._service.record_command(client, "record_stop", detail=name)
        return wire.RecordReply(name)

    async def record_save(self, client: str, request: wire.RecordSaveRequest) -> wire.RecordReply:
        name = await self._recorder.save(request.reason or "asked")
        self._service.record_command(client, "record_save", detail=name)
        return wire.RecordReply(name)

    async def recordings(self, _client: str, _request: wire.RecordingsRequest) -> wire.RecordingsReply:
        status = None if self._client is None else await self._client.status()
        writing = frozenset(() if status is None else status.writing)
        # in a thread, in case the folder's disk hangs
        found = await asyncio.to_thread(self._folder.entries, writing)
        return wire.RecordingsReply(found, status, str(self._folder.path))

    async def recording_read(self, _client: str, request: wire.RecordingReadRequest) -> RecordingPart:
        return await asyncio.to_thread(self._folder.read, request.name, request.offset, request.size)
