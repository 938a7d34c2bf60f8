"""What a machine looks like: its URDF, and the meshes that it names."""

from __future__ import annotations

from typing import Any

from mcclient.calls import Caller
from mcclient.errors import ProtocolError
from mcclient.wire import unpack

PART_BYTES = 1 << 20
PART_S = 15.0


class ModelCalls:
    """What `mcclient.Machine` offers of it; answers are the maps of docs/wire/model.md."""

    _caller: Caller

    async def model(self) -> dict[str, Any]:
        """Ask for the URDF (empty where the machine has none), the joints of its axes, and its meshes.

        Raises:
            RequestRefused: MC587 the URDF cannot be read.
        """
        reply = await self._caller.call("model", {}, deadline_s=PART_S, attempt_s=PART_S)
        answer: dict[str, Any] = unpack(reply)
        return answer

    async def read_mesh(self, mesh: int) -> bytes:
        """Take a mesh's file over; ``mesh`` counts from 0 in ``model()["meshes"]``.

        Raises:
            RequestRefused: MC587 it is not to be had. ProtocolError: MC533 it has changed meanwhile.
        """
        data, size = bytearray(), None
        while size is None or len(data) < size:
            request = {"mesh": mesh, "offset": len(data), "size": PART_BYTES}
            part = unpack(await self._caller.call("model_mesh", request, deadline_s=PART_S, attempt_s=PART_S))
            if (size is not None and part["size"] != size) or (not part["data"] and len(data) < part["size"]):
                raise ProtocolError("MC533", "the mesh changed while it was read", "try again")
            size = int(part["size"])
            data += part["data"]
        return bytes(data)
