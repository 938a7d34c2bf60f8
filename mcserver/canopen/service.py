"""The service path of a machine: all its CAN buses, booted before the executor and closed after it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait

from mcserver.can.open import open_port
from mcserver.can.pdo import ProcessData
from mcserver.can.port import CanPort
from mcserver.canopen.canopen_errors import DriveError, Stopped
from mcserver.canopen.configuration import configure
from mcserver.canopen.description import dictionary_of
from mcserver.canopen.dictionary import DeviceDictionary
from mcserver.canopen.io_nodes import configure_io
from mcserver.canopen.listening import MASTER, Listening, refuse_other_masters
from mcserver.canopen.node import Node, NodeAxis
from mcserver.canopen.service_bus import CanopenBus, OnEvent
from mcserver.canopen.settings import DriveSettings, settings_of, with_process_data
from mcserver.canopen.values import type_name
from mcserver.errors import ConfigurationError, McError
from mcserver.machine.machine_file import Machine

OnProgress = Callable[[str], None]

BOOT_ROUND_S = 0.1
PROGRESS_S = 2.0


class CanopenService:
    """All CAN buses of one machine; made by `start`.

    Attributes:
        machine: as its file describes it.
    """

    def __init__(self, machine: Machine, dictionaries: dict[int, DeviceDictionary]) -> None:
        self.machine = machine
        self.buses: list[CanopenBus] = []
        self._dictionaries = dictionaries
        self._closing = threading.Lock()

    @classmethod
    def start(
        cls,
        machine: Machine,
        on_event: OnEvent,
        on_progress: OnProgress = lambda _: None,
        stopping: Callable[[], bool] = lambda: False,
        *,
        take_over: bool = False,
    ) -> CanopenService:
        """Open the buses, listen for other masters, boot every drive and wait for them.

        Args:
            on_event: called in threads; must not wait. on_progress: a sentence for people.
            stopping: whether to give up. take_over: reset the nodes whoever else is at work.

        Raises:
            ConfigurationError: MC008 an EDS, MC552 a drive that has no place for its configuration.
            RuntimeFault: MC424 a bus; MC560 another master; MC550, MC551, MC553, MC554, MC555 a drive (the
                first by axis; the others are named).
            Stopped: ``stopping`` said so.
        """
        drives = [drive for drive in settings_of(machine) if drive.fieldbus == "can"]
        dictionaries = {drive.axis: dictionary_of(drive) for drive in drives if drive.kind == "cia402"}
        plans: dict[str, list[NodeAxis]] = {}
        for drive in drives:
            if drive.kind == "cia401":
                planned = NodeAxis(drive, writes=tuple(configure_io(drive, machine, MASTER)))
            else:
                planned = _plan(drive, machine.cycle_s, dictionaries.get(drive.axis))
            plans.setdefault(drive.bus, []).append(planned)
        service = cls(machine, dictionaries)
        ports: list[CanPort] = []
        try:
            for own in plans.values():
                ports.append(open_port(own[0].settings.address))
            if not take_over:
                _listen(list(plans.values()), ports, stopping)
            for name, own in plans.items():
                service.buses.append(CanopenBus(name, ports.pop(0), own, on_event))
            service._boot(on_progress, stopping)
        except BaseException:
            for port in ports:
                port.close()
            service.close()
            raise
        return service

    def close(self) -> None:
        """Drives leave operation; no thread and no connection is left. A second call does nothing."""
        if not self._closing.acquire(blocking=False):
            return
        for bus in self.buses:
            bus.close()

    @property
    def nodes(self) -> list[Node]:
        """By axis."""
        every = [node for bus in self.buses for node in bus.nodes]
        return sorted(every, key=lambda node: node.settings.axis)

    def process_data(self) -> dict[int, ProcessData]:
        """Return the process data that the drives have agreed to, by axis."""
        return {
            axis.settings.axis: axis.planned.without(node.dropped & axis.planned.spare.keys())
            for node in self.nodes
            for axis in node.axes
            if axis.planned is not None
        }

    def agreed(self, machine: Machine) -> Machine:
        """Return the machine with the process data that its drives have agreed to, for the cycle."""
        return with_process_data(machine, self.process_data())

    def dictionary(self, axis: int) -> DeviceDictionary | None:
        """Of an axis's drive; None where it has none."""
        return self._dictionaries.get(axis)

    # ------------------------------------------------------------ inside

    def _boot(self, on_progress: OnProgress, stopping: Callable[[], bool]) -> None:
        began = time.monotonic()
        named: set[Future[None]] = set()
        under_way = {future: node for bus in self.buses for node, future in bus.boot()}
        count = len(under_way)
        failures: list[McError] = []
        left = set(under_way)
        while left:
            done, left = wait(left, timeout=BOOT_ROUND_S, return_when=FIRST_COMPLETED)
            failures += [error for future in done if (error := _failure(future, under_way[future]))]
            if stopping():
                raise Stopped
            if left != named and time.monotonic() - began > PROGRESS_S:
                named = left
                names = sorted(under_way[each].settings.name for each in left)
                if names:
                    on_progress("waiting for " + "; ".join(names))
        if failures:
            raise _joined(failures)
        for bus in self.buses:
            bus.supervise()
        shown = ", ".join(f"{bus.name} ({len(bus.nodes)})" for bus in self.buses)
        are = "drive is" if count == 1 else "drives are"
        on_progress(f"{count} {are} up after {time.monotonic() - began:.2f} s: {shown}")
        for node in self.nodes:
            if node.remarks:
                on_progress(f"{node.settings.name}: " + "; ".join(node.remarks))


