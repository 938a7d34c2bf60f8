"""Fleets of light machines behind one router and two: discovery, bandwidth, and what router and viewer need.

It runs in a network namespace of its own, so that the loopback carries nothing else. MC_FLEET=10,100 in the
environment takes other sizes.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator

from tests.bench.figures import Figure, NotAvailable
from tests.bench.server import companion, free_port
from tests.bench.telemetry import cpu_seconds, resident_mib

SIZES = (10, 100, 1000)
STATE_HZ = 1.0
INSIDE = "MC_FLEET_INSIDE"


def measure() -> list[Figure]:
    """All sizes, behind one router and behind two, of which the viewer is at the first."""
    if os.environ.get(INSIDE):
        return [figure for size in _sizes() for routers in (1, 2) for figure in _fleet(size, routers)]
    unshare = shutil.which("unshare")
    if (
        unshare is None
        or subprocess.run([unshare, "-n", "true"], check=False, capture_output=True).returncode
    ):
        raise NotAvailable("a network namespace (unshare -n) needs root")
    inside = (
        "import json; from tests.bench import fleet; print(json.dumps([vars(f) for f in fleet.measure()]))"
    )
    done = subprocess.run(
        [unshare, "-n", "sh", "-c", 'ip link set lo up && exec "$0" -c "$1"', sys.executable, inside],
        env=os.environ | {INSIDE: "1"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return [Figure(**each) for each in json.loads(done.stdout.splitlines()[-1])]


def _sizes() -> tuple[int, ...]:
    chosen = os.environ.get("MC_FLEET", "")
    return tuple(int(size) for size in chosen.split(",")) if chosen else SIZES


def _fleet(machines: int, routers: int) -> list[Figure]:
    with contextlib.ExitStack() as stack:
        endpoints = [f"tcp/127.0.0.1:{free_port()}" for _ in range(routers)]
        pids = []
        for number, endpoint in enumerate(endpoints):
            router = companion("tests.bench.plain_router", endpoint, *endpoints[:number])
            pids.append(stack.enter_context(router).pid)
        for number, endpoint in enumerate(endpoints):
            share = machines // routers
            options = [f"--machines={share}", f"--first={1 + number * share}", f"--state-hz={STATE_HZ}"]
            stack.enter_context(_light_machines(*options, "--connect", endpoint))
        viewer = subprocess.Popen(
            [sys.executable, "-m", "tests.bench.fleet_viewer", endpoints[0], str(machines)],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert viewer.stdout is not None
        viewer.stdout.readline()
        before = cpu_seconds(pids[0])
        seen = json.loads(viewer.stdout.readline())
        router_cpu = 100.0 * (cpu_seconds(pids[0]) - before) / 5.0
        viewer.wait(60)
        router_mib = resident_mib(pids[0])
    if seen["found"] < machines or seen["answered"] < machines:
        raise NotAvailable(f"{seen['found']} of {machines} found, {seen['answered']} answered")
    what = f"{machines} machines, {routers} router{'s' if routers > 1 else ''}"
    return [
        Figure(f"{what}: discovery", 1e3 * seen["discovery_s"], "ms"),
        Figure(f"{what}: states of all, by one query", 1e3 * seen["states_s"], "ms"),
        Figure(f"{what}: bytes for that", seen["states_bytes"] / machines, "B a machine"),
        Figure(
            f"{what}: states that come at {STATE_HZ:g} Hz",
            seen["states_a_second"],
            "1/s",
            machines * STATE_HZ,
            "asked for",
        ),
        Figure(f"{what}: bytes for them", seen["listen_bytes_a_second"] / 1024.0, "KiB/s"),
        Figure(f"{what}: CPU of the router meanwhile", router_cpu, "% of a core"),
        Figure(f"{what}: memory of the router", router_mib, "MiB"),
        Figure(f"{what}: CPU of the viewer meanwhile", seen["viewer_cpu"], "% of a core"),
        Figure(f"{what}: memory of the viewer", seen["viewer_mib"], "MiB"),
    ]


@contextlib.contextmanager
def _light_machines(*options: str) -> Iterator[None]:
    process = subprocess.Popen(
        [sys.executable, "-m", "mcserver", "fleet-sim", *options], stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stderr is not None
        line = process.stderr.readline()
        if "light machines" not in line:
            raise NotAvailable(f"fleet-sim does not start: {line}{process.stderr.read()[-300:]}")
        yield
    finally:
        process.terminate()
        process.communicate(timeout=30)
