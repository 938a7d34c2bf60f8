"""Operators' way to the drives of a running machine: how they are, and their objects by SDO."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar, cast

from canopen.objectdictionary import ODVariable

from mcserver.canopen.bus_scan import scan_bus
from mcserver.canopen.canopen_errors import DriveError, object_text
from mcserver.canopen.drive_listening import DriveListening
from mcserver.canopen.node import Node, NodeAxis
from mcserver.canopen.parameters import encode, parameter_of, parameters_of
from mcserver.canopen.reachable_drives import LineDrive, NodeDrive, ReachableDrives
from mcserver.canopen.service import CanopenService
from mcserver.canopen.settings import NO_AXIS, DriveSettings
from mcserver.canopen.values import TYPES, Value, decode_value, encode_value, type_name
from mcserver.canopen.views import (
    BusScan,
    DriveInfo,
    DriveParameters,
    Fieldbus,
    MonitoredValue,
    SdoReply,
    SdoTarget,
    SdoType,
)
from mcserver.drives.cia402.state import power_text
from mcserver.errors import UsageFault

T = TypeVar("T")

WORKERS = 4
MAX_WAITING = 16


class OperatorAccess:
    """Drives as operators may reach them; transfers wait in threads of its own.

    Args:
        service: of the CAN buses; None: there are none.

    Attributes:
        reachable: the drives. listening: to them.
    """

    def __init__(self, service: CanopenService | None) -> None:
        self.reachable = ReachableDrives(service)
        self.listening = DriveListening(self.reachable, self._in_thread)
        self._waiting = 0
        self._pool = ThreadPoolExecutor(WORKERS, thread_name_prefix="canopen operator")

    def close(self) -> None:
        """End the threads; a transfer under way ends first, listening at once."""
        self.listening.stop()
        self._pool.shutdown(wait=True, cancel_futures=True)

    async def drives(self) -> list[DriveInfo]:
        """Return every drive on a bus, by axis."""
        now = time.monotonic()
        nodes = [node for node in self.reachable.nodes if node.settings.axis != NO_AXIS]
        views = [_view(node, axis, now) for node in nodes for axis in node.axes]
        line = self.reachable.line
        if line is not None:
            views += await self._in_thread(line.infos)
        return sorted(views, key=lambda view: view.axis)

    async def scan(self, bus: str) -> list[BusScan]:
        """Ask every node number of a CAN bus, and the drives of a line, or of all, who is there.

        Raises:
            DriveError: MC559 no such bus. RuntimeFault: MC424 a bus cannot be opened.
        """
        service, line = self.reachable.service, self.reachable.line
        buses = [each for each in ([] if service is None else service.buses) if bus in ("", each.name)]
        lines = [each for each in ([] if line is None else line.buses) if bus in ("", each)]
        if not buses and not lines:
            names = [] if service is None else [each.name for each in service.buses]
            names += [] if line is None else line.buses
            raise DriveError("MC559", f"there is no bus {bus!r}", f"there is {', '.join(names)}")

        def scan() -> list[BusScan]:
            found = [scan_bus(each, "machine") for each in buses]
            return found if line is None else found + [line.scan(each) for each in lines]

        return await self._in_thread(scan)

    def parameters(self, axis: int) -> DriveParameters:
        """Return every object of an axis's drive, by the drive's EDS or the standard; nothing is asked.

        Raises:
            DriveError: MC559 no such drive, or one without the standard's objects.
        """
        found = self.reachable.find(SdoTarget(0, axis=axis))
        settings, dictionary = found.settings, found.dictionary
        if dictionary is None:
            raise settings.fault("MC559", f"is {settings.kind}, not CiA 402", "use its maker's own tool")
        return DriveParameters(
            axis,
            settings.bus,
            settings.place,
            settings.node_axis,
            dictionary.sha256,
            [*parameters_of(dictionary, settings.node_axis)],
            [error.message for _, error in sorted(dictionary.unreadable.items())],
            cast(Fieldbus, settings.fieldbus),
        )

    async def sdo_read(self, target: SdoTarget, kind: str | None) -> SdoReply:
        """Read an object; ``kind`` None: by the drive's dictionary.

        Raises:
            DriveError: MC553 refused, MC554 no answer, MC559 no such drive, or not to be read as that type.
        """
        drive = self.reachable.find(target)
        settings, variable = drive.settings, _variable(drive, target)
        name = kind or (None if variable is None else type_name(variable.data_type))
        raw = await self._in_thread(lambda: drive.sdo.upload(target.index, target.subindex))
        if name is None:
            name = {1: "u8", 2: "u16", 4: "u32"}.get(len(raw), "bytes")
        try:
            value = decode_value(name, raw)
        except ValueError as error:
            if kind is not None:
                raise self._unfit(settings, target, str(error)) from error
            # the dictionary is wrong about its length: the bytes are right
            name, value = "bytes", decode_value("bytes", raw)
        return _value(settings, target, name, value, raw)

    async def sdo_write(self, target: SdoTarget, kind: str | None, value: Value) -> SdoReply:
        """Write an object, unless that would fight the cycle.

        Args:
            kind: None: by the drive's dictionary, also its access and limits.

        Raises:
            DriveError: MC553, MC554, MC559 also: it would fight it, its type is not known, or the dictionary
                does not allow it.
        """
        drive = self.reachable.find(target)
        settings = drive.settings
        refusal = drive.refusal_of_write(target.index)
        if refusal is not None:
            raise settings.fault(
                "MC559",
                f"{object_text(target.index, target.subindex)} is not written: {refusal[0]}",
                refusal[1],
            )
        variable = _variable(drive, target)
        if kind is None and variable is not None:
            name = type_name(variable.data_type)
            try:
                raw = encode(parameter_of(variable), value)
            except UsageFault as error:
                raise settings.fault("MC559", error.message, error.hint) from error
        else:
            name, raw = kind or "", self._encoded(settings, target, kind, value)
        await self._in_thread(lambda: drive.sdo.download(target.index, target.subindex, raw))
        return _value(settings, target, name, value, raw)

    # ------------------------------------------------------------ inside

    def _encoded(self, settings: DriveSettings, target: SdoTarget, kind: str | None, value: Value) -> bytes:
        """Return the bytes of a value of a type that the caller gives."""
        if kind is None:
            raise self._unfit(
                settings, target, "its type is not known: the drive's dictionary does not have it"
            )
        try:
            raw = encode_value(kind, value)
        except (ValueError, OverflowError) as error:
            raise self._unfit(settings, target, f"{value!r} is no {kind}: {error}") from error
        if not raw:
            raise self._unfit(settings, target, "an empty value cannot be written")
        return raw

    async def _in_thread(self, work: Callable[[], T]) -> T:
        if self._waiting >= MAX_WAITING:
            raise DriveError("MC559", f"{MAX_WAITING} SDO transfers are waiting", "try again in a moment")
        self._waiting += 1
        try:
            return await asyncio.get_running_loop().run_in_executor(self._pool, work)
        finally:
            self._waiting -= 1

    def _unfit(self, settings: DriveSettings, target: SdoTarget, what: str) -> DriveError:
        return settings.fault(
            "MC559",
            f"{object_text(target.index, target.subindex)}: {what}",
            f"give its type: one of {', '.join(TYPES)}",
        )


def _variable(drive: NodeDrive | LineDrive, target: SdoTarget) -> ODVariable | None:
    """Return an object of the drive's dictionary; None: it does not have it."""
    dictionary = drive.dictionary
    variable = None if dictionary is None else dictionary.get_variable(target.index, target.subindex)
    return variable if isinstance(variable, ODVariable) else None


