"""How a bus is, by its frames alone: listened to beside whoever is its master."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mcserver.can.pdo import MappedPdo, ProcessData
from mcserver.can.port import ListeningPort
from mcserver.canopen.bus_frames import frames_of
from mcserver.canopen.bus_health import BusListener
from mcserver.canopen.cycle_samples import CycleSampler, Signal, following_error
from mcserver.canopen.listening import for_masters, sign_of_master
from mcserver.canopen.settings import NO_AXIS, settings_of
from mcserver.canopen.views import BusHealth
from mcserver.machine.machine_file import Machine

# Cycles after which the greatest following errors are taken, so that memory stays bounded.
BLOCK = 4096


def bus_report(
    machine: Machine,
    bus: str,
    port: ListeningPort,
    seconds: float,
    data: Mapping[int, ProcessData],
    signals: Sequence[Signal],
    check: Callable[[], None] = lambda: None,
) -> BusHealth:
    """Listen on a bus and count; nothing is sent.

    Args:
        port: of the bus. data: process data of its drives, by axis. signals: of all these axes.
            check: called with each frame; may raise.
    """
    (bitrate,) = (each.bitrate for each in machine.buses if each.name == bus)
    drives = [drive for drive in settings_of(machine) if drive.bus == bus]
    nodes: dict[int, tuple[list[int], list[MappedPdo]]] = {}
    for each in drives:
        axes, tpdos = nodes.setdefault(each.node, ([], []))
        if each.axis != NO_AXIS:
            axes.append(each.axis)
            tpdos += data[each.axis].tpdos if each.axis in data else ()
    listener = BusListener(nodes, [pdo.cob_id for each in data.values() for pdo in each.rpdos])
    sampler = CycleSampler(signals)
    errors: dict[str, float] = {}
    rows: list[list[float]] = []
    master = ""
    began = time.monotonic()
    commands = for_masters(drives[0], port)
    for at_s, identifier, payload in frames_of(port, seconds):
        check()
        listener.take(at_s, identifier, payload)
        master = master or sign_of_master(identifier, commands)
        row = sampler.take(identifier, payload)
        if row is not None:
            rows.append(row)
            if len(rows) >= BLOCK:
                _note_errors(errors, rows, signals)
                # the last setpoint belongs to the next reading
                rows = rows[-1:]
    _note_errors(errors, rows, signals)
    counts = listener.report(time.monotonic() - began, bitrate)
    counters = port.counters
    return BusHealth(drives[0].bus, counts, master, counters.errors + counters.malformed, errors)


def _note_errors(errors: dict[str, float], rows: list[list[float]], signals: Sequence[Signal]) -> None:
    if len(rows) < 2:
        return
    numbers = np.array(rows)
    for axis in {signal.axis for signal in signals}:
        columns = [at for at, signal in enumerate(signals) if signal.axis == axis]
        found = following_error(numbers[:, columns], [signals[at] for at in columns])
        if found is not None and np.isfinite(found).any():
            greatest = float(np.nanmax(np.abs(found)))
            errors[str(axis)] = max(errors.get(str(axis), 0.0), greatest)
