"""The recorder as the network's methods see it."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from mcserver.errors import ServiceError
from mcserver.recorder.folder import RecordingFolder
from mcserver.recorder.messages import RecorderStatus


class RecordingAccess(Protocol):
    """Recordings as clients may reach them: `mcserver.recorder.client.RecorderClient`."""

    @property
    def folder(self) -> RecordingFolder: ...

    async def record(self, name: str, max_s: float | None, /) -> str:
        """Begin a recording; its name."""

    async def stop_recording(self, name: str, /) -> str:
        """End a recording; its name once it is whole."""

    async def save(self, reason: str, /) -> str:
        """Write the black box out; its name once it is whole."""

    async def status(self) -> RecorderStatus | None:
        """What it holds; None while there is no recorder."""


class NoRecorder:
    """`RecordingAccess` of a server whose machine file switches the recorder off."""

    folder = RecordingFolder(Path("/nonexistent"))

    async def record(self, _name: str, _max_s: float | None, /) -> str:
        raise self._refusal()

    async def stop_recording(self, _name: str, /) -> str:
        raise self._refusal()

    async def save(self, _reason: str, /) -> str:
        raise self._refusal()

    async def status(self) -> RecorderStatus | None:
        return None

    def _refusal(self) -> ServiceError:
        return ServiceError(
            "MC580", "this server has no recorder", "set enabled = true in [recorder] of its machine file"
        )
