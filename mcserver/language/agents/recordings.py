"""List a folder of recordings, as ``mcserver simulate --output`` and ``mcctl`` write them."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

MAX_LISTED = 100
MAX_READ = 64 * 1024 * 1024  # bytes of a file that is looked into


def list_recordings(folder: Path) -> list[dict[str, Any]]:
    """Return the newest recordings of a folder: name, bytes, and for NPZ files duration and extents."""
    try:
        files = [path for path in folder.iterdir() if path.suffix in (".npz", ".csv") and path.is_file()]
        files.sort(key=lambda path: path.stat().st_mtime, reverse=True)
        return [_describe(path) for path in files[:MAX_LISTED]]
    except OSError:
        return []


def _describe(path: Path) -> dict[str, Any]:
    size = path.stat().st_size
    found: dict[str, Any] = {"name": path.name, "bytes": size}
    if path.suffix != ".npz" or size > MAX_READ:
        return found
    try:
        with np.load(path, allow_pickle=False) as recording:
            setpoint, axes, time_s = recording["setpoint"], recording["axes"], recording["time_s"]
            found["duration_s"] = float(time_s[-1] - time_s[0]) if len(time_s) else 0.0
            if len(setpoint):
                low, high = setpoint.min(axis=0), setpoint.max(axis=0)
                found["axes"] = {
                    str(int(axis)): {"min": float(low[column]), "max": float(high[column])}
                    for column, axis in enumerate(axes)
                }
    except (OSError, ValueError, KeyError, IndexError, zipfile.BadZipFile) as error:
        found["error"] = f"cannot be read: {type(error).__name__}"
    return found
