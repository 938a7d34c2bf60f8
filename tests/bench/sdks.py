"""Each SDK beside the Python SDK: lines streamed, a status call, samples of 64 axes, processor time."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path

from tests.bench.figures import Figure, NotAvailable
from tests.e2e.servers import ServerProcess
from tests.gateway.conftest import GatewayProcess, cell
from tests.sdks.conftest import AXES, environment, program_file
from tests.sdks.languages import SDKS, Sdk, ToolMissing

LINES = 20_000
LIMIT_S = 120.0
# those whose conformance program has the task `bench`
MEASURED = ("python", "typescript", "go", "rust", "java")
UNITS = {
    "lines_per_s": ("lines streamed", "1/s"),
    "status_p50_ms": ("status, median", "ms"),
    "frames_per_s": ("messages of samples", "1/s"),
    "rows_per_s": ("cycles of 64 axes", "1/s"),
    "cpu_s": ("processor time of all of it", "s"),
}


def measure() -> list[Figure]:
    """Run each SDK's conformance program in turn, against one server."""
    built = {name: sdk for name in MEASURED if (sdk := built_sdk(name)) is not None}
    if "python" not in built:
        raise NotAvailable("the Python SDK is what the others are held against")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "cell.toml").write_text(cell(AXES), "utf-8")
        file = program_file(Path(folder), ["G1010", "G91 G64 F6000"] + ["G01 X0.001"] * (LINES - 2))
        server = ServerProcess(Path(folder), str(Path(folder) / "cell.toml"), "cell")
        server.start()
        try:
            gateway = GatewayProcess(server.endpoint)
            try:
                found = {
                    name: run(sdk, gateway.ws if sdk.through == "gateway" else server.endpoint, file)
                    for name, sdk in built.items()
                }
            finally:
                gateway.close()
        finally:
            server.close()
    reference = found["python"]
    return [
        Figure(
            f"{name} ({built[name].through}): {what}",
            figures[key],
            unit,
            None if name == "python" else reference[key],
            "" if name == "python" else "the Python SDK, by Zenoh",
        )
        for key, (what, unit) in UNITS.items()
        for name, figures in found.items()
    ]


def built_sdk(name: str) -> Sdk | None:
    """An SDK's conformance program; None where its tools are not installed."""
    try:
        return SDKS[name]()
    except ToolMissing:
        return None


def run(sdk: Sdk, address: str, file: Path) -> dict[str, float]:
    """What the program measured, and the processor time that it took."""
    before = os.times()
    done = subprocess.run(
        [*sdk.command, address, "", "bench", str(file)],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        env=environment(),
        check=True,
    )
    after = os.times()
    figures: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    return {**figures, "cpu_s": spent}
