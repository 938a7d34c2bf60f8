"""Running a command line in this process, or in one of its own where the process itself is what is tested."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
ENTRY = "from mcserver.cli.app import main; main()"


def command(*arguments: str, **options: Any) -> subprocess.CompletedProcess[bytes]:
    """``mcserver ARGUMENTS`` as a process, without colours and with its own standard streams."""
    environment = {**os.environ, "NO_COLOR": "1", "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    streams: dict[str, Any] = {
        "stdin": subprocess.DEVNULL,
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
    }
    return subprocess.run(
        [sys.executable, "-c", ENTRY, *arguments],
        **{**streams, **options},
        env=environment,
        timeout=300,
        check=False,
    )
