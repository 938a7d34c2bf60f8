"""Operators' way to the drives of a running machine: how they are, and their objects by SDO."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from typing import Protocol, TypeVar, cast

import msgspec
import numpy as np
from canopen.objectdictionary import ODVariable

from mcserver.can.cob import NmtState
from mcserver.can.open import open_port
from mcserver.can.pdo import ProcessData
from mcserver.can.port import CanPort
from mcserver.canopen.bus_report import bus_report
from mcserver.canopen.bus_scan import scan_bus
from mcserver.canopen.canopen_errors import DriveError, Stopped, object_text
from mcserver.canopen.configuration import PDO_OBJECTS, of_first_axis
from mcserver.canopen.cycle_samples import Signal, signals_of
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.loop_tuning import Judged, check_tunable, judge
from mcserver.canopen.node import Node, NodeAxis, Phase
from mcserver.canopen.node_configuration import SdoClient
from mcserver.canopen.parameters import encode, parameter_of, parameters_of
from mcserver.canopen.scope import Scope, ScopeTrace, read_trigger
from mcserver.canopen.scope_recording import record_cycles
from mcserver.canopen.service import CanopenService
from mcserver.canopen.settings import NO_AXIS, DriveSettings
from mcserver.canopen.values import TYPES, Value, decode_value, encode_value, type_name
from mcserver.canopen.views import (
    BusHealth,
    BusScan,
    DriveInfo,
    DriveParameters,
    DriveTrace,
    DriveTuning,
    Fieldbus,
    MonitoredValue,
    ParameterInfo,
    ScopeSignal,
    SdoReply,
    SdoTarget,
    SdoType,
    TunedLoop,
)
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.drives.cia402.state import power_text
from mcserver.errors import UsageFault
from mcserver.machine.machine_file import Axis, Machine

T = TypeVar("T")

WORKERS = 4
MAX_WAITING = 16

# What the cycle, the supervision and the scaling of positions rest on (CiA 301, CiA 402).
_CYCLIC = frozenset({0x6040, 0x6060, 0x6071, 0x607A, 0x60C1, 0x60FF})
# Of position, velocity and torque: what is added to the targets.
_OFFSETS = frozenset({0x60B0, 0x60B1, 0x60B2})
_OUTPUTS = 0x60FE
_WATCHING = frozenset({0x1016, 0x1017})
# Of sync managers with the cycle, on EtherCAT (ETG.1020).
_SYNCHRONIZATION = frozenset({0x1C32, 0x1C33})
_SCALING = frozenset({0x607C, 0x607E, 0x608F, 0x6091, 0x6092, 0x60C2})


_BY_PROGRAM = "move the axis by a program, or by jog"
_BY_FILE = "what it holds follows from the machine file; change it there and start the server again"


def moves_by_sdo(index: int) -> bool:
    """Return whether an object, of any axis of a node, commands motion, energy or, by 60FEh, a brake."""
    return of_first_axis(index) in _CYCLIC | _OFFSETS | {_OUTPUTS}


def refusal_of_write(index: int) -> tuple[str, str] | None:
    """Why an object must not be written while the cycle runs, and what to do instead; None: it may be."""
    index = of_first_axis(index)
    if index in _CYCLIC:
        return "the executor sends it in every cycle", _BY_PROGRAM
    if index in _OFFSETS:
        return "the drive adds it to the targets that the executor sends", _BY_PROGRAM
    if index == _OUTPUTS:
        return "it switches outputs, one of which may hold a brake", "switch outputs by programs"
    if index in PDO_OBJECTS:
        return "it is the mapping of the process data in which the executor and the drive agree", _BY_FILE
    if index in _SYNCHRONIZATION:
        return "its synchronization with the cycle rests on it", _BY_FILE
    if index in _WATCHING:
        return "the watching of the drive rests on it", _BY_FILE
    if index in _SCALING:
        return "the scaling of positions rests on it, and the axis may be energized", _BY_FILE
    return None


@dataclass(frozen=True)
class LineDrive:
    """A drive on EtherCAT, whose line is in the cycle.

    Attributes:
        sdo: its mailbox. dictionary: of its file, or the standard's objects.
    """

    settings: DriveSettings
    sdo: SdoClient
    dictionary: DeviceDictionary

    def refusal_of_write(self, index: int) -> tuple[str, str] | None:
        """As the function."""
        return refusal_of_write(index)


class LineAccess(Protocol):
    """Drives on EtherCAT; `mcserver.ethercat.operator_line.OperatorLine`."""

    @property
    def machine(self) -> Machine:
        """As its file describes it."""

    @property
    def drives(self) -> Sequence[LineDrive]:
        """By axis."""

    @property
    def buses(self) -> Sequence[str]:
        """Their names."""

    def process_data(self) -> dict[int, ProcessData]:
        """Return what the cycle exchanges with the drives, by axis."""

    def infos(self) -> list[DriveInfo]:
        """Return the drives as they are; may wait for a second."""

    def scan(self, bus: str) -> BusScan:
        """Return who was found on a line at its start."""

    def listen(self, bus: str) -> CanPort:
        """Open a line for listening. Raises: RuntimeFault MC424 it cannot be."""

    def health(
        self,
        bus: str,
        seconds: float,
        data: Mapping[int, ProcessData],
        signals: Sequence[Signal],
        check: Callable[[], None],
    ) -> BusHealth:
        """As `bus_report`. Raises: as `listen`."""


@dataclass(frozen=True)
class _NodeDrive:
    """A drive of a node on a CAN bus, as `LineDrive`."""

    node: Node
    settings: DriveSettings
    dictionary: DeviceDictionary | None

    @property
    def sdo(self) -> SdoClient:
        return self.node.sdo

    def refusal_of_write(self, index: int) -> tuple[str, str] | None:
        node = self.node
        if not node.settings.has_profile:
            return "its drive's SDO takes no standard writes", "use its maker's own tool"
        if node.phase is not Phase.OPERATIONAL and node.nmt is not NmtState.OPERATIONAL:
            return None
        return refusal_of_write(index)


@dataclass(frozen=True)
class _OnBus:
    """A CiA 402 drive as it is on its bus in a cycle."""

    machine: Machine
    settings: DriveSettings
    process_data: ProcessData
    dictionary: DeviceDictionary

    @property
    def axis(self) -> Axis:
        return self.machine.axes[self.machine.column_of(self.settings.axis)]

    @property
    def signals(self) -> list[Signal]:
        return signals_of(self.axis, self.process_data, self.dictionary, self.settings.node_axis)


class OperatorAccess:
    """Drives as operators may reach them; transfers wait in threads of its own.

    Args:
        service: of the CAN buses; None: there are none.

    Attributes:
        line: drives on EtherCAT; None: there are none, or their line is not there yet.
    """

    def __init__(self, service: CanopenService | None) -> None:
        self._service = service
        self.line: LineAccess | None = None
        self._waiting = 0
        self._listening = False
        self._stopping = threading.Event()
        self._pool = ThreadPoolExecutor(WORKERS, thread_name_prefix="canopen operator")

    def close(self) -> None:
        """End the threads; a transfer under way ends first, listening at once."""
        self._stopping.set()
        self._pool.shutdown(wait=True, cancel_futures=True)

    async def drives(self) -> list[DriveInfo]:
        """Return every drive on a bus, by axis."""
        now = time.monotonic()
        nodes = [node for node in self._nodes if node.settings.axis != NO_AXIS]
        views = [_view(node, axis, now) for node in nodes for axis in node.axes]
        line = self.line
        if line is not None:
            views += await self._in_thread(line.infos)
        return sorted(views, key=lambda view: view.axis)

    async def scan(self, bus: str) -> list[BusScan]:
        """Ask every node number of a CAN bus, and the drives of a line, or of all, who is there.

        Raises:
            DriveError: MC559 no such bus. RuntimeFault: MC424 a bus cannot be opened.
        """
        service, line = self._service, self.line
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
        found = self._find(SdoTarget(0, axis=axis))
        settings, dictionary = found.settings, found.dictionary
        if dictionary is None:
            raise settings.fault("MC559", f"is {settings.kind}, not CiA 402", "use its maker's own tool")
        return DriveParameters(
            axis,
            settings.bus,
            settings.place,
            settings.node_axis,
            dictionary.sha256,
            [
                ParameterInfo(
                    each.index,
                    each.subindex,
                    each.name,
                    cast(SdoType, each.kind),
                    each.access,
                    each.low,
                    each.high,
                )
                for each in parameters_of(dictionary, settings.node_axis)
            ],
            [error.message for _, error in sorted(dictionary.unreadable.items())],
            cast(Fieldbus, settings.fieldbus),
        )

    async def health(self, seconds: float) -> list[BusHealth]:
        """Listen on every bus, one after the other; nothing is sent.

        Args:
            seconds: for all of them.

        Raises:
            DriveError: MC559 somebody has them listened to. RuntimeFault: MC424 a bus cannot be opened.
        """
        return await self._while_listening(lambda: self._health(seconds))

    async def scope(
        self,
        axis: int,
        seconds: float,
        trigger: str = "",
        timeout_s: float = 10.0,
        before_s: float | None = None,
        *,
        level: bool = False,
    ) -> DriveTrace:
        """Record every mapped object of an axis in each cycle; nothing is sent.

        Args:
            seconds: that are kept. trigger: as `read_trigger`; empty: at once. timeout_s: how long it may
                take. before_s: kept before it; None: a quarter. level: fire also where it is met already.

        Raises:
            DriveError: MC559 no such drive, or somebody else listens. UsageFault: MC568 the trigger.
            RuntimeFault: MC569 it did not come, MC424.
        """
        machine, own = self._listened(axis)
        fires = read_trigger(trigger, own.signals, edge=not level) if trigger else None
        lead = 0.0 if fires is None else 0.25 * seconds if before_s is None else min(before_s, seconds)
        cycles = max(2, round(seconds / machine.cycle_s))
        before = min(cycles - 1, round(lead / machine.cycle_s))
        recorder = Scope(own.signals, machine.cycle_s, cycles, before, fires)

        def record() -> DriveTrace:
            ended_unix, missing = self._record(own, recorder, timeout_s)
            return _trace_view(recorder.trace(), machine.cycle_s, ended_unix, missing)

        return await self._while_listening(record)

    async def tune(self, axis: int, seconds: float) -> DriveTuning:
        """Judge the gains of an axis in mode cst or csv by the motion of a program; nothing is sent.

        Args:
            seconds: for which the motion is looked at.

        Raises:
            DriveError: MC559. UsageFault: MC095 the loop is the drive's own. RuntimeFault: MC095 the motion
            tells too little, MC569, MC424.
        """
        machine, own = self._listened(axis)
        check_tunable(own.axis)
        cycles = max(2, round(seconds / machine.cycle_s))
        recorder = Scope(own.signals, machine.cycle_s, cycles, 0, None)

        def work() -> DriveTuning:
            self._record(own, recorder, seconds)
            found = judge(own.axis, recorder.trace(), machine.cycle_s, own.settings.fieldbus)
            return _tuning_view(own.axis, found)

        return await self._while_listening(work)

    async def sdo_read(self, target: SdoTarget, kind: str | None) -> SdoReply:
        """Read an object; ``kind`` None: by the drive's dictionary.

        Raises:
            DriveError: MC553 refused, MC554 no answer, MC559 no such drive, or not to be read as that type.
        """
        drive = self._find(target)
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
        drive = self._find(target)
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

    @property
    def _nodes(self) -> list[Node]:
        return [] if self._service is None else self._service.nodes

    async def _while_listening(self, work: Callable[[], T]) -> T:
        """Return what work that listens gives; one at a time, ended when the server stops."""
        if self._listening:
            raise DriveError("MC559", "the buses are being listened to", "try again in a moment")
        self._listening = True
        try:
            return await self._in_thread(work)
        except Stopped:
            raise DriveError("MC559", "the server stops", "try again when it runs") from None
        finally:
            self._listening = False

    def _check(self) -> None:
        if self._stopping.is_set():
            raise Stopped

    def _on_buses(self) -> list[_OnBus]:
        """Every CiA 402 drive with what of it is on its bus in a cycle."""
        service, line = self._service, self.line
        found: list[_OnBus] = []
        if service is not None:
            data = service.process_data()
            for node in service.nodes:
                for own in node.axes:
                    index = own.settings.axis
                    known = service.dictionary(index)
                    if index in data and known is not None:
                        found.append(_OnBus(service.machine, own.settings, data[index], known))
        if line is not None:
            data = line.process_data()
            found += [
                _OnBus(line.machine, each.settings, data[each.settings.axis], each.dictionary)
                for each in line.drives
            ]
        return found

    def _listened(self, axis: int) -> tuple[Machine, _OnBus]:
        settings = self._find(SdoTarget(0, axis=axis)).settings
        own = next((each for each in self._on_buses() if each.settings.axis == axis), None)
        if own is None:
            raise settings.fault("MC559", f"is {settings.kind}, not CiA 402", "use its maker's own tool")
        return own.machine, own

    def _record(self, own: _OnBus, scope: Scope, timeout_s: float) -> tuple[float, int]:
        line, settings = self.line, own.settings
        on_line = line is not None and settings.fieldbus == "ethercat"
        port = line.listen(settings.bus) if line is not None and on_line else open_port(settings.address)
        with closing(port):
            return record_cycles(port, settings, scope, timeout_s, self._check)

    def _health(self, seconds: float) -> list[BusHealth]:
        service, line = self._service, self.line
        on_can = [] if service is None else service.buses
        on_line = [] if line is None else line.buses
        share = seconds / max(1, len(on_can) + len(on_line))
        drives, reports = self._on_buses(), []
        for bus in [*(each.name for each in on_can), *on_line]:
            own = [each for each in drives if each.settings.bus == bus]
            data = {each.settings.axis: each.process_data for each in own}
            signals = [signal for each in own for signal in each.signals]
            if line is not None and bus in on_line:
                reports.append(line.health(bus, share, data, signals, self._check))
            elif service is not None:
                address = next(each.settings.address for each in service.nodes if each.settings.bus == bus)
                with closing(open_port(address)) as port:
                    reports.append(bus_report(service.machine, bus, port, share, data, signals, self._check))
        return reports

    def _find(self, target: SdoTarget) -> _NodeDrive | LineDrive:
        every = [
            _NodeDrive(
                node,
                axis.settings,
                None if self._service is None else self._service.dictionary(axis.settings.axis),
            )
            for node in self._nodes
            for axis in node.axes
        ]
        found: list[_NodeDrive | LineDrive]
        if target.axis is not None:
            reached: list[_NodeDrive | LineDrive] = [*every]
            reached += [] if self.line is None else self.line.drives
            found = [each for each in reached if each.settings.axis == target.axis]
            named = f"axis {target.axis} has no drive on a bus"
            namesake = [each.settings for each in every if each.settings.node == target.axis]
            if namesake and not found:
                named += f"; {target.axis} is the node of axis {namesake[0].axis}"
        else:
            found = [
                each
                for each in every
                if each.settings.node == target.node
                and target.bus in ("", each.settings.bus)
                and each.settings is each.node.axes[0].settings
            ]
            named = f"there is no drive with node {target.node}" + (f" on {target.bus}" if target.bus else "")
        if len(found) > 1:
            buses = ", ".join(each.settings.bus for each in found)
            raise DriveError("MC559", f"node {target.node} is on several buses: {buses}", "name the bus too")
        if not found:
            raise DriveError("MC559", named, "`mcctl drives` lists axes with their nodes")
        return found[0]

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


def _variable(drive: _NodeDrive | LineDrive, target: SdoTarget) -> ODVariable | None:
    """Return an object of the drive's dictionary; None: it does not have it."""
    dictionary = drive.dictionary
    variable = None if dictionary is None else dictionary.get_variable(target.index, target.subindex)
    return variable if isinstance(variable, ODVariable) else None


