"""``mcserver ros`` as a process of its own."""

from __future__ import annotations

import subprocess
import sys

from tests.e2e.servers import ROOT, environment

DOMAIN = 7
JOINTS = [f"joint_{number}" for number in range(1, 7)]


def start_bridge(endpoint: str, *options: str) -> subprocess.Popen[bytes]:
    command = [
        sys.executable,
        "-m",
        "mcserver",
        "ros",
        "--domain",
        str(DOMAIN),
        "--connect",
        endpoint,
        *options,
    ]
    return subprocess.Popen(command, env=environment(), cwd=ROOT)
