"""A disk that stalls under a server's journal, by a library that is preloaded."""

from __future__ import annotations

import subprocess
from pathlib import Path

from tests.fire.link import MissingMeans

SOURCE = Path(__file__).with_name("stalling_disk.c")


class StallingDisk:
    """Build the library.

    Args:
        folder: where it goes.

    Raises:
        MissingMeans: there is no C compiler.
    """

    def __init__(self, folder: Path) -> None:
        self._while_there = folder / "stalled"
        self._library = folder / "stalling_disk.so"
        command = ["cc", "-shared", "-fPIC", "-O1", "-o", str(self._library), str(SOURCE), "-ldl"]
        try:
            subprocess.run(command, check=True, capture_output=True, text=True)
        except (OSError, subprocess.CalledProcessError) as error:
            raise MissingMeans(f"the stalling disk cannot be built: {error}") from error

    @property
    def under(self) -> list[str]:
        """What a command is prefixed with, to have it."""
        return ["env", f"LD_PRELOAD={self._library}", f"STALLED_WHILE={self._while_there}"]

    def stall(self) -> None:
        """Let no write to the journal's log end, and no sync."""
        self._while_there.touch()

    def go_on(self) -> None:
        """Let them end."""
        self._while_there.unlink(missing_ok=True)
