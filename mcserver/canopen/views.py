"""What operators see of drives and ask of them; free of CANopen's packages, for the network's side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import msgspec

Value = int | float | str | bool
SdoType = Literal[
    "bool",
    "i8",
    "i16",
    "i24",
    "i32",
    "i64",
    "u8",
    "u16",
    "u24",
    "u32",
    "u64",
    "f32",
    "f64",
    "str",
    "utf16",
    "bytes",
]
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


class SdoReply(msgspec.Struct, frozen=True):
    """An object's value, read or written; ``raw``: the bytes, little endian. ``bytes`` are shown as text."""

    axis: int
    bus: str
    node: int
    index: int
    subindex: int
    type: SdoType
    value: bool | int | float | str
    raw: bytes
