"""Calls to a server that plans and runs a long program of short lines, beside the same while it idles."""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.bench.figures import Figure, NotAvailable, percentile
from tests.bench.round_trip import RAW_KEY, latencies, raw_session
from tests.bench.server import server

LINES = 200_000
CALLS = 2000


def measure() -> list[Figure]:
    """`status` calls, one after another, before and while the program streams; raw gets in turn with them.

    A raw get has nothing of the server in it but the load that it puts on the computer.
    """
    with raw_session() as raw, server() as reached, tempfile.TemporaryDirectory() as folder:
        key = f"mc/@v1/{reached.machine}/@rpc/bench/status"
        idle = latencies(reached.session, key, [b""] * CALLS)
        raw_idle = latencies(raw, RAW_KEY, [b""] * CALLS)
        program = Path(folder, "curve.gcode")
        program.write_text(curve(), "utf-8")
        client = subprocess.Popen(
            [
                sys.executable,
                "-c",
                "from mcclient.cli import main; main()",
                "run",
                str(program),
                "--machine",
                reached.machine,
                "--connect",
                reached.endpoint,
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        busy: list[float] = []
        raw_busy: list[float] = []
        try:
            while client.poll() is None:
                busy += latencies(reached.session, key, [b""] * 200)
                raw_busy += latencies(raw, RAW_KEY, [b""] * 200)
            assert client.stderr is not None
            output = client.stderr.read().decode()
        finally:
            client.kill()
            client.communicate()
        if client.returncode != 0:
            raise NotAvailable(f"mcctl run ended with {client.returncode}: {output.strip()[-200:]}")
    meanwhile = f"while {LINES:,} lines are planned".replace(",", "\u2009")
    return [
        Figure(
            f"{what} {name} {meanwhile}",
            percentile(under_load, share),
            "µs",
            percentile(before, share),
            "the same while the server idles",
            "≤ 3" if share == 0.99 and what == "status" else "",
        )
        for what, under_load, before in (("status", busy, idle), ("a raw get", raw_busy, raw_idle))
        for name, share in (("p50", 0.5), ("p99", 0.99))
    ]


def curve() -> str:
    """A spiral of lines of 0.1 mm at 1000 mm/s: 10 000 lines a second."""
    head = [f"G1010 P{axis}" for axis in range(3)] + ["G64", "G94", "F60000"]
    lines, angle = [], 0.0
    for _ in range(LINES - len(head)):
        radius = 200.0 + angle
        angle += 0.1 / radius
        lines.append(f"G01 X{radius * math.cos(angle) - 200:.4f} Y{radius * math.sin(angle):.4f}")
    return "\n".join([*head, *lines]) + "\n"
