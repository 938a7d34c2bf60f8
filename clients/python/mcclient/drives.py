"""Drives on CAN buses: how they are, and objects of their dictionaries."""

from __future__ import annotations

from mcclient.calls import Caller
from mcclient.types import BusScan, DriveInfo, SdoObject, SdoValue
from mcclient.wire import decode, from_wire, unpack

SDO_S = 15.0


class DriveCalls:
    """What `mcclient.Machine` offers of them."""

    _caller: Caller

    async def drives(self) -> list[DriveInfo]:
        """Every drive on a CAN bus, by axis: its node's state, its statusword, its last emergency."""
        reply = await self._caller.call("drives")
        return [from_wire(DriveInfo, each) for each in unpack(reply)["drives"]]

    async def drives_scan(self, bus: str = "") -> list[BusScan]:
        """Ask every node number of a CAN bus, or of all, who is there; nothing is configured or started.

        Raises:
            RequestRefused: MC559 no such bus, or no drives on one.
        """
        reply = await self._caller.call("drives_scan", {"bus": bus}, deadline_s=SDO_S, attempt_s=SDO_S)
        return [from_wire(BusScan, each) for each in unpack(reply)["buses"]]

    async def sdo_read(
        self,
        axis: int | None,
        index: int,
        subindex: int = 0,
        *,
        type: str | None = None,
        node: int | None = None,
        bus: str = "",
    ) -> SdoObject:
        """Reads an object of a drive's dictionary.

        Args:
            axis: whose drive; None: the one of ``node`` (and ``bus``, where several have that number).
            index, subindex: such as 0x6041, 0.
            type: ``u8 u16 u24 u32 u64 i8 … f32 f64 bool str utf16 bytes``; None: by the drive's EDS.

        Raises:
            RequestRefused: MC553 with the drive's abort code, MC554 no answer, MC559.
        """
        request = {"axis": axis, "node": node, "bus": bus, "index": index, "subindex": subindex, "type": type}
        return decode(
            SdoObject, await self._caller.call("sdo_read", request, deadline_s=SDO_S, attempt_s=SDO_S)
        )

    async def sdo_write(
        self,
        axis: int | None,
        index: int,
        subindex: int,
        value: SdoValue,
        *,
        type: str | None = None,
        node: int | None = None,
        bus: str = "",
    ) -> SdoObject:
        """Writes an object, unless that would fight the cycle; otherwise as `sdo_read`.

        Args:
            value: a number, or text: ``0x10``, or hexadecimal for ``bytes``.
        """
        request = {
            "axis": axis,
            "node": node,
            "bus": bus,
            "index": index,
            "subindex": subindex,
            "type": type,
            "value": value,
        }
        return decode(
            SdoObject, await self._caller.call("sdo_write", request, deadline_s=SDO_S, attempt_s=SDO_S)
        )
