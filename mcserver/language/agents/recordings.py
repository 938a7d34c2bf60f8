"""List a folder of recordings: MCAP of the recorder or of ``mcctl record``, NPZ of a simulation, CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mcserver.errors import UsageFault
from mcserver.recorder.reading import is_recording, read_recording

MAX_LISTED = 100
# files that are looked into: the newest, and none that would hold an agent up
MAX_LOOKED_INTO = 20
MAX_READ = 64 * 1024 * 1024  # bytes


def list_recordings(folder: Path) -> list[dict[str, Any]]:
    """Return the newest recordings of a folder: name and bytes; of MCAP and NPZ files what was recorded.

    That is the duration, how far each axis went (mm, degrees), and where the file says so the machine, how
    many lines ended and the codes of faults.
    """
    try:
        files = [
            path
            for path in folder.iterdir()
            if (is_recording(path.name) or path.suffix == ".csv") and path.is_file()
        ]
        files.sort(key=lambda path: path.stat().st_mtime, reverse=True)
        return [_describe(path, number < MAX_LOOKED_INTO) for number, path in enumerate(files[:MAX_LISTED])]
    except OSError:
        return []


def _describe(path: Path, look: bool) -> dict[str, Any]:
    size = path.stat().st_size
    found: dict[str, Any] = {"name": path.name, "bytes": size}
    if not look or not is_recording(path.name) or size > MAX_READ:
        return found
    try:
        run = read_recording(path)
    except UsageFault as error:
        return {**found, "error": f"{error.code}: {error.message}"}
    cycles = run.cycles
    low, high = cycles.setpoint.min(axis=0), cycles.setpoint.max(axis=0)
    found["duration_s"] = float(cycles.time_s[-1] - cycles.time_s[0])
    found["axes"] = {
        str(int(axis)): {"min": float(low[column]), "max": float(high[column])}
        for column, axis in enumerate(cycles.axes)
    }
    if run.machine is not None:
        found["machine"] = run.machine.name
        found["lines_ended"] = len(run.lines)
        found["faults"] = [
            each.fault.code if each.fault is not None else each.kind
            for each in run.events
            if each.kind in ("fault", "estop")
        ]
    return found