def _value(settings: DriveSettings, target: SdoTarget, kind: str, value: Value, raw: bytes) -> SdoReply:
    # a name of `TYPES`
    named = cast(SdoType, kind)
    return SdoReply(
        settings.axis, settings.bus, settings.place, target.index, target.subindex, named, value, raw
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
        heartbeat_age_s=None if node.seen_at is None else max(0.0, now - node.seen_at),
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


def _trace_view(trace: ScopeTrace, cycle_s: float, ended_unix: float, missing: int) -> DriveTrace:
    return DriveTrace(
        trace.axis,
        len(trace.time_s),
        cycle_s,
        float(trace.time_s[0]),
        ended_unix - float(trace.time_s[-1]),
        missing,
        [
            ScopeSignal(place, name, unit, trace.values[:, at].astype("<f8").tobytes())
            for at, (place, name, unit) in enumerate(
                zip(trace.objects, trace.names, trace.units, strict=True)
            )
        ],
    )


def _tuning_view(axis: Axis, found: Judged) -> DriveTuning:
    loops = []
    for (name, gains, margin), measured in zip(found.loops, found.measured_margins, strict=True):
        loops.append(
            TunedLoop(
                name,
                msgspec.to_builtins(gains),
                getattr(margin, "least", 0.0),
                margin.greatest,
                math.degrees(margin.phase),
                None if measured is None else measured.crossover_hz,
                None if measured is None else math.degrees(measured.phase),
                None if measured is None else measured.gain,
            )
        )
    frequency, opened = found.opened or (np.empty(0), np.empty(0, np.complex128))
    return DriveTuning(
        axis.index,
        "cst" if cia402_drive(axis).mode == "cst" else "csv",
        msgspec.to_builtins(found.measured),
        found.said,
        loops,
        list(found.changes),
        found.remedy if found.changes else "",
        frequency.tolist(),
        (20.0 * np.log10(np.abs(opened))).tolist(),
        np.degrees(np.angle(opened)).tolist(),
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