def _value(settings: DriveSettings, target: SdoTarget, kind: str, value: Value, raw: bytes) -> SdoReply:
    # a name of `TYPES`
    named = cast(SdoType, kind)
    return SdoReply(
        settings.axis,
        settings.bus,
        settings.place,
        target.index,
        target.subindex,
        named,
        value,
        raw,
        cast(Fieldbus, settings.fieldbus),
    )


def _view(node: Node, axis: NodeAxis, now: float) -> DriveInfo:
    settings = axis.settings
    word = node.statusword_of(axis)
    emergency = node.emergency
    return DriveInfo(
        axis=settings.axis,
        kind=settings.kind,
        bus=settings.bus,
        node=settings.node,
        state=node.phase.value,
        nmt="" if node.nmt is None else node.nmt.name.lower().replace("_", "-"),
        heartbeat_age_s=None if node.heard_at is None else max(0.0, now - node.heard_at),
        statusword=word,
        status=_status(settings, word),
        device_type=node.identity.device_type,
        vendor_id=node.identity.vendor_id,
        product_code=node.identity.product_code,
        emergency="" if emergency is None else emergency.text,
        emergency_code=None if emergency is None else emergency.code,
        emergency_age_s=None if emergency is None else max(0.0, now - node.emergency_at),
        boot_ups=node.boot_ups,
        message=node.failure,
        monitor=_monitored(node, axis),
    )


def _monitored(node: Node, axis: NodeAxis) -> list[MonitoredValue]:
    shown = []
    if axis.settings.streamed is not None:
        values = axis.settings.streamed.monitored(node.telemetry)
        shown += [MonitoredValue(name, round(value, 3)) for name, value in values.items()]
    for index, subindex, name in axis.settings.monitor:
        kind = axis.kinds[index, subindex]
        raw = node.raw_of(axis, index, subindex, ODVariable.STRUCT_TYPES[TYPES[kind]].size)
        value = None if raw is None else decode_value(kind, raw)
        shown.append(MonitoredValue(name, None if isinstance(value, str) else value, index, subindex))
    return shown


def _status(settings: DriveSettings, word: int | None) -> str:
    if word is None:
        return ""
    if settings.streamed is not None:
        return settings.streamed.fault_text(word)
    return power_text(word)
