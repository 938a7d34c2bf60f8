"""Other programs, run to their end."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from deploy.release.versions import NotReleasable


def run(command: Sequence[str], folder: Path, environment: Mapping[str, str] | None = None) -> str:
    """Run a command in a folder and return what it prints.

    Raises:
        NotReleasable: it is not there, or fails.
    """
    try:
        done = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, **(environment or {})},
            capture_output=True,
            text=True,
            check=False,
        )
    except FileNotFoundError:
        raise NotReleasable([f"{command[0]} is not installed"]) from None
    if done.returncode:
        said = (done.stdout + done.stderr).strip()[-2000:]
        raise NotReleasable([f"{' '.join(command)}: exit code {done.returncode}\n{said}"])
    return done.stdout
