"""What operators see of drives and ask of them; free of CANopen's packages, for the network's side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import msgspec

from mcserver.errors import ServiceError

Value = int | float | str | bool
# those of `mcserver.canopen.node.Phase`
DrivePhase = Literal["booting", "operational", "lost", "restarting", "failed", "closed"]


class MonitoredValue(msgspec.Struct, frozen=True, omit_defaults=True):
    """One object that the machine file shows in telemetry (``monitor``); value None: none has come."""

    name: str
    value: int | float | bool | None
    index: int = 0
    subindex: int = 0


class DriveInfo(msgspec.Struct, frozen=True, omit_defaults=True):
    """One drive on a CAN bus.

    Attributes:
        state: what the server takes it for. nmt: what its last heartbeat said; empty: none has come.
        heartbeat_age_s: since its last sign of life [s].
        statusword: 6041h, or the fault bits of a drive that streams telemetry. status: the same in words.
        device_type, vendor_id, product_code: 1000h, 1018h:01, 1018h:02.
        emergency: its last emergency message in words; emergency_code, emergency_age_s: of that.
        boot_ups: how often it has started since the server did. message: why its configuration failed.
        monitor: what the machine file wants to see of it, newest values.
    """

    axis: int
    kind: str
    bus: str
    node: int
    state: DrivePhase
    nmt: str = ""
    heartbeat_age_s: float | None = None
    statusword: int | None = None
    status: str = ""
    device_type: int | None = None
    vendor_id: int | None = None
    product_code: int | None = None
    emergency: str = ""
    emergency_code: int | None = None
    emergency_age_s: float | None = None
    boot_ups: int = 0
    message: str = ""
    monitor: list[MonitoredValue] = []


class ScannedNode(msgspec.Struct, frozen=True, omit_defaults=True):
    """One node that answers on a bus.

    Attributes:
        profile: of 1000h; what: the same in words. modes: of 6502h.
        vendor_id … serial: 1018h; None: it does not say.
        axis: of the running machine, whose drive it is. eds: a file that is its by vendor and product.
        objects: what else it says of itself, by object, such as ``"6091:1"``: encoder (608Fh), gear (6091h),
            feed (6092h), rated torque (6076h [mN·m]), greatest speed of the motor (6080h [1/min]), travel
            (607Dh).
    """

    node: int
    profile: int
    what: str
    vendor_id: int | None = None
    product_code: int | None = None
    revision: int | None = None
    serial: int | None = None
    modes: list[str] = []
    axis: int | None = None
    eds: str = ""
    objects: dict[str, int] = {}


class BusScan(msgspec.Struct, frozen=True):
    """Who is on one bus; ``machine_file``: one to start from."""

    bus: str
    address: str
    nodes: list[ScannedNode]
    machine_file: str


@dataclass(frozen=True)
class SdoTarget:
    """An object of one drive, named by its axis, or by node (and bus, where the number is on several)."""

    index: int
    subindex: int = 0
    axis: int | None = None
    node: int | None = None
    bus: str = ""


@dataclass(frozen=True)
class SdoValue:
    """An object's value; ``kind`` is the type's short name, ``raw`` the bytes as they were transferred."""

    axis: int
    bus: str
    node: int
    index: int
    subindex: int
    kind: str
    value: Value
    raw: bytes


class DriveAccess(Protocol):
    """Drives as operators may reach them."""

    def drives(self) -> list[DriveInfo]:
        """Every drive on a CAN bus, by axis."""

    async def scan(self, bus: str, /) -> list[BusScan]:
        """Ask every node number of a bus, or of all, who is there."""

    async def sdo_read(self, target: SdoTarget, kind: str | None, /) -> SdoValue:
        """Read an object; ``kind`` None: by the drive's dictionary."""

    async def sdo_write(self, target: SdoTarget, kind: str | None, value: Value, /) -> SdoValue:
        """Write an object, unless that would fight the cycle."""


class NoDrives:
    """`DriveAccess` of a machine without drives on CAN buses."""

    def drives(self) -> list[DriveInfo]:
        return []

    async def scan(self, _bus: str, /) -> list[BusScan]:
        raise self._refusal()

    async def sdo_read(self, _target: SdoTarget, _kind: str | None, /) -> SdoValue:
        raise self._refusal()

    async def sdo_write(self, _target: SdoTarget, _kind: str | None, _value: Value, /) -> SdoValue:
        raise self._refusal()

    def _refusal(self) -> ServiceError:
        return ServiceError(
            "MC559",
            "this machine has no drives on a CAN bus",
            "those on EtherCAT are read by `mcserver drives`, without a server",
        )
