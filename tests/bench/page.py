"""The operator's page: what viewers cost its process, and what the server notices of it.

Viewers are WebSockets that do what a browser does (`tests.bench.page_viewers`).
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from mcclient import MotionError, sync

from tests.bench.figures import Figure, NotAvailable, percentile
from tests.bench.server import end, free_port, running, server
from tests.bench.telemetry import cpu_share
from tests.e2e.servers import ROOT, CommandProcess, environment

VIEWERS = (1, 10, 50)
FLEETS = (500, 1000)
CALLS = 300
CALLS_S = 5.0
# one long slow move after the other: something changes in every state
PROGRAM = ["G1010", *["G01 X400 Y300 F3000", "G01 X0 Y0"] * 200]


def measure() -> list[Figure]:
    """A machine's page with more and more viewers, then the fleet's page with many machines."""
    load = Figure("load of this computer before", os.getloadavg()[0], "tasks")
    return [load, *_machine_page(), *_fleet_page()]


def _machine_page() -> list[Figure]:
    found: list[Figure] = []
    with (
        server() as reached,
        sync.Machine.connect("bench", reached.endpoint) as machine,
        page(reached.endpoint) as (process, url),
        moving(machine),
    ):
        address = f"{url}machine/bench"
        alone, late_alone = _calls(machine)
        for count in VIEWERS:
            with viewers(address, count) as holder:
                share = cpu_share(process.pid)
                calls, late = _calls(machine)
                came = holder()
            found += [
                Figure(f"CPU of the page, {count} on a machine's page", share, "% of a core"),
                Figure(f"messages to each of {count}", came, "a second"),
                Figure(
                    f"status p99 beside {count}",
                    1e3 * percentile(calls, 0.99),
                    "ms",
                    1e3 * percentile(alone, 0.99),
                    "nobody looks",
                ),
                Figure(f"late cycles beside {count}", late, f"in {CALLS_S:g} s", late_alone, "nobody looks"),
            ]
    return found


def _fleet_page() -> list[Figure]:
    found = []
    for machines in FLEETS:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        command = [sys.executable, "-m", "mcserver", "fleet-sim", "-n", str(machines), "--listen", endpoint]
        with running(command), page(endpoint) as (process, url):
            for count in (1, 10):
                with viewers(url, count, settle_s=20.0):
                    share = cpu_share(process.pid)
                what = f"CPU of the page, {count} on the fleet of {machines}"
                found.append(Figure(what, share, "% of a core"))
    return found


@contextmanager
def page(endpoint: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """``mcserver web`` on a free port; its process and its address."""
    with TemporaryDirectory() as folder:
        options = ("--port", "0", "--connect", endpoint, "--programs", str(Path(folder, "programs")))
        command = CommandProcess("web", *options, errors=subprocess.DEVNULL)
        try:
            yield command.process, command.url
        finally:
            command.close()


@contextmanager
def viewers(url: str, count: int, settle_s: float = 3.0) -> Iterator[Callable[[], float]]:
    """So many viewers; what is yielded ends them, and says how many messages each got a second."""
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.bench.page_viewers", url, str(count)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env=environment(),
    )
    assert process.stdout is not None

    def finish() -> float:
        said, _ = process.communicate("", timeout=60)
        return float(json.loads(said.splitlines()[-1])["messages_a_second"])

    try:
        if not process.stdout.readline():
            raise NotAvailable("the viewers could not connect")
        time.sleep(settle_s)
        yield finish
    finally:
        if process.poll() is None:
            end(process)


@contextmanager
def moving(machine: sync.Machine) -> Iterator[None]:
    """Keep the machine moving meanwhile."""
    with suppress(MotionError), machine.program("moving") as program:
        program.send_lines(PROGRAM)
        try:
            yield
        finally:
            machine.abort()


def _calls(machine: sync.Machine) -> tuple[list[float], int]:
    """Seconds of status calls spread over `CALLS_S`, and the late cycles meanwhile."""
    before, taken = machine.status().late_cycles, []
    for _ in range(CALLS):
        start = time.perf_counter()
        machine.status()
        taken.append(time.perf_counter() - start)
        time.sleep(max(0.0, CALLS_S / CALLS - taken[-1]))
    return taken, machine.status().late_cycles - before
