"""Recordings on the server: start, stop, save the black box, list, and take over."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

from mcclient.calls import Caller
from mcclient.errors import ProtocolError
from mcclient.wire import unpack

# A black box is written before the answer comes [s].
WRITTEN_S = 90.0
PART_BYTES = 1 << 20


class RecordingCalls:
    """What `mcclient.Machine` offers of them; answers are the maps of docs/wire/recordings.md."""

    _caller: Caller

    async def start_recording(self, name: str = "", max_s: float | None = None) -> str:
        """Record every cycle into a file on the server from now on; returns the recording's name.

        Raises:
            RequestRefused: MC580 there is no recorder, MC584 the name is taken or none, MC586.
        """
        return str((await self._call("record_start", {"name": name, "max_s": max_s}))["name"])

    async def stop_recording(self, name: str = "") -> str:
        """End a recording, the only one without a name; returns once the file is whole.

        Raises:
            RequestRefused: MC582 it could not be written, MC585 nothing of that name is being recorded.
        """
        return str((await self._call("record_stop", {"name": name}, WRITTEN_S))["name"])

    async def save_black_box(self, reason: str = "asked") -> str:
        """Write out the last minutes; returns the recording's name once the file is whole."""
        return str((await self._call("record_save", {"reason": reason}, WRITTEN_S))["name"])

    async def recordings(self) -> dict[str, Any]:
        """What is on the server's disk, the newest first, and what the recorder holds."""
        return await self._call("recordings", {})

    async def read_recording(self, name: str) -> AsyncIterator[tuple[bytes, int]]:
        """The file of a recording piece by piece: bytes, and the size of the whole.

        Raises:
            RequestRefused: MC585 no recording has that name. ProtocolError: MC533 it has changed meanwhile.
        """
        offset, size = 0, None
        while size is None or offset < size:
            part = await self._call(
                "recording_read", {"name": name, "offset": offset, "size": PART_BYTES}, 15.0
            )
            if (size is not None and part["size"] != size) or (not part["data"] and offset < part["size"]):
                raise ProtocolError("MC533", f"the recording {name} changed while it was read", "try again")
            size = int(part["size"])
            offset += len(part["data"])
            yield part["data"], size

    async def _call(self, method: str, fields: dict[str, Any], seconds: float = 5.0) -> dict[str, Any]:
        reply = await self._caller.call(method, fields, deadline_s=seconds, attempt_s=seconds)
        answer: dict[str, Any] = unpack(reply)
        return answer
