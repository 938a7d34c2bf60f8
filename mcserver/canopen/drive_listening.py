"""Operators listen to the drives of a running machine: a scope, the gains of loops, the health of buses.

Nothing is sent. The buses are listened to for one request at a time.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import closing
from typing import Protocol, TypeVar

import msgspec
import numpy as np

from mcserver.can.open import open_port
from mcserver.canopen.bus_report import bus_report
from mcserver.canopen.canopen_errors import DriveError, Stopped
from mcserver.canopen.loop_tuning import Judged, check_tunable, judge
from mcserver.canopen.reachable_drives import OnBus, ReachableDrives
from mcserver.canopen.scope import Scope, ScopeTrace, read_trigger
from mcserver.canopen.scope_recording import record_cycles
from mcserver.canopen.views import BusHealth, DriveTrace, DriveTuning, ScopeSignal, SdoTarget, TunedLoop
from mcserver.drives.cia402.drive import cia402_drive
from mcserver.machine.axis import Axis
from mcserver.machine.machine_file import Machine

T = TypeVar("T")


class InThread(Protocol):
    """Has work done in a thread."""

    async def __call__(self, work: Callable[[], T], /) -> T:
        """Return what it gives."""


class DriveListening:
    """Drives as operators may listen to them.

    Args:
        drives: that can be reached. in_thread: has work done in a thread of its own.
    """

    def __init__(self, drives: ReachableDrives, in_thread: InThread) -> None:
        self._drives, self._in_thread = drives, in_thread
        self._listening = False
        self._stopping = threading.Event()

    def stop(self) -> None:
        """End what listens, at once."""
        self._stopping.set()

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

    # ------------------------------------------------------------ inside

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

    def _listened(self, axis: int) -> tuple[Machine, OnBus]:
        settings = self._drives.find(SdoTarget(0, axis=axis)).settings
        own = next((each for each in self._drives.on_buses() if each.settings.axis == axis), None)
        if own is None:
            raise settings.fault("MC559", f"is {settings.kind}, not CiA 402", "use its maker's own tool")
        return own.machine, own

    def _record(self, own: OnBus, scope: Scope, timeout_s: float) -> tuple[float, int]:
        line, settings = self._drives.line, own.settings
        on_line = line is not None and settings.fieldbus == "ethercat"
        port = line.listen(settings.bus) if line is not None and on_line else open_port(settings.address)
        with closing(port):
            return record_cycles(port, settings, scope, timeout_s, self._check)

    def _health(self, seconds: float) -> list[BusHealth]:
        service, line = self._drives.service, self._drives.line
        on_can = [] if service is None else service.buses
        on_line = [] if line is None else line.buses
        share = seconds / max(1, len(on_can) + len(on_line))
        drives, reports = self._drives.on_buses(), []
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
