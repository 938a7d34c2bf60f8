"""Payloads about drives on buses, as `mcserver.net.messages`: what they show, and objects by SDO."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from mcserver.canopen.views import BusHealth, BusScan, DriveInfo, SdoType
from mcserver.net.messages import AxisIndex, Request

NodeNumber = Annotated[int, Meta(ge=1, le=127)]


class DrivesRequest(Request, frozen=True, kw_only=True):
    """Every drive on a bus."""


class SdoReadRequest(Request, frozen=True, kw_only=True):
    """Reads an object of a drive's dictionary (CiA 301).

    Attributes:
        axis: whose drive; or ``node``, with ``bus`` where several buses have that number.
        index, subindex: of the object.
        type: how to read the bytes; None: by the drive's EDS, or the standard's objects.
    """

    index: Annotated[int, Meta(ge=0, le=0xFFFF)]
    subindex: Annotated[int, Meta(ge=0, le=0xFF)] = 0
    axis: AxisIndex | None = None
    node: NodeNumber | None = None
    bus: Annotated[str, Meta(max_length=200)] = ""
    type: SdoType | None = None


class SdoWriteRequest(SdoReadRequest, frozen=True, kw_only=True):
    """Writes an object; ``value`` may be text: a number such as ``0x10``, or hexadecimal for ``bytes``."""

    value: bool | int | float | Annotated[str, Meta(max_length=65_536)]


class DrivesScanRequest(Request, frozen=True, kw_only=True):
    """Scans a bus: every node number of CAN, every drive of EtherCAT; ``bus`` empty: all buses."""

    bus: Annotated[str, Meta(max_length=200)] = ""


class DrivesScanReply(msgspec.Struct, frozen=True):
    """By bus; each with a machine file to start from."""

    buses: list[BusScan]


class DrivesReply(msgspec.Struct, frozen=True):
    """By axis; empty if no drive is on a bus."""

    drives: list[DriveInfo]


class DriveParametersRequest(Request, frozen=True, kw_only=True):
    """The objects of an axis's drive."""

    axis: AxisIndex


class DrivesHealthRequest(Request, frozen=True, kw_only=True):
    """Health of the buses; ``seconds``: how long to listen to them, all together."""

    seconds: Annotated[float, Meta(ge=0.1, le=10.0)] = 5.0


class DrivesHealthReply(msgspec.Struct, frozen=True):
    """By bus."""

    buses: list[BusHealth]


class DriveScopeRequest(Request, frozen=True, kw_only=True):
    """Every mapped object of an axis's drive in each cycle.

    Attributes:
        seconds: time kept. trigger: such as ``following error > 0.05``; empty: at once. level: fires also
            if the level is already met. before_s: kept before the trigger; None: a quarter.
        timeout_s: how long the trigger may take.
    """

    axis: AxisIndex
    seconds: Annotated[float, Meta(ge=0.01, le=10.0)] = 2.0
    trigger: Annotated[str, Meta(max_length=200)] = ""
    level: bool = False
    before_s: Annotated[float, Meta(ge=0.0, le=10.0)] | None = None
    timeout_s: Annotated[float, Meta(ge=0.1, le=60.0)] = 10.0


class DriveTuneRequest(Request, frozen=True, kw_only=True):
    """The gains of an axis in mode cst or csv, by the motion of a program; ``seconds``: time observed."""

    axis: AxisIndex
    seconds: Annotated[float, Meta(ge=0.5, le=60.0)] = 20.0