def _plan(drive: DriveSettings, cycle_s: float, dictionary: DeviceDictionary | None) -> NodeAxis:
    if dictionary is None:
        return NodeAxis(drive)
    writes, planned = configure(drive, cycle_s, dictionary, MASTER)
    kinds = {
        (index, subindex): type_name(variable.data_type)
        for index, subindex, _ in drive.monitor
        if (variable := dictionary.get_variable(index, subindex)) is not None
    }
    return NodeAxis(drive, planned, tuple(writes), kinds)


def _listen(
    plans: Sequence[Sequence[NodeAxis]],
    ports: Sequence[CanPort],
    stopping: Callable[[], bool],
) -> None:
    """Refuse buses on which another master is at work (MC560)."""
    duration = max((axis.settings.listen_s for own in plans for axis in own), default=0.0)
    if duration <= 0.0:
        return
    buses = [
        Listening(
            own[0].settings.bus,
            port,
            {axis.settings.node for axis in own if axis.settings.has_profile},
            {
                identifier: axis.settings.node
                for axis in own
                for identifier in (axis.settings.streamed.foreign_ids if axis.settings.streamed else ())
            },
            own[0].settings.foreign_sync,
        )
        for own, port in zip(plans, ports, strict=True)
    ]
    refuse_other_masters(buses, duration, stopping)


def _failure(future: Future[None], node: Node) -> McError | None:
    error = future.exception()
    if error is None:
        return None
    if isinstance(error, McError):
        return error
    return node.settings.fault(
        "MC555",
        f"its boot-up failed: {type(error).__name__}: {error}",
        "this is a defect of the server; please report it",
    )


def _joined(failures: list[McError]) -> McError:
    """The first by axis; what else failed stands in its message."""
    ordered = sorted(failures, key=lambda error: getattr(error, "axis", None) or 0)
    first = ordered[0]
    if len(ordered) == 1 or isinstance(first, ConfigurationError):
        return first
    others = "".join(f"\n  also {error.code}: {error.message}" for error in ordered[1:])
    return DriveError(first.code, first.message + others, first.hint, axis=getattr(first, "axis", None))
