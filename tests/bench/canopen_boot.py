"""From nothing to eight operational CANopen drives: by the service path, over a hub, drives in a process."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from mcserver.machine.bus_load import frame_bits
from mcserver.machine.machine_file import Machine, load_machine
from tests.bench.figures import Figure, NotAvailable
from tests.bench.server import free_port
from tests.e2e_can.processes import ReadyProcess
from tests.machine_text import axes_text

DRIVES = 8
RUNS = 5
BITRATE = 1_000_000
# 1000h and two entries of 1018h are read.
READS = 3


def measure() -> list[Figure]:
    """Median boot-up, and the slowest of all."""
    try:
        from mcserver.canopen.configuration import configuration_writes
        from mcserver.canopen.dictionary import generic_dictionary
        from mcserver.canopen.service import CanopenService
        from mcserver.canopen.service_bus import MASTER
        from mcserver.canopen.settings import settings_of
    except ModuleNotFoundError as error:
        raise NotAvailable(f"{error.name} is not installed: pip install canopen python-can") from error
    with _simulated() as machine:
        times = []
        for _ in range(RUNS):
            start = time.perf_counter()
            service = CanopenService.start(machine, lambda _: None)
            times.append(time.perf_counter() - start)
            service.close()
    drive = settings_of(machine)[0]
    writes = configuration_writes(drive, machine.cycle_s, generic_dictionary(drive.node), MASTER)
    frames = 2 * DRIVES * (len(writes) + READS)
    floor = 1e3 * frames * frame_bits(8) / BITRATE
    against = f"its {frames} SDO frames on one bus of 1 Mbit/s"
    times.sort()
    return [
        Figure(f"boot of {DRIVES} drives", 1e3 * times[RUNS // 2], "ms", floor, against, "< 1 s"),
        Figure("the slowest", 1e3 * times[-1], "ms", floor, against, "< 1 s"),
    ]


@contextlib.contextmanager
def _simulated() -> Iterator[Machine]:
    hub = f"127.0.0.1:{free_port()}"
    bus = f'[[bus]]\nname = "can"\naddress = "socketcand:{hub}/can0"\n'
    head = f'[machine]\nname = "bench"\ncycle_hz = 100\n{bus}'
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "machine.toml"
        axes = (
            axes_text(
                [axis],
                keys="units_per_motor_rev = 10",
                drive="cia402",
                drive_keys=f'bus = "can"\nnode = {axis + 1}\ncounts_per_motor_rev = 65536',
            )
            for axis in range(DRIVES)
        )
        file.write_text(head + "".join(axes))
        drives = ReadyProcess(["mcserver", "drive-sim", "--machine", str(file), "--hub", hub])
        try:
            yield load_machine(str(file))
        finally:
            drives.close()
